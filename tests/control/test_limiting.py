"""What limits a designed joint: designs without each cause, and the closed form of the small delays."""

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from simulation.plants import ELASTIC, MOTOR, chain

pytest.importorskip("control", reason="python-control is not installed: pip install armwright[control]")

CASCADE = aw.Cascade(position_kp=5.0, speed_kp=10.0, speed_ki=20.0)


def scenario(arm, period=2e-3, timing="one-tick", sensors=None):
    loop = aw.Loop(CASCADE, period=period, timing=aw.Timing(timing), sensors=sensors or aw.Sensors())
    return aw.Scenario(arm, duration=1.0, loop=loop)


def named(limit, words):
    return next((factor for cause, factor in limit.causes.items() if words in cause), None)


def test_each_cause_is_the_design_without_it():
    """Delay and the encoder's filter: the factor is that of a design of the other scenario, within the grid of bandwidths."""
    sensors = aw.Sensors(velocity="filtered", cutoff_hz=60.0)
    one = scenario(aw.load("two-link"), sensors=sensors)
    assert one.loop is not None
    design = aw.loops.design_gains(one, poses=100)
    others = {
        "delay": replace(one, loop=replace(one.loop, timing=aw.Timing())),
        "encoder": replace(one, loop=replace(one.loop, sensors=aw.Sensors())),
    }
    for words, other in others.items():
        ratio = aw.loops.design_gains(other, poses=100).alone / design.alone
        for limit, expected in zip(design.limits, ratio, strict=True):
            assert named(limit, words) == pytest.approx(expected, rel=0.2), (words, limit)
            assert named(limit, words) > 1.1
            assert limit.slow


@pytest.mark.study
def test_the_fastest_loop_has_the_bandwidth_of_its_small_delays():
    """Kessler's 1/(2 T): without the delay T falls from 1.5 to 0.5 periods, so that a joint at this bound is 3 times faster."""
    design = aw.loops.design_gains(scenario(aw.load("lwa4p"), 4e-3), poses=100)
    at_bound = np.isclose(design.alone, 1.0 / (2.0 * design.lag), rtol=1e-6)
    assert at_bound.any()
    for limit in np.array(design.limits)[at_bound]:
        assert 2.0 < named(limit, "delay of 4 ms") <= 3.0 * (1.0 + 1e-9)


def test_what_is_not_there_is_not_named():
    design = aw.loops.design_gains(scenario(aw.load("two-link"), timing="ideal"), poses=50)
    for limit in design.limits:
        assert [named(limit, words) for words in ("delay", "encoder", "elasticity", "inductance")] == [None] * 4
        assert named(limit, "sample period of 2 ms") > 1.1


def test_soft_gears_and_slow_windings_are_found():
    soft = {**ELASTIC, "stiffness_n_m_per_rad": 60.0}
    joint = {"command": "voltage", "motor": {**MOTOR, "inductance_h": 0.02}}
    names = ("elasticity", "inductance")
    found = []
    for elasticity in (soft, None):
        arm = chain([joint | ({} if elasticity is None else {"elasticity": elasticity})])
        (limit,) = aw.loops.design_gains(scenario(arm, 1e-3, "ideal"), poses=20).limits
        found.append([named(limit, words) for words in names])
    assert found[0][0] > 1.1
    assert found[1][0] is None
    assert found[1][1] > 1.1


def test_the_drive_s_limit_is_its_torque_over_the_stiffness():
    arm = aw.load("two-link")
    design = aw.loops.design_gains(scenario(arm), poses=50)
    stiffness = design.gains["speed_kp"] * design.gains["position_kp"]
    torque = aw.trajectories.MotionLimits.of(arm).torque
    for limit, k, most in zip(design.limits, stiffness, torque, strict=True):
        assert limit.saturates == pytest.approx(most / k) if np.isfinite(most) else np.isinf(limit.saturates)

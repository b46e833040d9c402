"""Noise gain and sensitivity of linear loops, the worst over poses, against simulated noise."""

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.tuning.linear_measures import measure


def loop_of(law, period=2e-3, preset="one-tick", **sensors):
    loop = aw.Loop(
        law, reference=[0.3, 0.2], period=period, timing=aw.Timing(preset=preset), sensors=aw.Sensors(**sensors)
    )
    return aw.Scenario(aw.load("two-link"), duration=4.0, loop=loop)


PD = aw.JointPID(kp=np.array([600.0, 120.0]), kd=np.array([60.0, 10.0]), gravity=True)
CASCADE = aw.Cascade(position_kp=6.0, speed_kp=np.array([60.0, 10.0]), position_every=2)


@pytest.mark.parametrize("law", [PD, CASCADE], ids=["pd", "two rates"])
def test_noise_of_the_linear_loop_is_that_of_a_simulation(law):
    sigma, q = 1e-6, np.array([0.3, 0.2])
    scenario = loop_of(law, velocity="difference")
    still = replace(scenario, arm=scenario.arm.replace(friction=None, gravity=[0.0, 0.0, 0.0]), start=q)
    batch = replace(
        law, **{name: aw.Batch(np.atleast_2d(getattr(law, name))) for name in ("kd", "speed_kp") if hasattr(law, name)}
    )
    assert still.loop is not None
    loop = aw.loops.LinearLoop(replace(still, loop=replace(still.loop, controller=batch)))
    found = measure("noise_gain", loop, q[None], loop.gains)[0]
    assert still.loop is not None
    noisy = replace(still.loop, sensors=replace(still.loop.joint_sensors, position_noise=sigma))
    run = aw.simulate(replace(still, loop=noisy, solver=aw.Solver(substeps=1)))
    u = run.u.values[500:]
    assert (u - u.mean(axis=0)).std(axis=0) / sigma == pytest.approx(found, rel=0.08)


def test_measures_are_the_worst_over_poses_and_infinite_where_unstable():
    batch = replace(PD, kp=aw.Batch([[600.0, 120.0], [6e7, 1.2e7]]))
    loop = aw.loops.LinearLoop(loop_of(batch, velocity="difference"))
    poses = np.array([[0.3, 0.2], [-1.0, 1.5]])
    for name in ("noise_gain", "sensitivity"):
        worst = measure(name, loop, poses, loop.gains)
        each = [measure(name, loop, pose[None], loop.gains) for pose in poses]
        assert (worst == np.maximum(*each)).all()
        assert np.isfinite(worst[0]).all()
        assert np.isinf(worst[1]).all()
    assert (measure("sensitivity", loop, poses, loop.gains)[0] >= 1.0).all()


def test_the_sensitivity_of_several_rates_is_refused():
    loop = aw.loops.LinearLoop(loop_of(replace(CASCADE, speed_kp=aw.Batch([[60.0, 10.0]]))))
    with pytest.raises(aw.ArmwrightError, match="several rates"):
        measure("sensitivity", loop, np.zeros((1, 2)), loop.gains)

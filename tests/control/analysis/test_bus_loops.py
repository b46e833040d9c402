"""Loops of the modular arm at its bus's periods: margins, and the rate at which their simulation becomes unstable."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.control.analysis import LinearLoop
from armwright.control.analysis.small_signal import small_signal_arm

EXAMPLES = Path(__file__).parents[3] / "examples"
WITHIN = 0.02  # of the period, between the analysis and the simulation
NUDGE = 1e-9 * np.array([1.0, -2.0, 1.5, 1.0, -1.0, 2.0])  # [rad] the simulation starts from


def bus(name):
    """The scenario of one lane, with gravity held at the reference, which changes no slope: the arm stands still there."""
    scenario = aw.read_scenario(EXAMPLES / f"bus-{name}.scenario.toml")
    loop = replace(scenario.loop, controller=aw.FeedForward(scenario.controller, gravity=True))
    return replace(scenario, loop=loop, vary={})


@pytest.fixture(scope="module", params=["4ms", "8ms"])
def analysed(request):
    scenario = bus(request.param)
    inertias = aw.loops.joint_inertias(scenario.arm, 20_000)
    poses = inertias.q[inertias.extremes()]
    period, failing = aw.loops.longest_period(scenario, poses)
    worst = poses[LinearLoop(scenario, failing).radius(poses).argmax()]
    return scenario, poses, period, worst


def growth(scenario, period, pose):
    """Largest speed in the last third of a small-signal run over that in the third before: friction and quantiser off."""
    arm, ticks = small_signal_arm(scenario.arm), 900
    loop = replace(
        scenario.loop,
        period=period,
        reference=pose,
        sensors=aw.Sensors(velocity="difference"),
        timing=aw.Timing("one-tick"),
    )
    solver = aw.Solver("rk4", substeps=4)
    run = aw.simulate(aw.Scenario(arm, ticks * period, loop=loop, start=pose + NUDGE, solver=solver))
    speed = np.abs(run.qd.values).max(axis=1)
    assert speed.max() < 1e-3  # still small
    return speed[600:].max() / speed[300:600].max()


@pytest.mark.sample(1)
def test_margins_are_kept(analysed):
    """A gain margin of 2 and a phase margin of 30 degrees in any one command, the other joints' loops closed."""
    scenario, poses, _, _ = analysed
    loop = LinearLoop(scenario)
    assert loop.keeps(loop.slopes(poses), 2.0, np.radians(30.0)).all()


@pytest.mark.sample(1)
def test_the_simulation_becomes_unstable_at_the_period_of_the_coupled_analysis(analysed):
    scenario, _, period, worst = analysed
    own, _ = aw.loops.longest_period(scenario, worst)
    assert own == pytest.approx(period, rel=2e-3)
    assert growth(scenario, (1.0 - WITHIN) * own, worst) < 0.99
    assert growth(scenario, (1.0 + WITHIN) * own, worst) > 1.01


@pytest.mark.study
def test_joints_by_themselves_say_nearly_the_same(analysed):
    """Rotors behind gears of 100 and more weigh most: what the other joints do changes little. Their links alone would."""
    scenario, poses, period, _ = analysed
    for others in ("held", "free"):
        alone, _ = aw.loops.longest_period(scenario, poses, others=others)
        assert alone == pytest.approx(period, rel=WITHIN)

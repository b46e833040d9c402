"""Unstable loops are called that, stable ones never: against the spectral radius of the linear loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.control.analysis.linear_loop import LinearLoop
from armwright.errors import DivergenceError, ScenarioError
from armwright.simulation.oscillation import suspicious
from physics.arms import arm
from raises_at import raises_at

SAID = "the loop is unstable"
PERIOD = 2e-3


def scenario_of(name, factor, pose, start, duration=1.2, **more):
    """Computed torque whose gains grow with a factor, a tick late."""
    controller = aw.ComputedTorque(100.0 * factor**2, 20.0 * factor)
    loop = aw.Loop(controller, pose, PERIOD, timing=aw.Timing("one-tick"))
    return aw.Scenario(arm(name), duration, loop=loop, start=start, **more)


@pytest.mark.parametrize(
    "name", ["two-link", *(pytest.param(each, marks=pytest.mark.study) for each in ("cmu-dd", "lwa4p", "panda"))]
)
def test_a_small_push_shows_what_the_linear_analysis_says(name):
    model = arm(name)
    pose = np.full(model.n, 0.3) if name != "panda" else np.array([0.0, -0.6, 0.0, -2.2, 0.0, 1.6, 0.8])
    seen = set()
    for factor in (1.0, 4.0, 8.0, 20.0, 30.0, 45.0):
        scenario = scenario_of(name, factor, pose, pose + 1e-4)
        radius = float(LinearLoop(scenario).radius(pose))
        if abs(np.log(radius)) * scenario.duration / PERIOD < 3.0:
            continue  # too near to the edge for a run of this length
        try:
            notes = aw.simulate(scenario, progress=False).attrs["notes"]
        except DivergenceError as error:
            notes = str(error)
        assert (SAID in notes) == (radius > 1.0), (factor, radius, notes)
        if radius > 1.0:
            assert "`armwright loops FILE`" in notes
        seen.add(radius > 1.0)
    assert seen == {True, False}


def test_the_note_says_frequency_and_growth_that_the_run_has():
    pose = np.array([0.3, 0.3])
    scenario = scenario_of("two-link", 24.0, pose, pose + 1e-7, duration=0.3)
    radius = float(LinearLoop(scenario).radius(pose))
    run = aw.simulate(scenario, progress=False)
    note = next(each for each in run.attrs["notes"].splitlines() if SAID in each)
    hz, growth = (float(note.partition(f"{word} ")[2].split(" ")[0]) for word in ("oscillates at", "a factor of"))
    assert growth == pytest.approx(radius ** (1.0 / (hz * PERIOD)), rel=0.02)
    late = run.qd.values[50:, 0]
    crossings = np.count_nonzero(np.sign(late[1:]) != np.sign(late[:-1]))
    assert hz == pytest.approx(0.5 * crossings / (len(late) * PERIOD), rel=0.1)


@pytest.mark.study
def test_stable_loops_that_are_clipped_are_not_called_unstable():
    """Large steps on stable loops whose drives saturate, with an integrator that winds up."""
    model = arm("cmu-dd")
    goal = np.array([1.5, 0.5, -0.8, 0.8, 0.6, 1.0])
    for controller in (
        aw.JointPID([400, 900, 300, 150, 30, 20], 500.0, [40, 90, 30, 12, 3, 2]),
        aw.ComputedTorque(900.0, 60.0),
    ):
        loop = aw.Loop(controller, goal, 1e-3)
        run = aw.simulate(aw.Scenario(model, 1.5, loop=loop), progress=False)
        assert float(LinearLoop(aw.Scenario(model, 1.5, loop=loop)).radius(goal)) < 1.0
        assert "clipped" in run.attrs["notes"]
        assert SAID not in run.attrs["notes"]


@pytest.mark.study
def test_limit_cycles_and_noise_of_stable_loops_are_not_called_unstable():
    pose = np.array([0.3, 0.2, -0.2, 0.1, 0.3, 0.2])
    scenario = scenario_of("cmu-dd", 3.0, pose, pose)
    assert float(LinearLoop(scenario).radius(pose)) < 1.0
    assert scenario.loop is not None
    for sensors in (aw.Sensors(counts=500), aw.Sensors(position_noise=1e-3, velocity="difference")):
        noisy = replace(scenario, loop=replace(scenario.loop, sensors=sensors))
        assert SAID not in aw.simulate(noisy, progress=False).attrs["notes"]


def test_a_clipped_oscillation_from_the_start_is_called_unstable():
    """A step so large that nothing grows: it is clipped from the first tick on."""
    pose = np.array([0.3, 0.3, 0.3, 0.3, 0.3, 0.3])
    scenario = scenario_of("cmu-dd", 40.0, pose, np.zeros(6))
    notes = aw.simulate(scenario, progress=False).attrs["notes"]
    assert SAID in notes
    assert "a limit of its" in notes


def test_quiet_runs_are_not_analysed():
    """No oscillation, no analysis: a plain run costs no more than a look at its rows."""
    t = np.linspace(0.0, 2.0, 2001)[None, :, None]
    smooth = {"q": np.sin(3.0 * t), "qd": 3.0 * np.cos(3.0 * t), "u": np.full_like(t, 2.0)}
    assert suspicious(smooth) is None
    growing = np.exp(2.0 * t) * 1e-3
    fast = {"q": growing * np.sin(80.0 * t), "qd": 80.0 * growing * np.cos(80.0 * t)}
    assert suspicious(fast) == (0, "")
    assert suspicious({name: each[:, ::-1] for name, each in fast.items()}) is None  # it dies away


def test_a_comparison_names_the_controller_whose_loop_is_unstable():
    pose = np.array([0.3, 0.3])
    scenario = scenario_of("two-link", 1.0, pose, pose)
    controllers = {"calm": aw.ComputedTorque(100.0, 20.0), "wild": aw.ComputedTorque(1e5, 700.0)}
    motions = {"move": aw.trajectories.Quintic(pose, [0.6, 0.1], 0.5)}
    comparison = aw.loops.compare_controllers(scenario, controllers, motions, runs=2, settle=0.2)
    (note,) = comparison.notes
    assert note.startswith(f"wild: {SAID}: ")
    assert "`armwright loops FILE`" in note


def test_tuning_refuses_unstable_gains_with_their_oscillation():
    pose = np.array([0.3, 0.3])
    wild = scenario_of("two-link", 30.0, pose, np.zeros(2))
    with raises_at(ScenarioError, "loop.controller", f"unstable: .*{SAID}: .*armwright loops FILE"):
        aw.tuning.tune(
            wild, lanes=4, margins=aw.tuning.MarginConstraint(poses=20), search=aw.tuning.Search(generations=1)
        )

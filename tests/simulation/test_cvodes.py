"""CVODES as the accurate reference: against SciPy, landing on every change, with the loop that all integrators share."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armwright as aw
from armwright.errors import DivergenceError, ScenarioError
from armwright.simulation.loop.timing import Timing
from armwright.simulation.plant.plant import plant_derivative
from physics.arms import arm
from raises_at import raises_at
from simulation.fields import scenario_of
from simulation.overflow import overflowing_panda
from simulation.test_simulation import motor_alone

PERIOD = 4e-3
START = {"q0": [0.4, 0.4], "qd0": [0.5, 0.5]}


def scipy_states(model, x, changes, times):
    """States at times under commands that change: (from, u) pairs in order."""
    rows, edges = [], [*(t for t, _ in changes), np.inf]
    for (begin, u), end in zip(changes, edges[1:], strict=True):
        inside = [t for t in times if begin < t <= end]
        last = min(end, times[-1])
        solved = solve_ivp(
            lambda t, x, u=u: plant_derivative(model, x, u), (begin, last), x, "DOP853", rtol=1e-13, atol=1e-14,
            t_eval=[*inside, *([last] if last not in inside else [])],
        )  # fmt: skip
        rows += list(solved.y.T[: len(inside)])
        x = solved.y[:, -1]
        if end >= times[-1]:
            return np.array(rows)
    raise AssertionError


def test_a_schedule_that_changes_between_ticks_is_solved_as_scipy_does():
    model = arm("two-link")
    commands = np.array([[90.0, 20.0], [10.0, -5.0], [60.0, 0.0], [0.0, 10.0]])
    times = np.array([0.0, 0.0113, 0.0116, 0.05])
    run = aw.simulate(
        scenario_of(model, command=aw.Schedule(times, commands, tuple(model.names)), duration=0.1, step=2e-3,
                    integrator="cvodes", **START)
    )  # fmt: skip
    changes = list(zip(times.tolist(), commands, strict=True))
    exact = scipy_states(model, np.ravel([START["q0"], START["qd0"]]), changes, run.time.values[1:])
    found = np.hstack([run.q.values, run.qd.values])[1:]
    np.testing.assert_allclose(found, exact, rtol=1e-10, atol=1e-10)
    assert (run.attrs["rtol"], run.attrs["atol"]) == (1e-12, 1e-13)
    assert "steps_tried" not in run


def pd(t, r, y):
    """Torques that follow the reference."""
    return 200.0 * (r.q - y.q) + 20.0 * (r.qd - y.qd)


TIMINGS = {
    "ideal": Timing(),
    "one-tick": Timing("one-tick"),
    "between ticks": Timing("one-tick", measurement_delay=0.75 * PERIOD, command_delay=1.25 * PERIOD),
    "late and lossy": Timing(jitter=0.6 * PERIOD, command_loss=0.2, measurement_loss=0.2),
}


@pytest.mark.sample(1)
@pytest.mark.parametrize("timing", TIMINGS.values(), ids=TIMINGS)
def test_a_controlled_arm_is_what_small_steps_come_to(timing):
    """Same sensors, draws and changes: only the integration differs, and rk4's error is known to vanish."""
    common = {"controller": pd, "reference": [0.6, 0.2], "period": PERIOD, "duration": 20 * PERIOD}
    common |= {"timing": timing, "seed": 3, **START, "vary": {"forearm.mass_kg": aw.Batch([8.0, 10.0, 15.0])}}
    model = arm("two-link")
    exact = aw.simulate(scenario_of(model, integrator="cvodes", **common))
    stepped = aw.simulate(scenario_of(model, integrator="rk4", substeps=16, **common))
    adaptive = aw.simulate(scenario_of(model, integrator="rk45", rtol=1e-12, atol=1e-12, **common))
    for name, gain in {"q": 1, "qd": 1, "q_measured": 1, "u": 200, "u_issued": 200}.items():
        for run in (stepped, adaptive):
            np.testing.assert_allclose(run[name].values, exact[name].values, rtol=1e-9, atol=1e-9 * gain)


PUSHED = aw.Schedule(
    np.array([0.0, 0.0113, 0.0421]), np.array([np.zeros(6), [30.0, -50.0, 0, 0, 0, 4.0], [-40.0, 0, 20.0, 0, 2.0, 0]]),
    ("fx", "fy", "fz", "mx", "my", "mz"),
)  # fmt: skip


@pytest.mark.sample(1)
@pytest.mark.parametrize("timing", TIMINGS.values(), ids=TIMINGS)
def test_a_wrench_under_a_controller_is_what_small_steps_come_to(timing):
    """Held from row to row as commands are, and landed on where it changes within a tick; parameters vary beside it."""
    common = {"controller": pd, "reference": [0.6, 0.2], "period": PERIOD, "duration": 20 * PERIOD}
    common |= {
        "timing": timing,
        "seed": 3,
        **START,
        "vary": {"forearm.mass_kg": aw.Batch([8.0, 15.0])},
        "wrench": PUSHED,
    }
    model = arm("two-link")
    exact = aw.simulate(scenario_of(model, integrator="cvodes", **common))
    stepped = aw.simulate(scenario_of(model, integrator="rk4", substeps=32, **common))
    free = aw.simulate(scenario_of(model, integrator="cvodes", **(common | {"wrench": None})))
    assert np.abs(exact.qd.values - free.qd.values).max() > 0.05
    for name, gain in {"q": 1, "qd": 1, "qdd": 200, "u": 200}.items():
        np.testing.assert_allclose(stepped[name].values, exact[name].values, rtol=1e-9, atol=1e-9 * gain)


def test_parameters_vary_without_a_controller():
    common = {"duration": 0.05, "step": 5e-3, "command": [90.0, 20.0], "wrench": PUSHED, **START}
    varied = {"forearm.mass_kg": aw.Batch([8.0, 15.0])}
    exact = aw.simulate(scenario_of(arm("two-link"), integrator="cvodes", vary=varied, **common))
    stepped = aw.simulate(scenario_of(arm("two-link"), integrator="rk4", vary=varied, **(common | {"step": 2e-4})))
    np.testing.assert_allclose(stepped.qd.values[:, ::25], exact.qd.values, atol=1e-9)
    assert np.abs(np.diff(exact.q.values, axis=0)).max() > 1e-3


def test_a_controller_in_python_runs_with_it():
    def table(t, r, y):
        return np.where(np.asarray(y.q, dtype=float) < 0.5, 1.0, -1.0)

    common = {"controller": table, "period": PERIOD, "duration": 10 * PERIOD, **START}
    exact = aw.simulate(scenario_of(arm("two-link"), integrator="cvodes", **common))
    stepped = aw.simulate(scenario_of(arm("two-link"), integrator="rk4", substeps=8, **common))
    assert exact.attrs["controller"].startswith("called in Python")
    np.testing.assert_allclose(exact.q.values, stepped.q.values, atol=1e-10)


def test_lanes_are_those_of_single_runs():
    commands = np.array([[90.0, 20.0], [0.0, 0.0]])
    common = {"duration": 0.05, "step": 5e-3, "integrator": "cvodes", **START}
    both = aw.simulate(scenario_of(arm("two-link"), command=aw.Batch(commands), **common))
    for lane in range(2):
        one = aw.simulate(scenario_of(arm("two-link"), command=commands[lane], **common))
        np.testing.assert_array_equal(both.q.values[lane], one.q.values)


def test_fewer_rows_are_the_same_rows():
    common = {"duration": 0.06, "step": 5e-3, "integrator": "cvodes", "command": [90.0, 20.0], **START}
    full = aw.simulate(scenario_of(arm("two-link"), **common))
    third = aw.simulate(scenario_of(arm("two-link"), **common, every=3))
    ends = aw.simulate(scenario_of(arm("two-link"), **common, every=0))
    np.testing.assert_array_equal(third.q.values, full.q.values[::3])
    np.testing.assert_array_equal(ends.q.values, full.q.values[[0, -1]])


def test_too_many_lanes_are_refused():
    many = aw.Scenario(
        arm("two-link"), duration=0.1, command=aw.Batch(np.zeros((1001, 2))), solver=aw.Solver(integrator="cvodes")
    )
    with raises_at(ScenarioError, "solver.integrator", "1001 lanes.* 1000, .*'rk45'", value="cvodes"):
        aw.simulate(many)


def test_a_lane_that_has_no_solution_is_marked_and_the_others_go_on(capfd):
    common = {"duration": 0.01, "integrator": "cvodes"}
    far = aw.Batch([[1e308], [0.0]])
    run = aw.simulate(scenario_of(motor_alone(), command=[1.0], q0=far, qd0=far, **common))
    assert run.diverged_at.values[0] == 0.0
    assert np.isnan(run.diverged_at.values[1])
    with pytest.raises(DivergenceError, match=r"diverged .* t = 0 s"):
        aw.simulate(scenario_of(motor_alone(), command=[1.0], q0=[1e308], qd0=[1e308], **common))
    assert capfd.readouterr().err == ""


def falling(arm, solver, **fields):
    return aw.Scenario(arm, duration=0.62, solver=solver, recording=aw.Recording(every=1), **fields)


@pytest.mark.study
def test_the_panda_falls_as_fast_as_it_can():
    """Up to 46 rad/s, where the exponential of its friction overflows if nothing holds it."""
    run = aw.simulate(falling(aw.load("panda"), aw.Solver("cvodes"), command=np.zeros(7)))
    same = aw.simulate(falling(aw.load("panda"), aw.Solver("rk45", rtol=1e-11, atol=1e-12), command=np.zeros(7)))
    assert np.abs(run.qd.values).max() > 45.0
    np.testing.assert_allclose(run.q.values, same.q.values, atol=1e-5)


def test_cvodes_that_gives_up_says_when_and_why(monkeypatch):
    """The Panda falls without torques, its numbers finite: the tick is found within the block that was solved as a whole."""
    with raises_at(DivergenceError, "", r"CVODES gave up at t = 0\.6\d+ s: .*CV_\w+.*'auto'") as caught:
        aw.simulate(falling(overflowing_panda(monkeypatch), aw.Solver("cvodes"), command=np.zeros(7)))
    assert "diverged" not in str(caught.value)


def test_lanes_in_which_cvodes_gives_up_keep_their_rows_until_then(monkeypatch):
    arm = overflowing_panda(monkeypatch)
    falls = {
        "command": aw.Batch([np.zeros(7), np.zeros(7)]),
        "start": aw.Batch([np.zeros(7), [0, 0.5, 0, -1, 0, 1, 0]]),
    }
    run = aw.simulate(falling(arm, aw.Solver("cvodes"), **falls))
    same = aw.simulate(falling(arm, aw.Solver("rk45", rtol=1e-11, atol=1e-12), **falls))
    assert run.diverged_at.isnull().all()
    at = run.stalled_at.values
    assert 0.6 < at[0] < 0.62
    assert np.isnan(at[1])
    assert "CV_" in str(run.stalled_by.values[0])
    assert "CVODES gave up in 1 of 2 lanes" in run.attrs["notes"]
    assert np.ptp(run.q.values[0, :600], axis=0).max() > 1.0
    np.testing.assert_allclose(run.q.values[0, :600], same.q.values[0, :600], atol=1e-5)
    np.testing.assert_allclose(run.q.values[1], same.q.values[1], atol=1e-5)

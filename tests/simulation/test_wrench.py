"""A wrench on the tip: statics, the equation of motion, and rows that are landed on."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armwright as aw
from armwright import scalar
from armwright.errors import ScenarioError
from armwright.simulation.inputs.input_schedule import WRENCH
from physics.arms import arm
from simulation.fields import scenario_of

PERIOD = 1e-3
FORCE = np.array([3.0, -5.0, 0.0, 0.0, 0.0, 1.5])


def zero(t, r, y):
    return 0.0 * y.q


def scenario(**fields):
    common = {"period": PERIOD, "duration": 0.2, "q0": [0.3, -0.5], "initial_command": np.zeros(2)}
    return scenario_of(arm("two-link"), **({"controller": zero, "wrench": FORCE} | common | fields))


def test_the_arm_accelerates_as_the_equation_of_motion_says():
    model, run = arm("two-link"), aw.simulate(scenario())
    for k in (0, 50, 200):
        q, qd = run.q.values[k], run.qd.values[k]
        expected = aw.forward_dynamics(model, q, qd, np.zeros(2), FORCE)
        np.testing.assert_allclose(run.qdd.values[k], expected, rtol=1e-9)
    slope = (run.qd.values[60] - run.qd.values[40]) / (20 * PERIOD)
    np.testing.assert_allclose(slope, run.qdd.values[50], rtol=5e-3)


def test_what_holds_the_wrench_keeps_the_arm_still():
    model, q0 = arm("two-link"), np.array([0.3, -0.5])
    holds = aw.gravity_torques(model, q0) - aw.jacobian(model, q0).T @ FORCE
    run = aw.simulate(scenario(controller=lambda t, r, y: scalar.array(holds)))
    np.testing.assert_allclose(run.q.values, np.broadcast_to(q0, run.q.shape), atol=1e-9)


def test_rows_are_landed_on_inside_a_tick():
    rows = aw.Schedule(np.array([0.0, 0.0503, 0.12]), np.array([np.zeros(6), FORCE, -FORCE]), WRENCH)
    coarse = aw.simulate(scenario(wrench=rows, substeps=4))
    fine = aw.simulate(scenario(wrench=rows, period=1e-4, every=10))
    np.testing.assert_allclose(coarse.q.values, fine.q.values, atol=1e-9)
    np.testing.assert_allclose(coarse.qd.values, fine.qd.values, atol=1e-8)


@pytest.mark.sample(1)
@pytest.mark.parametrize("integrator", ["rk4", "rk45", "rodas3", "cvodes"])
def test_commands_over_time_need_no_controller(integrator):
    """The same loop without a controller: rows of commands and wrench land where they come, whatever the rule."""
    rows = aw.Schedule(np.array([0.0, 0.0503, 0.12]), np.array([np.zeros(6), FORCE, -FORCE]), WRENCH)
    commands = aw.Schedule(
        np.array([0.0, 0.0503, 0.0711]), np.array([[2.0, 1], [-1, 0], [3, 0.5]]), ("shoulder", "elbow")
    )
    common = {"duration": 0.2, "q0": [0.3, -0.5], "integrator": integrator}
    run = aw.simulate(scenario_of(arm("two-link"), command=commands, wrench=rows, step=1e-3, **common))
    fine = scenario_of(arm("two-link"), command=commands, wrench=rows, step=1e-4, every=10, **common)
    tight = {"rk45": 1e-9, "rodas3": 1e-5}.get(integrator, 1e-10)
    np.testing.assert_allclose(run.q.values, aw.simulate(fine).q.values, atol=tight)
    x, model = np.array([0.3, -0.5, 0.0, 0.0]), arm("two-link")
    edges = [0.0, 0.0503, 0.0711, 0.12, 0.2]
    for begin, end in itertools.pairwise(edges):
        u, f = commands.at(begin), rows.at(begin)
        x = solve_ivp(
            lambda t, x, u=u, f=f: np.concatenate([x[2:], aw.forward_dynamics(model, x[:2], x[2:], u, f)]),
            (begin, end), x, "DOP853", rtol=1e-12, atol=1e-13,
        ).y[:, -1]  # fmt: skip
    np.testing.assert_allclose(np.concatenate([run.q.values[-1], run.qd.values[-1]]), x, atol=10 * tight)


def test_lanes_and_python_and_reducers():
    rows = np.stack([FORCE, 0.0 * FORCE, 2.0 * FORCE])
    many = aw.simulate(scenario(wrench=aw.Batch(rows), reduce=["peak_error"]))
    called = aw.simulate(
        scenario(wrench=aw.Batch(rows), controller=lambda t, r, y: np.zeros(np.shape(np.asarray(y.q, dtype=float))))
    )
    assert called.attrs["controller"].startswith("called in Python")
    np.testing.assert_allclose(called.q.values, many.q.values, atol=1e-12)
    for lane in range(3):
        one = aw.simulate(scenario(wrench=rows[lane], vary={"forearm.mass_kg": 4.0}))
        np.testing.assert_allclose(many.q.values[lane], one.q.values, atol=1e-10)


@pytest.mark.parametrize(
    ("fields", "place", "said"),
    [
        ({"wrench": np.zeros(3)}, "inputs.wrench", r"shape \(3,\); .*\(6,\): fx, fy"),
        ({"wrench": np.zeros((3, 6))}, "inputs.wrench", r"shape \(3, 6\); expected \(6,\): .* Batch"),
        (
            {"wrench": aw.Schedule(np.zeros(1), np.zeros((1, 2)), ("a", "b"))},
            "inputs.wrench",
            r"= \['a', 'b'\]: columns .*fx, fy",
        ),
        (
            {"wrench": aw.Batch(np.zeros((3, 6))), "q0": aw.Batch(np.zeros((2, 2)))},
            "start.q",
            r"2 lanes; .*3, as inputs\.wrench has",
        ),
    ],
)
def test_wrenches_that_do_not_fit_are_refused(fields, place, said):
    with pytest.raises(ScenarioError, match=said) as refused:
        scenario(**fields)
    assert refused.value.place == place

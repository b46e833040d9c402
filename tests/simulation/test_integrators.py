"""Rules of fixed step: the order that each claims, and the growth of modes that stability is judged by."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armwright as aw
from armwright.errors import ScenarioError
from armwright.simulation.integrate.integrators import INTEGRATORS, semi_implicit_euler_step
from armwright.simulation.loop.compiled import compile_loop
from armwright.simulation.plant.step_limits import StepLimit
from physics.arms import arm
from raises_at import raises_at
from simulation.fields import scenario_of
from simulation.plants import ELASTIC, LUGRE, MOTOR, ON_MOTOR, chain

VISCOUS = {"viscous_n_m_s_per_rad": 0.8}


def pendulum(x, u):
    """A damped one that u pushes: smooth, and without a closed form."""
    return np.array([x[1], u[0] - np.sin(x[0]) - 0.1 * x[1]])


@pytest.mark.parametrize("name", INTEGRATORS)
def test_each_rule_has_its_order(name):
    """Halving the step divides the error by 2^p."""
    rule, u, start = INTEGRATORS[name], np.array([0.3]), np.array([1.0, -0.5])
    exact = solve_ivp(lambda t, x: pendulum(x, u), (0, 2), start, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    errors = []
    for steps in (64, 128, 256):
        x = start
        for _ in range(steps):
            x = rule.step(pendulum, x, u, 2.0 / steps)
        errors.append(np.abs(np.asarray(x, dtype=float) - exact).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - rule.order) < 0.15), (orders, errors)


@pytest.mark.parametrize("name", INTEGRATORS)
def test_growth_is_that_of_a_step(name):
    """|eigenvalues| of one step of a damped oscillator whose poles are z and z̄."""
    rule = INTEGRATORS[name]
    for z in (-0.3 + 0.4j, 0.7j, -0.8 + 0.0j, 0.1 + 0.5j, -2.2 + 0.1j):
        matrix = np.array([[0.0, 1.0], [-(abs(z) ** 2), 2 * z.real]])
        columns = [rule.step(lambda x, u, a=matrix: a @ x, e, np.zeros(0), 1.0) for e in np.eye(2)]
        radius = np.abs(np.linalg.eigvals(np.array(columns, dtype=float).T)).max()
        assert rule.growth(np.array([z]))[0] == pytest.approx(radius, rel=1e-6)


@pytest.mark.parametrize("name", INTEGRATORS)
def test_a_rule_asks_for_the_derivative_as_often_as_it_says(name):
    asked = []
    INTEGRATORS[name].step(lambda x, u: asked.append(1) or pendulum(x, u), np.ones(2), np.zeros(1), 0.1)
    assert len(asked) == INTEGRATORS[name].stages


def test_semi_implicit_euler_moves_positions_by_their_new_speeds_wherever_these_stand():
    x, h = np.array([1.0, 2.0, 3.0, 4.0, 5.0]), 0.1  # q₁, q₂, q̇₁, a current, q̇₂
    f = lambda x, u: np.array([x[2], x[4], -x[0], -x[3], -x[1]])  # noqa: E731
    rule = INTEGRATORS["semi_implicit_euler"].paired([(0, 2), (1, 4)])
    v1, v2 = 3.0 - h * 1.0, 5.0 - h * 2.0
    np.testing.assert_allclose(
        np.asarray(rule.step(f, x, np.zeros(0), h), float), [1 + h * v1, 2 + h * v2, v1, 4 - h * 4, v2]
    )


@pytest.mark.study
def test_semi_implicit_euler_keeps_the_energy_of_an_oscillator():
    """Its error swings and does not grow: over 1000 periods the amplitude stays within h ω / 2 of what it was."""
    x, h = np.array([1.0, 0.0]), 0.05
    energies = []
    for _ in range(int(2000 * np.pi / h)):
        x = semi_implicit_euler_step(lambda x, u: np.array([x[1], -x[0]]), x, np.zeros(0), h)
        energies.append(0.5 * float(x[0] ** 2 + x[1] ** 2))
    assert np.abs(np.array(energies) - 0.5).max() < 0.5 * h


@pytest.mark.parametrize("name", ["rk4", "semi_implicit_euler"])
def test_a_whole_arm_converges_with_the_order_of_the_rule(name):
    model = arm("two-link")
    loop = compile_loop(model, name)
    common = {"duration": 0.064, "command": [90.0, 20.0], "q0": [0.4, 0.4], "qd0": [0.5, 0.5], "every": 0}
    exact = aw.simulate(scenario_of(model, **common, integrator="cvodes", step=8e-3))
    steps = (8e-3, 4e-3, 2e-3)
    runs = [aw.simulate(scenario_of(model, **common, integrator=name, step=h), loop=loop) for h in steps]
    errors = [np.abs(run.qd.values[-1] - exact.qd.values[-1]).max() for run in runs]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - INTEGRATORS[name].order) < 0.25), (orders, errors)


def test_the_largest_step_follows_the_rule():
    """A longer stretch of the negative axis is stable under rk4 than under rk3, a shorter one under the semi-implicit rule."""
    model = arm("cmu-dd")
    stability, u = StepLimit(model), np.zeros(model.n)
    steps = {name: stability.largest_step(rule, u) for name, rule in INTEGRATORS.items()}
    assert steps["semi_implicit_euler"] < steps["rk3"] < steps["rk4"]
    with raises_at(ScenarioError, "step", "rk4 .*[0-9.e-]+ s; or"):
        stability.check_step("rk4", INTEGRATORS["rk4"], 1.01 * steps["rk4"], u[None])


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"integrator": "rk5"}, "unknown; .*'rk45'|integrator = 'rk5': unknown"),
        ({"rtol": 1e-6}, "rtol = 1e-06: .*'rk45', 'rodas3' or 'cvodes', not 'rk3'"),
        ({"integrator": "rk45", "rtol": 0.0}, "solver.rtol = 0.0: .*1e-14 and below 1"),
        ({"integrator": "rk45", "atol": "x"}, "solver.atol = 'x'"),
        ({"integrator": "rk45", "max_substeps": 0}, "max_substeps = 0"),
        (
            {"integrator": "cvodes", "max_substeps": 10},
            "max_substeps = 10: .*'auto', 'rk45' or 'rodas3', not 'cvodes'",
        ),
        ({"events": {"up": lambda t, x: x.q[0]}}, "events: .*'rk45' or 'rodas3', not 'rk3'"),
        ({"integrator": "rk45", "events": [1]}, "expected functions"),
    ],
)
def test_what_does_not_fit_an_integrator_is_refused(fields, said):
    with pytest.raises(ScenarioError, match=said):
        scenario_of(arm("two-link"), command=[0.0, 0.0], duration=0.1, **fields)


STIFF = {  # drives whose fast parts are integrated exactly, each with a step that shows the order
    "winding": ({"motor": {**MOTOR, "inductance_h": 2e-3}, "friction": VISCOUS}, 2e-3),
    "bristles": ({"motor": MOTOR, "friction": LUGRE}, 4e-3),
    "both": ({"motor": {**MOTOR, "inductance_h": 5e-3}, "friction": LUGRE}, 2e-3),
    "bristles of the motor, behind a spring": ({"motor": MOTOR, "friction": ON_MOTOR, "elasticity": ELASTIC}, 1e-3),
    "current loop": ({"command": "torque", "motor": {**MOTOR, "inductance_h": 1e-3, "current_loop_hz": 60.0}}, 2e-3),
}


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("drive", STIFF)
def test_fast_parts_that_are_integrated_exactly_leave_the_rule_its_order(drive, name):
    """Against CVODES at 1e-12: bristles of a joint that begins to slide, whose rate changes a hundredfold, and windings."""
    (joint, step), order = STIFF[drive], INTEGRATORS[name].order
    model = chain([{"command": "voltage", **joint}])
    common = {"duration": 0.064, "command": [9.0], "q0": [0.3], "qd0": [0.02], "every": 0, "what": "state"}
    exact = aw.simulate(scenario_of(model, **common, integrator="cvodes", step=step))
    loop, errors = compile_loop(model, name), []
    for h in (step / 2**k for k in range(2, 6)):
        run = aw.simulate(scenario_of(model, **common, integrator=name, step=h), loop=loop)
        errors.append(max(np.abs(run[each].values[-1] - exact[each].values[-1]).max() for each in ("q", "qd")))
    seen = [error for error in errors if error > 5e-11]  # CVODES' own is near
    assert len(seen) >= 2
    assert order - 0.3 < np.log2(seen[0] / seen[-1]) / (len(seen) - 1) < order + 1.1, errors

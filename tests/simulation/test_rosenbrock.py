"""The rule for stiff systems: order conditions, stability, stiff test problems; and the slopes of plants that it takes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armwright as aw
from armwright.model.vary import Varied
from armwright.program import call, trace
from armwright.simulation.integrate import rosenbrock
from armwright.simulation.integrate.dormand_prince import along
from armwright.simulation.integrate.rosenbrock import GAMMA, as_program, hermite_path, rodas3_step
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.slopes import plant_slopes
from physics.arms import arm as arm_of
from simulation.fields import slopes_of
from simulation.plants import BRAKE, COULOMB, ELASTIC, MANY, MOTOR, STOPS, exact, pendulum
from simulation.test_mimics import elastic_gripper

NO_INPUT = np.zeros(1)
CONTACTS = {
    "stops": pendulum(motor=MOTOR, friction=COULOMB, stops=STOPS, limits={"position_rad": [-0.5, 0.5]}),
    "backlash": pendulum(motor=MOTOR, friction=COULOMB, elasticity={**ELASTIC, "backlash_rad": 0.01}),
    "brake": pendulum(motor=MOTOR, friction=COULOMB, brake=BRAKE),
}
ARMS = ("cmu-dd", "puma560", "lwa4p", "panda", "gripper", "workshop", "sprung")
PLANTS = {**MANY, **CONTACTS, "elastic gripper": elastic_gripper(), **{name: arm_of(name) for name in ARMS}}


def classical():
    """α, β = α + Γ, b and b̂ of the classical form, from the numbers of the transformed one.  [HairerWanner1996], IV.7"""
    a, c = np.zeros((4, 4)), np.zeros((4, 4))
    for i, (places, weights) in enumerate(rosenbrock.STAGES):
        a[i, :i], c[i, :i] = places, weights
    gamma = np.linalg.inv(np.eye(4) / GAMMA - c)
    end, error = np.array(rosenbrock.END), np.array(rosenbrock.ERROR)
    return a @ gamma, a @ gamma + gamma, end @ gamma, (end - error) @ gamma


def test_the_numbers_fulfil_the_conditions_of_order_three_and_two():
    alpha, beta, b, lower = classical()
    rows, full = alpha.sum(axis=1), beta.sum(axis=1)
    conditions = (b.sum(), b @ full, b @ rows**2, b @ beta @ full)
    np.testing.assert_allclose(conditions, (1.0, 1 / 2, 1 / 3, 1 / 6), atol=1e-14)
    np.testing.assert_allclose((lower.sum(), lower @ full), (1.0, 1 / 2), atol=1e-14)
    np.testing.assert_allclose(beta[-1], b, atol=1e-14)  # stiffly accurate


def test_it_is_stable_everywhere_on_the_left_and_forgets_what_is_infinitely_fast():
    _, beta, b, lower = classical()

    def growth(z, weights):
        return 1.0 + z * weights @ np.linalg.solve(np.eye(4) - z * beta, np.ones(4))

    axis = [abs(growth(1j * y, b)) for y in np.geomspace(1e-3, 1e6, 300)]
    assert max(axis) <= 1.0 + 1e-12  # and by the maximum principle on all of the left half: its poles are at 1/γ
    assert abs(growth(-1e9, b)) < 1e-8
    assert abs(growth(-1e9, lower)) < 1e-8  # the estimate is as good there


def steps(f, x, h, count, u=NO_INPUT):
    """The states (count + 1, nx) of equal steps, slopes by algorithmic differentiation."""
    size = len(x)
    step = trace(
        "step", lambda x, u: rodas3_step(slopes_of(f), f, x, u, h), {"x": (size,), "u": (len(u),)}, ("x_next", "e")
    )
    states = [np.asarray(x, dtype=float)]
    for _ in range(count):
        states.append(np.asarray(step.graph(states[-1], u)[0]).ravel())
    return np.array(states)


def swinging(x, u):
    return aw.scalar.array([x[1], u[0] - aw.scalar.sin(x[0]) - 0.1 * x[1]])


def test_a_smooth_motion_is_followed_to_order_three():
    u, start = np.array([0.3]), np.array([1.0, -0.5])
    truth = solve_ivp(
        lambda t, x: [x[1], u[0] - np.sin(x[0]) - 0.1 * x[1]], (0, 2), start, "DOP853", rtol=1e-13, atol=1e-14
    )
    errors = [np.abs(steps(swinging, start, 2.0 / n, n, u)[-1] - truth.y[:, -1]).max() for n in (32, 64, 128, 256)]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 3.0, atol=0.1)


def test_the_estimate_is_the_error_of_order_two_and_the_path_has_order_three():
    u, start, estimates, middles = np.array([0.3]), np.array([1.0, -0.5]), [], []
    step = trace(
        "s", lambda x, h: rodas3_step(slopes_of(swinging), swinging, x, u, h), {"x": (2,), "h": ()}, ("n", "e")
    )
    for h in (0.2, 0.1, 0.05):
        new, error = (np.asarray(value).ravel() for value in step.graph(start, h))
        estimates.append(np.abs(error).max())
        path = hermite_path(start, new, swinging(start, u), swinging(new, u), h)
        np.testing.assert_allclose(np.asarray(along(start, path, 1.0), float), new, atol=1e-15)
        truth = solve_ivp(lambda t, x: swinging(x, u), (0, 0.37 * h), start, "DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
        middles.append(np.abs(np.asarray(along(start, path, 0.37), float) - truth).max())
    np.testing.assert_allclose(np.log2(np.array(estimates[:-1]) / estimates[1:]), 3.0, atol=0.3)
    assert np.all(np.log2(np.array(middles[:-1]) / middles[1:]) > 3.5), middles  # one step: an order more


def test_a_fast_part_is_gone_after_one_step():
    """x' = -10⁶ x over a second: |R(z)| → 0, where rules of one implicit stage leave the whole of it."""
    assert abs(steps(lambda x, u: aw.scalar.array([-1e6 * x[0]]), [1.0], 1.0, 1)[-1, 0]) < 1e-5


@pytest.mark.parametrize(("rate", "allowed", "order"), [(-1e2, 1e-4, 1.8), (-1e6, 1e-7, 0.9)])
def test_prothero_and_robinsons_problem(rate, allowed, order):
    """x' = λ (x - cos t) - sin t along its slow solution cos t: the error goes with h / λ where h λ is large."""

    def f(x, u):
        return aw.scalar.array([rate * (x[0] - aw.scalar.cos(x[1])) - aw.scalar.sin(x[1]), 1.0])

    errors = [abs(steps(f, [1.0, 0.0], 1.0 / n, n)[-1, 0] - np.cos(1.0)) for n in (10, 20, 40)]
    assert errors[0] < allowed
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > order), errors


def differences(f, x):
    """∂f/∂x by central differences."""
    columns = []
    for k in range(len(x)):
        step = np.zeros(len(x))
        step[k] = 1e-6 * max(1e-2, abs(x[k]))
        columns.append((f(x + step) - f(x - step)) / (2.0 * step[k]))
    return np.array(columns).T


def outer_inputs(plant):
    """Shapes of what acts on a plant beside its commands, where it can."""
    shapes = {"brake": (len(plant.braked),)} if plant.brakes else {}
    shapes |= {"contacts": (sum(plant.contacts),)} if any(plant.contacts) else {}
    return shapes | ({"wrench": (6,)} if plant.model.n > 2 else {})


@pytest.mark.sample(10)
@pytest.mark.parametrize("name", PLANTS)
def test_slopes_of_plants_are_those_of_their_derivative(name):
    """Against central differences: every effect, contacts held, brakes, wrenches, at random states and at rest."""
    arm = PLANTS[name]
    plant = Plant.of(arm, brakes=True)
    others = outer_inputs(plant)
    shapes = {"x": (plant.size,), "u": (arm.n,), **others}

    def inputs(u, rest):
        return PlantInputs.named(u, dict(zip(others, rest, strict=True)))

    slopes = as_program(lambda x, u, *rest: plant_slopes(plant, x, inputs(u, rest)), shapes)
    program = trace("slopes", slopes, shapes, ("xd", "slope", "mass"))
    derivative = trace("xd", lambda x, u, *rest: plant.derivative(x, inputs(u, rest)), shapes).graph
    rng = np.random.default_rng(3)
    rest = plant.initial(np.full(arm.n, 0.1), np.zeros(arm.n))
    for moved in (0.0, 0.1, 0.1):
        x = rest + moved * rng.normal(size=plant.size) * np.maximum(np.abs(rest), 0.05)
        u = rng.normal(size=arm.n) * 5.0
        given = [
            rng.integers(0, 2, size=shape) if key != "wrench" else rng.normal(size=6) for key, shape in others.items()
        ]
        f = lambda x, u=u, given=given: np.asarray(derivative(x, u, *given)).ravel()  # noqa: E731
        rate, slope, mass = (np.asarray(value).ravel() for value in program.graph(x, u, *given))
        np.testing.assert_allclose(rate, f(x), rtol=1e-12, atol=1e-12 * np.abs(rate).max())
        solved = np.linalg.solve(mass.reshape(plant.size, -1), slope.reshape(plant.size, -1))
        assert np.isfinite(solved).all()
        if moved:
            expected = differences(f, x)
            assert np.abs(solved - expected).max() < 2e-6 * np.abs(expected).max()


def test_slopes_of_a_varied_arm_are_those_of_the_arm_with_these_numbers():
    """The mass of a link, its joint's stiffness and an inductance, which stand in both matrices."""
    arm = MANY["all"]
    varied = Varied(arm, ("rod1.mass_kg", "joint0.elasticity.stiffness_n_m_per_rad", "joint0.motor.inductance_h"))
    size = Plant.of(arm).size
    shapes = {"x": (size,), "u": (arm.n,), "p": (3,)}
    slopes = as_program(lambda x, u, p: plant_slopes(Plant.of(varied.model(p)), x, PlantInputs(u)), shapes)
    open_ones = trace("slopes", slopes, shapes, ("xd", "slope", "mass")).graph
    values = varied.nominal * (1.3, 0.6, 1.7)
    plant = Plant.of(varied.model(values))
    fixed = trace("s", lambda x, u: plant_slopes(plant, x, PlantInputs(u)), {"x": (size,), "u": (2,)}, ("a", "b", "c"))
    x, u = plant.initial([0.1, 0.2], [0.3, -0.2]), [4.0, 2.0]
    for value, expected in zip(open_ones(x, u, values), fixed.graph(x, u), strict=True):
        np.testing.assert_allclose(np.asarray(value), np.asarray(expected), rtol=1e-11, atol=1e-9)


def after_equal_steps(model, h, count, u, x0):
    """The state of an arm after `count` steps of h seconds."""
    plant = Plant.of(model)
    shapes = {"x": (plant.size,), "u": (model.n,)}
    slopes = as_program(lambda x, u: plant_slopes(plant, x, PlantInputs(u)), shapes)
    whole = trace("plant", plant.derivative, shapes, ("xd",), noinline=True)
    step = trace("step", lambda x, u: rodas3_step(slopes, lambda x, u: call(whole, x, u), x, u, h)[0], shapes)
    run = step.graph.mapaccum("run", count)
    return np.asarray(run(x0, np.tile(np.reshape(u, (-1, 1)), count)))[:, -1]


def test_an_arm_with_motors_is_followed_to_order_three():
    """`cmu-dd` with time constants of 15 ms, and a pendulum behind an elastic gear; the truth by SciPy at 1e-13."""
    for model, u, steps_of in (
        (aw.load("cmu-dd"), [8, 12, 8, 4, 2, 1], (10, 20, 40)),
        (MANY["elastic"], [9.0], (80, 160, 320)),
    ):
        plant = Plant.of(model)
        x0 = plant.initial(np.full(model.n, 0.2), np.full(model.n, 0.1))
        truth = exact(plant, x0, u, 0.08)
        errors = [np.abs(after_equal_steps(model, 0.08 / n, n, u, x0) - truth).max() for n in steps_of]
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        assert 2.7 < orders[-1] < 3.5, (errors, orders)

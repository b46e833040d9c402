"""Efficiency tables and load-proportional friction: against formulas by hand, as an identity, their slopes and their energy."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import armwright as aw
from armwright.dynamics import (
    articulated_body,
    forward_dynamics,
    forward_dynamics_derivatives,
    gears,
    inverse_dynamics,
    inverse_dynamics_derivatives,
    mass_matrix,
)
from armwright.errors import ModelError
from armwright.model import Friction, Model
from dynamics.gear_tables import LINEAR_TABLE, ROWS, TABLE, TORQUES, efficiencies, lift, worn
from dynamics.test_gears import coupled, states
from physics.arms import arm
from raises_at import raises_at
from simulation.energies import Balance
from simulation.plants import COULOMB, MOTOR, pendulum

SPINDLE = {  # the same numbers at a slide
    "force_n": list(TORQUES),
    "rows": [
        {("speed_m_per_s" if key == "speed_rad_per_s" else key): value for key, value in row.items()} for row in ROWS
    ],
}
MASS, WEIGHT, ROTATING = 0.3, 6.0, 0.1

# --- one joint, case by case --------------------------------------------------------------------------------------------------


def by_table(w: float, t: float) -> float:
    """T for t, at speeds far above the smoothing: knots t = T/η driving and T η driven back, and straight lines."""
    driving = t * w >= 0.0
    eta = np.array(efficiencies(w, "driving" if driving else "driven_back"))
    out = np.array(TORQUES)
    into = out / eta if driving else out * eta
    size = abs(t)
    if size <= into[0]:
        leaving = size * out[0] / into[0]
    elif size >= into[-1]:
        leaving = size * out[-1] / into[-1]
    else:
        leaving = np.interp(size, into, out)
    return float(np.copysign(leaving, t))


def by_load(share: float, w: float, torque: float) -> float:
    """Torque behind friction of that share of it."""
    return torque - share * abs(torque) * np.sign(w)


def acceleration(of_gear, w: float, force: float) -> float:
    """a of  m a = G(F - D a) - W  by bisection: both sides are monotone in a."""
    lack = lambda a: of_gear(force - ROTATING * a) - WEIGHT - MASS * a  # noqa: E731
    return brentq(lack, -1e4, 1e4, xtol=1e-13, rtol=1e-14)


@pytest.mark.sample(9)
@pytest.mark.parametrize("force", [-90.0, -20.0, -4.0, 2.0, 9.0, 30.0, 45.0, 200.0])
@pytest.mark.parametrize("w", [0.05, 0.9, 7.0, -0.05, -0.9, -7.0])
@pytest.mark.parametrize(("share", "side"), [(None, "joint"), (0.3, "joint"), (0.3, "motor")])
def test_one_joint_by_table(w, force, share, side):
    """q̈ of a load that is driven or drives, below, within and beyond the table; and the force that this q̈ takes."""
    model = with_load(lift({"gear_efficiency_table": SPINDLE}), share, side)

    def of_gear(t: float) -> float:
        if share is None:
            return by_table(w, t)
        if side == "joint":
            return by_load(share, w, by_table(w, t))
        return by_table(w, t / (1.0 + share * np.sign(w * t)))  # x + share |x| sgn w = t

    check(model, w, force, acceleration(of_gear, w, force))


@pytest.mark.parametrize("force", [-20.0, 2.0, 9.0, 30.0])
@pytest.mark.parametrize("w", [0.9, -0.9])
@pytest.mark.parametrize("side", ["joint", "motor"])
def test_one_joint_by_load_alone(w, force, side):
    """A gear without an efficiency: what its friction leaves is 1 - c or 1 + c times what enters, or the inverse of these."""
    c = 0.3
    model = with_load(lift({}), c, side)

    def of_gear(t: float) -> float:
        sign = np.sign(w * t)
        return t * (1.0 - c * sign) if side == "joint" else t / (1.0 + c * sign)

    check(model, w, force, acceleration(of_gear, w, force))


def test_a_table_with_one_efficiency_is_that_efficiency():
    """Of any number of knots and speeds, driven back by default as driving."""
    rows = [{"speed_m_per_s": speed, "driving": [0.6] * 3} for speed in (0.0, 1.0)]
    table = {"force_n": [1.0, 5.0, 20.0], "rows": rows}
    one, many = lift({"gear_efficiency": 0.6}), lift({"gear_efficiency_table": table})
    speed_only = lift({"gear_efficiency_table": {"force_n": [3.0], "rows": [{"driving": [0.6]}]}})
    for force in (-9.0, 2.0, 30.0):
        given = np.zeros(1), np.array([0.4]), np.array([force])
        for model in (many, speed_only):
            np.testing.assert_allclose(forward_dynamics(model, *given), forward_dynamics(one, *given), rtol=1e-12)


@pytest.mark.parametrize(("side", "share"), [("motor", 0.25), ("joint", 0.2)])
def test_no_load_torque_and_proportional_loss_of_a_datasheet(side, share):
    """T_in = T₀ + (1 + a) T_out with a = 0.25, as the page on drives reads it; T₀ = 3 N at the slide, 0.06 N m at the motor."""
    of_motor = {
        "side": "motor",
        "coulomb_positive_n_m": 0.06,
        "coulomb_negative_n_m": 0.06,
        "smoothing_rad_per_s": 1e-6,
    }
    of_joint = {"coulomb_positive_n": 3.0, "coulomb_negative_n": 3.0, "smoothing_m_per_s": 1e-7}
    friction = {**(of_motor if side == "motor" else of_joint), "load_coefficient": share}
    model = lift({}, friction=friction)
    out = WEIGHT + (0.0 if side == "motor" else 3.0)  # the joint's own dry friction is a load of the gear
    (into,) = inverse_dynamics(model, np.zeros(1), np.array([0.4]), np.zeros(1))
    assert into == pytest.approx(1.25 * out + (3.0 if side == "motor" else 0.0), rel=1e-9)


def with_load(model: Model, share: float | None, side: str) -> Model:
    """The arm with load-proportional friction on a side of its gears."""
    if share is None:
        return model
    bodies = []
    for body in model.bodies:
        friction = replace(body.friction or Friction(smoothing=0.05), load_coefficient=share, on_motor=side == "motor")
        drive = replace(
            body.drive, smoothing=friction.smoothing if body.drive.smoothing is None else body.drive.smoothing
        )
        bodies.append(replace(body, friction=friction, drive=drive))
    return replace(model, bodies=tuple(bodies))


def check(model: Model, w: float, force: float, expected: float) -> None:
    """Forward dynamics against that acceleration, and inverse dynamics back."""
    a = forward_dynamics(model, np.zeros(1), np.array([w]), np.array([force]))
    assert a[0] == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert inverse_dynamics(model, np.zeros(1), np.array([w]), a) == pytest.approx(force, rel=1e-9)


# --- arms ----------------------------------------------------------------------------------------------------------------------


def heavy() -> Model:
    """Panda with tables in all gears, friction by load on the motors' side, and rotors that outweigh its links by far."""
    table = worn().bodies[0].drive.efficiency
    bodies = []
    for body in arm("panda").bodies:
        drive = replace(body.drive, efficiency=table, smoothing=0.05, rotor_inertia=20.0 / body.drive.gear_ratio**2)
        bodies.append(replace(body, drive=drive))
    return with_load(replace(arm("panda"), bodies=tuple(bodies)), 0.3, "motor")


ARMS = {"worn": worn(), "coupled": coupled(worn(), 0.6), "heavy": heavy()}


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ARMS)
def test_forward_of_inverse_is_identity(name):
    """q̈ → tau → q̈ of compiled kernels, within 1e-10 of what the torques at play can make of it."""
    model = ARMS[name]
    kernels = aw.compile(model)
    q, qd, qdd = states(model, 20_000)
    tau = kernels.inverse_dynamics(q, qd, qdd)
    back = kernels.forward_dynamics(q, qd, tau)
    parts = kernels.inverse_dynamics(q, qd, 0.0 * qdd)
    inverse = np.linalg.inv(kernels.mass_matrix(q))
    size = np.abs(qdd).max(1) + np.einsum("kij,kj->ki", np.abs(inverse), np.abs(parts)).max(1)
    assert (np.abs(back - qdd).max(1) <= 1e-10 * size).all()


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["worn", "heavy"])
def test_one_solution_from_any_start_in_few_solves(name):
    """Newton's method ends at the same accelerations wherever it begins, in at most 12 solves."""
    model, counts, rng = ARMS[name], Counter(), np.random.default_rng(3)
    for row in zip(*states(model, 12), strict=True):
        tau = inverse_dynamics(model, *row) + rng.normal(size=model.n) * 10 ** rng.uniform(-2, 2)
        bare, driven, cases = gears.motors(model, row[1], tau)
        mass = mass_matrix(bare, row[0])
        plain = bare.replace(efficiency=None, friction=None)
        bias = inverse_dynamics(plain, row[0], row[1], np.zeros(model.n)) - driven
        first, _ = gears.through_gears(mass, bias, cases)
        for start in rng.normal(size=(2, model.n)) * 10 ** rng.uniform(0, 5, (2, 1)):
            state, steps = np.array([*start, 0.0]), 0
            while True:
                after, steps = gears._newton_step(state[:-1], state[-1], mass, bias, cases), steps + 1
                if np.array_equal(after, state):
                    break
                state = after
            counts[steps] += 1
            close = {"rtol": 1e-8, "atol": 1e-8 * np.abs(first).max()}
            np.testing.assert_allclose(
                np.linalg.solve(*gears.linearised(mass, bias, cases, state[:-1])), first, **close
            )
    assert max(counts) <= gears.MOST


@pytest.mark.sample(4)
@pytest.mark.parametrize("speed", [0.0, 0.02, -0.02, 0.7])
@pytest.mark.parametrize("name", ["worn", "coupled"])
def test_slopes_on_both_sides_of_rest(name, speed):
    """Of inverse and forward dynamics against differences; at rest against those towards positive motion."""
    model, n, h = ARMS[name], ARMS[name].n, 1e-7
    q, qd, qdd = np.linspace(-1.0, 1.0, n), np.full(n, speed), np.linspace(3.0, -2.0, n)
    tau = inverse_dynamics(model, q, qd, qdd)
    ahead, behind = (h, 0.0) if speed == 0.0 else (h, -h)

    def differences(function):
        return np.stack([(function(ahead * e) - function(behind * e)) / (ahead - behind) for e in np.eye(n)], axis=1)

    _, by_qd, by_qdd = inverse_dynamics_derivatives(model, q, qd, qdd)
    close = {"rtol": 0.0, "atol": 2e-4 * np.abs(by_qd).max()}
    np.testing.assert_allclose(by_qd, differences(lambda d: inverse_dynamics(model, q, qd + d, qdd)), **close)
    _, by_speed, by_tau = forward_dynamics_derivatives(model, q, qd, tau)
    close["atol"] = 2e-4 * np.abs(by_speed).max()
    np.testing.assert_allclose(by_speed, differences(lambda d: forward_dynamics(model, q, qd + d, tau)), **close)
    np.testing.assert_allclose(by_tau @ by_qdd, np.eye(n), rtol=0.0, atol=1e-9)


def test_articulated_bodies_refuse_friction_by_load():
    with raises_at(ModelError, "articulated_body", "gears with loss", value="lift"):
        articulated_body(with_load(lift({}), 0.2, "joint"), np.zeros(1), np.zeros(1), np.zeros(1))


# --- the plant -----------------------------------------------------------------------------------------------------------------

FAR = {
    "stiffness_n_m_per_rad": 1e4,
    "damping_n_m_s_per_rad": 1.0,
}  # stops that are never met: steps then end where G bends
BOOKS = {
    "table": pendulum(motor={**MOTOR, "gear_efficiency_table": TABLE}, friction={**COULOMB, "load_coefficient": 0.2},
                      stops=FAR, limits={"position_rad": [-9.0, 9.0]}),
    "elastic": pendulum(motor={**MOTOR, "gear_efficiency_table": TABLE}, friction={**COULOMB, "load_coefficient": 0.2},
                        elasticity={"stiffness_n_m_per_rad": 4e3, "damping_n_m_s_per_rad": 6.0}),
    "load alone": pendulum(motor=MOTOR, friction={**COULOMB, "load_coefficient": 0.2}),
}  # fmt: skip


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", BOOKS)
def test_power_balances(name):
    assert Balance(BOOKS[name]).lack([0.3], [0.5], [12.0], 1e-4, 0.1) < 1e-6


@pytest.mark.study
def test_the_book_of_a_table_closes_where_steps_end_at_its_knots():
    """Loss integrated as (t - G(t)) w closes the book to 1e-9."""
    forces = np.array([[14.0], [1.0], [-6.0], [9.0]]).repeat(50, axis=0)
    lacks = []
    for k in (1, 4):
        balance = Balance(BOOKS["table"], "rk4")
        begun = balance.plant.initial([0.3], [0.5])
        lacks.append(balance.lacking(begun, *balance.moved(begun, forces.repeat(k, axis=0), 1e-3 / k)))
    assert lacks[0] < 1e-6
    assert lacks[1] < 1e-9


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["table", "load alone"])
def test_the_plant_moves_as_forward_arm(name):
    """A rigid gear in the plant: its accelerations are those of the compiled function."""
    model = BOOKS[name]
    plant, u = Balance(model).plant, np.array([9.0])
    for q, qd in ((0.3, 0.5), (0.3, -0.5), (-1.0, 0.01)):
        expected = aw.compile(model).forward_arm(np.array([q]), np.array([qd]), u)
        found = plant.derivative(plant.initial([q], [qd]), u)[1]
        assert found == pytest.approx(expected[0], rel=1e-12)


def test_a_slide_with_its_table():
    """Force tables on a slide, in forward dynamics and its inverse."""
    model = lift({"gear_efficiency_table": LINEAR_TABLE})
    a = forward_dynamics(model, np.zeros(1), np.array([0.4]), np.array([200.0]))
    assert a[0] == pytest.approx((0.75 * 200.0 - WEIGHT) / (MASS + 0.75 * ROTATING), rel=1e-9)

"""Lossy gears between rotor and link: against a reference by hand, as an identity, and from several starts."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armwright as aw
from armwright.description.database import parse
from armwright.dynamics import (
    forward_arm_linearised,
    forward_dynamics,
    forward_dynamics_derivatives,
    gears,
    inverse_dynamics,
    inverse_dynamics_derivatives,
    mass_matrix,
)
from armwright.model import Model, build_model
from armwright.program import interpret, trace
from armwright.program.derivative import derivative
from armwright.simulation.plant.plant import Plant
from physics.arms import arm
from reference.random_trees import random_description
from simulation.energies import Balance, energy_rates

ETA, RATIO, ROTOR = 0.6, 50.0, 4e-5
ROTATING = RATIO**2 * ROTOR  # n² J_m [kg]
MASS, WEIGHT = 0.3, 6.0  # of the load [kg], and what pulls it down [N]


def lossy(model: Model, efficiency: float, inertia: float, smoothing: float = 0.05) -> Model:
    """The arm with gears that lose, before rotors of n² J_m = `inertia`."""
    bodies = []
    for body in model.bodies:
        rotor = inertia / body.drive.gear_ratio**2
        drive = replace(body.drive, efficiency=efficiency, smoothing=smoothing, rotor_inertia=rotor)
        bodies.append(replace(body, drive=drive))
    return replace(model, bodies=tuple(bodies))


def coupled(model: Model, share: float) -> Model:
    """The arm whose last motor the joint before it turns as well."""
    *others, last = model.bodies
    drive = replace(last.drive, coupling=((others[-1].joint, share * last.drive.gear_ratio),))
    return replace(model, bodies=(*others, replace(last, drive=drive)))


# --- one joint that drives a load up and is driven down ---------------------------------------------------------------------


def lift(smoothing: float, **joint: Any) -> Model:
    """A load on a vertical spindle, pulled down by WEIGHT wherever it is."""
    motor = {"gear_ratio": RATIO, "rotor_inertia_kg_m2": ROTOR, "gear_efficiency": ETA}
    friction = {"viscous_n_s_per_m": 0.0, "smoothing_m_per_s": smoothing}
    slide = {"name": "spindle", "type": "prismatic", "command": "torque", "parent": "base", "child": "load", **joint}
    frame = {"frame": {"xyz_m": [0, 0, 0], "rpy_rad": [0, 0, 0]}, "axis": [0, 0, 1]}
    tensor = {"xx": 1, "xy": 0, "xz": 0, "yy": 1, "yz": 0, "zz": 1}
    robot = {
        "name": "lift",
        "source": "definition",
        "gravity_m_s2": [0.0, 0.0, -WEIGHT / MASS],
        "joints": [{**slide, **frame, "motor": motor, "friction": friction}],
        "links": [{"name": "load", "mass_kg": MASS, "com_m": [0, 0, 0], "inertia_kg_m2": tensor}],
    }
    return build_model(parse(robot, "lift"))


def acceleration_by_hand(w: float, force: float) -> float:
    """Of the load, case by case: m a = e (F - D a) - W with the e that its own t asks for."""
    for driving in (True, False):
        e = ETA if driving else 1.0 / ETA
        a = (e * force - WEIGHT) / (MASS + e * ROTATING)
        if ((force - ROTATING * a) * w >= 0.0) == driving:
            return a
    raise AssertionError("one of the cases always agrees")


@pytest.mark.parametrize("force", [2.0, 5.0, 9.0, 14.0, -4.0])
@pytest.mark.parametrize("w", [0.7, -0.7])
def test_one_joint_case_by_case(w, force):
    """q̈ of a load that is driven up, braked, or drives its motor down; and the force that this q̈ takes."""
    model = lift(1e-7)
    a = forward_dynamics(model, np.zeros(1), np.array([w]), np.array([force]))
    assert a[0] == pytest.approx(acceleration_by_hand(w, force), rel=1e-9)
    assert inverse_dynamics(model, np.zeros(1), np.array([w]), a) == pytest.approx(force, rel=1e-9)


def test_up_and_down_by_events():
    """A run through three reversals of the force: against constant accelerations between events that are located by hand."""
    period, forces = 0.25, [14.0, 1.0, -3.0, 9.0]
    q, w = 0.0, 0.0
    for force in forces:
        left = period
        while left > 0.0:  # within a period the acceleration changes where the load turns back, and nowhere else
            a = acceleration_by_hand(w if w else force - WEIGHT, force)
            turn = -w / a if w * a < 0.0 else np.inf
            h = min(left, turn)
            q, w, left = q + w * h + 0.5 * a * h * h, (0.0 if turn <= left else w + a * h), left - h
    schedule = aw.Schedule(np.arange(5) * period, np.array([*forces, forces[-1]])[:, None], ["spindle"])
    scenario = aw.Scenario(lift(1e-4), command=schedule, solver=aw.Solver(step=1e-5, integrator="rk4"))
    run = aw.simulate(scenario)
    assert run.q.values[-1, 0] == pytest.approx(q, abs=2e-4 * np.ptp(run.q.values))
    assert run.qd.values[-1, 0] == pytest.approx(w, abs=2e-4 * np.ptp(run.qd.values))


def test_the_book_of_a_lossy_joint():
    """Loss integrated as (t - G(t)) w: the book closes to 1e-9 where steps end at the bends, and by the rule's order between."""
    stops = {
        "stiffness_n_per_m": 1e4,
        "damping_n_s_per_m": 1.0,
    }  # far away: arms with contacts end steps where something bends
    model = lift(0.05, stops=stops, limits={"position_m": [-50.0, 50.0]})
    forces = np.array([[14.0], [1.0], [-3.0], [9.0]]).repeat(250, axis=0)
    lacks = []
    for k in (1, 2, 4):
        balance, begun = Balance(model, "rk4"), np.zeros(2)
        last, went = balance.moved(begun, forces.repeat(k, axis=0), 1e-3 / k)
        lacks.append(balance.lacking(begun, last, went))
    assert lacks[0] < 1e-7
    assert lacks[-1] < 1e-9


# --- random and adversarial arms -----------------------------------------------------------------------------------------


def adversarial() -> dict[str, Model]:
    """Arms whose rotors outweigh their links by far, with and without coupled motors."""
    tree = build_model(random_description(9))
    return {
        "panda": lossy(arm("panda"), 0.6, 1.0),
        "panda, steep": lossy(arm("panda"), 0.05, 5.0),
        "cmu-dd, heavy": lossy(arm("cmu-dd"), 0.1, 50.0),
        "lwa4p, coupled": coupled(lossy(arm("lwa4p"), 0.3, 2.0), -0.8),
        "tree": lossy(tree, 0.2, 3.0),
    }


ARMS = adversarial()


def states(model: Model, count: int) -> np.ndarray:
    """q, q̇, q̈ (3, count, n) of sizes over four decades."""
    rng = np.random.default_rng(7)
    q, qd, qdd = rng.normal(size=(3, count, model.n))
    return np.stack([2.0 * q, qd * 10 ** rng.uniform(-3, 1, (count, 1)), qdd * 10 ** rng.uniform(-1, 3, (count, 1))])


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ARMS)
def test_forward_of_inverse_is_identity(name):
    """q̈ → tau → q̈ of compiled kernels, within 1e-10 of what the torques at play can make of it."""
    model = ARMS[name]
    kernels = aw.compile(model)
    q, qd, qdd = states(model, 20_000)
    tau = kernels.inverse_dynamics(q, qd, qdd)
    back = kernels.forward_dynamics(q, qd, tau)
    parts = kernels.inverse_dynamics(q, qd, 0.0 * qdd)  # of the torques, which cancel in part
    inverse = np.linalg.inv(kernels.mass_matrix(q))
    size = np.abs(qdd).max(1) + np.einsum("kij,kj->ki", np.abs(inverse), np.abs(parts)).max(1)
    assert (np.abs(back - qdd).max(1) <= 1e-10 * size).all()


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ARMS)
def test_one_solution_from_any_start_in_few_solves(name, monkeypatch):
    """Newton's method ends at the same accelerations wherever it begins, in at most 12 solves."""
    model, counts = ARMS[name], Counter()
    q, qd, qdd = states(model, 30)
    rng = np.random.default_rng(3)
    for row in zip(q, qd, qdd, strict=True):
        tau = inverse_dynamics(model, *row) + rng.normal(size=model.n) * 10 ** rng.uniform(-2, 2)
        bare, driven, cases = gears.motors(model, row[1], tau)
        mass = mass_matrix(bare, row[0])
        bias = (
            inverse_dynamics(bare.replace(efficiency=None, friction=None), row[0], row[1], np.zeros(model.n)) - driven
        )
        first, _ = gears.through_gears(mass, bias, cases)
        for start in rng.normal(size=(3, model.n)) * 10 ** rng.uniform(0, 5, (3, 1)):
            state, steps = np.array([*start, 0.0]), 0
            while True:
                after = gears._newton_step(state[:-1], state[-1], mass, bias, cases)
                steps += 1
                if np.array_equal(after, state):
                    break
                state = after
            counts[steps] += 1
            matrix, right = gears.linearised(mass, bias, cases, state[:-1])
            np.testing.assert_allclose(
                np.linalg.solve(matrix, right), first, rtol=1e-8, atol=1e-8 * np.abs(first).max()
            )
    assert max(counts) <= gears.MOST


# --- slopes ------------------------------------------------------------------------------------------------------------------


def driven_arm() -> Model:
    """A lossy arm with coupled motors and commands of torque."""
    model = coupled(lossy(arm("lwa4p"), 0.5, 1.5), 0.7)
    bodies = (replace(body, drive=replace(body.drive, command="torque")) for body in model.bodies)
    return replace(model, bodies=tuple(bodies))


@pytest.mark.parametrize("speed", [0.0, 1e-3, -1e-3, 0.4])
def test_slopes_on_both_sides_of_rest(speed):
    """Of inverse and forward dynamics against differences; at rest against those towards positive motion."""
    model, h = driven_arm(), 1e-7
    q, qd, qdd = np.linspace(-1.0, 1.0, 6), np.full(6, speed), np.linspace(3.0, -2.0, 6)
    tau = inverse_dynamics(model, q, qd, qdd)
    ahead, behind = (h, 0.0) if speed == 0.0 else (h, -h)

    def differences(function: Any) -> np.ndarray:
        return np.stack([(function(ahead * e) - function(behind * e)) / (ahead - behind) for e in np.eye(6)], axis=1)

    _, by_qd, by_qdd = inverse_dynamics_derivatives(model, q, qd, qdd)
    close = {"rtol": 0.0, "atol": 2e-4 * np.abs(by_qd).max()}
    np.testing.assert_allclose(by_qd, differences(lambda d: inverse_dynamics(model, q, qd + d, qdd)), **close)
    _, by_speed, by_tau = forward_dynamics_derivatives(model, q, qd, tau)
    close["atol"] = 2e-4 * np.abs(by_speed).max()
    np.testing.assert_allclose(by_speed, differences(lambda d: forward_dynamics(model, q, qd + d, tau)), **close)
    np.testing.assert_allclose(by_tau @ by_qdd, np.eye(6), rtol=0.0, atol=1e-10)
    a, b = forward_arm_linearised(model, q, qd, tau)
    np.testing.assert_allclose(a[6:, 6:], by_speed, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(b[6:], by_tau, rtol=1e-12, atol=1e-9)


# --- elastic gears -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stretch", [0.002, -0.002])
@pytest.mark.parametrize("speed", [0.4, -0.4])
def test_an_elastic_gear_loses_before_its_spring(stretch, speed):
    """D a = F - G⁻¹(spring), case by case: the spring asks more of a motor that drives it, less of one that it drives."""
    model = lift(1e-7, elasticity={"stiffness_n_per_m": 3000.0, "damping_n_s_per_m": 0.0})
    plant, force = Plant.of(model), 5.0
    x = np.array([0.0, 0.1, RATIO * stretch, RATIO * speed])  # q, q̇, θ_motor, its speed
    change = plant.derivative(x, np.array([force]))
    spring = 3000.0 * stretch
    entering = spring / ETA if spring * speed > 0.0 else ETA * spring
    assert change[3] / RATIO == pytest.approx((force - entering) / ROTATING, rel=1e-9)
    assert change[1] == pytest.approx((spring - WEIGHT) / MASS, rel=1e-9)
    rates = energy_rates(plant, x, np.array([force]))
    assert rates["friction"] == pytest.approx((entering - spring) * speed, rel=1e-9)


def test_the_traced_slope_at_rest_is_that_of_the_gear():
    """Of the program itself, as the simulator takes it, where the torques of motor and gear differ in sign."""
    model = lift(0.05)
    program = trace(
        "a", lambda qd, tau: forward_dynamics(model, np.zeros(1), qd, tau), {"qd": (1,), "tau": (1,)}, ("qdd",)
    )
    slope = derivative(program, "qd")
    for force in (-0.5, 1.0, 9.0):  # -0.5: pulls down, and still carries the rotor's fall
        qd, tau = np.zeros(1), np.array([force])
        traced = interpret(slope, qd, tau)[1][0, 0]
        expected = forward_dynamics_derivatives(model, np.zeros(1), qd, tau)[1][0, 0]
        ahead = (forward_dynamics(model, qd, qd + 1e-8, tau) - forward_dynamics(model, qd, qd, tau)) / 1e-8
        assert traced == pytest.approx(expected, rel=1e-12)
        assert traced == pytest.approx(ahead[0], rel=1e-5)

"""Checks forward against inverse dynamics of arms whose gears lose power, over a million states, and counts the solves.

    .venv/bin/python tools/gear_identity.py [--states 1000000]

Prints the rows of the tables in docs/conventions.md. Rigid gears: the largest error of q̈ → tau → q̈, as a share of the
accelerations that the torques at play give; how far the solution from three other starts lies from it; how many of the solves
each state took. Elastic gears, where nothing is solved: the largest error of (q̈, θ̈) → (θ, tau) → (q̈, θ̈).
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import armwright as aw
from armwright import scalar
from armwright.actuators.coupling import from_joints, shares_of, to_motors
from armwright.actuators.friction import motor_friction
from armwright.actuators.gear import gear_loss
from armwright.dynamics import inverse, mass_matrix
from armwright.dynamics.gears import linearised, motors, newton_steps, without_rotors
from armwright.kernels.batch import Kernel
from armwright.kernels.target import select_target
from armwright.model import EfficiencyTable, Elasticity, Friction, Model, build_model
from armwright.program import trace
from armwright.simulation.plant.plant import Plant

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))
from dynamics.gear_tables import ROWS, TORQUES  # noqa: E402
from reference.random_trees import random_description  # noqa: E402

STARTS = 3
BATCH = 50_000
TABLE = EfficiencyTable(
    TORQUES,
    tuple(row["speed_rad_per_s"] for row in ROWS),
    tuple(row["driving"] for row in ROWS),
    tuple(row["driven_back"] for row in ROWS),
)
SPRING = Elasticity(stiffness=1e4, damping=20.0)


def lossy(model: Model, efficiency: float | EfficiencyTable, inertia: float, share: float = 0.0) -> Model:
    """The arm with n² J_m = `inertia` before lossy gears, and motors that the joint before theirs turns as well."""
    bodies = []
    for k, body in enumerate(model.bodies):
        drive = replace(
            body.drive,
            efficiency=efficiency,
            smoothing=0.05,
            rotor_inertia=inertia / body.drive.gear_ratio**2,
            coupling=((model.bodies[k - 1].joint, share * body.drive.gear_ratio),) if share and k else (),
        )
        bodies.append(replace(body, drive=drive))
    return replace(model, bodies=tuple(bodies))


def rubbing(model: Model, on_motor: bool) -> Model:
    """The arm with friction of a tenth of the load in every gear, and none besides."""
    friction = Friction(on_motor=on_motor, smoothing=0.05, load_coefficient=0.1)
    return replace(model, bodies=tuple(replace(body, friction=friction) for body in model.bodies))


def elastic(model: Model) -> Model:
    """The arm with gears that give way, and no limit of its drives."""
    bodies = (
        replace(
            body,
            elasticity=SPRING,
            limits=replace(body.limits, torque=np.inf, voltage=np.inf, current=np.inf),
            drive=replace(body.drive, command="torque"),
        )
        for body in model.bodies
    )
    return replace(model, bodies=tuple(bodies))


def arms() -> dict[str, Model]:
    """Arms as they are built, and such as strain the method: rotors that outweigh the links, steep gears, motors all coupled."""
    return {
        "scara (example)": aw.load(ROOT / "examples" / "scara.toml"),
        "panda, η 0.7, as geared": lossy(aw.load("panda"), 0.7, 0.3),
        "puma560, η 0.5, heavy rotors": lossy(aw.load("puma560"), 0.5, 5.0),
        "lwa4p, η 0.3, all motors coupled": lossy(aw.load("lwa4p"), 0.3, 2.0, -0.8),
        "panda, η 0.05, heavy rotors": lossy(aw.load("panda"), 0.05, 5.0),
        "tree of 12 joints, η 0.1": lossy(build_model(random_description(33)), 0.1, 3.0),
        "panda, η by table": lossy(aw.load("panda"), TABLE, 0.3),
        "panda, η by table, load friction": rubbing(lossy(aw.load("panda"), TABLE, 0.3), on_motor=False),
        "puma560, η by table, load friction of motors": rubbing(lossy(aw.load("puma560"), TABLE, 5.0), on_motor=True),
        "lwa4p, η by table, all motors coupled": lossy(aw.load("lwa4p"), TABLE, 2.0, -0.8),
    }


def elastic_arms() -> dict[str, Model]:
    """Arms with elastic lossy gears."""
    return {
        "panda, elastic, η 0.7": elastic(lossy(aw.load("panda"), 0.7, 0.3)),
        "panda, elastic, η by table": elastic(lossy(aw.load("panda"), TABLE, 0.3)),
        "lwa4p, elastic, η 0.3, all motors coupled": elastic(lossy(aw.load("lwa4p"), 0.3, 2.0, -0.8)),
        "lwa4p, elastic, η by table, all motors coupled": elastic(lossy(aw.load("lwa4p"), TABLE, 2.0, -0.8)),
    }


def iteration(model: Model) -> Kernel:
    """(q, q̇, tau, start) → accelerations, and the steps that led there."""

    def function(q, qd, tau, start):
        bare, driven, gears = motors(model, qd, tau)
        bias = inverse.torques_of_links(bare, q, qd, scalar.zeros(model.n)) - driven
        mass = mass_matrix(bare, q)
        near = newton_steps(mass, bias, gears, start)
        return scalar.solve_symmetric(*linearised(mass, bias, gears, near[:-1])), near[-1]

    shapes = dict.fromkeys(("q", "qd", "tau", "start"), (model.n,))
    return Kernel(trace("probe", function, shapes, ("qdd", "steps")), select_target())


def probed(model: Model, count: int) -> tuple[float, float, np.ndarray]:
    """Largest error, largest distance of other starts' solutions, and the solves of all states, counted."""
    kernels, steps, rng = aw.compile(model), iteration(model), np.random.default_rng(11)
    worst, difference, counts = 0.0, 0.0, np.zeros(14, dtype=int)
    for _ in range(0, count, BATCH):
        q, qd, qdd, noise = rng.normal(size=(4, BATCH, model.n))
        qd, qdd = qd * 10 ** rng.uniform(-3, 1, (BATCH, 1)), qdd * 10 ** rng.uniform(-1, 3, (BATCH, 1))
        tau = kernels.inverse_dynamics(q, qd, qdd)
        back = kernels.forward_dynamics(q, qd, tau)
        bias = kernels.inverse_dynamics(q, qd, 0.0 * qdd)  # of the torques, which cancel in part
        reach = np.abs(np.linalg.inv(kernels.mass_matrix(q)))
        size = np.abs(qdd).max(1) + np.einsum("kij,kj->ki", reach, np.abs(bias)).max(1)
        worst = max(worst, (np.abs(back - qdd).max(1) / size).max())
        # any torques
        tau = np.where(rng.uniform(size=(BATCH, 1)) < 0.5, tau, noise * 10 ** rng.uniform(-2, 3, (BATCH, 1)))
        first, taken = steps(q, qd, tau, 0.0 * q)
        counts += np.bincount(taken.astype(int) + 2, minlength=14)
        for _ in range(STARTS):
            other, _taken = steps(q, qd, tau, rng.normal(size=q.shape) * 10 ** rng.uniform(-1, 5, (BATCH, 1)))
            difference = max(difference, (np.abs(other - first).max(1) / np.abs(first).max(1)).max())
    return worst, difference, counts


def elastic_inverse(model: Model) -> Kernel:
    """(q, q̇, q̈, θ̇, θ̈) → θ and tau of the motors; θ = θ_motor / n, behind springs k (θ - B q) + d (θ̇ - B q̇)."""
    links = without_rotors(model, model.names)

    def function(q, qd, qdd, motor_speed, motor_acceleration):
        shares = shares_of(model)
        torques = from_joints(shares, inverse.torques_of_links(links, q, qd, qdd))
        at, speed = to_motors(shares, q), to_motors(shares, qd)
        motor, tau = [], []
        for i, body in enumerate(model.coordinates):
            loss = gear_loss(body.drive, motor_speed[i])
            motor.append(at[i] + (torques[i] - SPRING.damping * (motor_speed[i] - speed[i])) / SPRING.stiffness)
            rotor = body.drive.reflected * motor_acceleration[i] + motor_friction(body, motor_speed[i])
            tau.append(loss.input(torques[i]) + rotor)
        return scalar.array(motor), scalar.array(tau)

    shapes = dict.fromkeys(("q", "qd", "qdd", "motor_speed", "motor_acceleration"), (model.n,))
    return Kernel(trace("elastic", function, shapes, ("motor", "tau")), select_target())


def elastic_error(model: Model, count: int) -> float:
    """Largest error of the accelerations of joints and motors, each as a share of what the torques at play give."""
    plant, n, rng = Plant.of(model), model.n, np.random.default_rng(12)
    links = aw.compile(model.replace(rotors=None, efficiency=None))
    forward = Kernel(
        trace("derivative", lambda x, u: (plant.derivative(x, u),), {"x": (plant.size,), "u": (n,)}, ("xd",)),
        select_target(),
    )
    backward, worst = elastic_inverse(model), 0.0
    ratio = np.array([body.drive.gear_ratio for body in model.coordinates])
    inertia = np.array([body.drive.reflected for body in model.coordinates])
    for _ in range(0, count, BATCH):
        q, qd, qdd, speed, acceleration = rng.normal(size=(5, BATCH, n))
        qd, qdd = qd * 10 ** rng.uniform(-3, 1, (BATCH, 1)), qdd * 10 ** rng.uniform(-1, 3, (BATCH, 1))
        speed, acceleration = qd + 0.1 * speed, qdd * acceleration
        motor, tau = backward(q, qd, qdd, speed, acceleration)
        change = forward(np.concatenate([q, qd, motor * ratio, speed * ratio], axis=1), tau)
        bias = links.inverse_dynamics(q, qd, 0.0 * qdd)  # of the torques, which cancel in part
        reach = np.abs(np.linalg.inv(links.mass_matrix(q)))
        joints = np.abs(qdd).max(1) + np.einsum("kij,kj->ki", reach, np.abs(bias)).max(1)
        rotors = np.abs(acceleration) + np.abs(tau) / inertia
        found, turned = change[:, n : 2 * n], change[:, 3 * n :] / ratio
        worst = max(
            worst,
            (np.abs(found - qdd).max(1) / joints).max(),
            (np.abs(turned - acceleration).max(1) / rotors.max(1)).max(),
        )
    return worst


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--states", type=int, default=1_000_000)
    states = parser.parse_args().states
    print("| arm | error | other starts | solves: share of states |\n| --- | --- | --- | --- |")
    for name, model in arms().items():
        worst, difference, counts = probed(model, states)
        shares = ", ".join(f"{k}: {c / counts.sum():.2g}" for k, c in enumerate(counts) if c)
        print(f"| {name} | {worst:.1e} | {difference:.1e} | {shares} |", flush=True)
    print("\n| arm | error |\n| --- | --- |")
    for name, model in elastic_arms().items():
        print(f"| {name} | {elastic_error(model, states):.1e} |", flush=True)


if __name__ == "__main__":
    main()

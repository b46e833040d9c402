"""Checks forward against inverse dynamics of arms whose gears lose power, over a million states, and counts the solves.

    .venv/bin/python tools/gear_identity.py [--states 1000000]

Prints the rows of the table in docs/reliability.md: the largest error of q̈ → tau → q̈, as a share of the accelerations that the
torques at play give; how far the solution from three other starts lies from it; how many of the solves each state took.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import armwright as aw
from armwright import scalar
from armwright.dynamics import inverse, mass_matrix
from armwright.dynamics.gears import linearised, motors, newton_steps
from armwright.kernels.batch import Kernel
from armwright.kernels.target import select_target
from armwright.model import Model, build_model
from armwright.program import trace

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))
from reference.random_trees import random_description  # noqa: E402

STARTS = 3
BATCH = 50_000


def lossy(model: Model, efficiency: float, inertia: float, share: float = 0.0) -> Model:
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


def arms() -> dict[str, Model]:
    """Arms as they are built, and such as strain the method: rotors that outweigh the links, steep gears, motors all coupled."""
    return {
        "scara (example)": aw.load(ROOT / "examples" / "scara.toml"),
        "panda, η 0.7, as geared": lossy(aw.load("panda"), 0.7, 0.3),
        "puma560, η 0.5, heavy rotors": lossy(aw.load("puma560"), 0.5, 5.0),
        "lwa4p, η 0.3, all motors coupled": lossy(aw.load("lwa4p"), 0.3, 2.0, -0.8),
        "panda, η 0.05, heavy rotors": lossy(aw.load("panda"), 0.05, 5.0),
        "tree of 12 joints, η 0.1": lossy(build_model(random_description(33)), 0.1, 3.0),
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
    worst, apart, counts = 0.0, 0.0, np.zeros(14, dtype=int)
    for _ in range(0, count, BATCH):
        q, qd, qdd, noise = rng.normal(size=(4, BATCH, model.n))
        qd, qdd = qd * 10 ** rng.uniform(-3, 1, (BATCH, 1)), qdd * 10 ** rng.uniform(-1, 3, (BATCH, 1))
        tau = kernels.inverse_dynamics(q, qd, qdd)
        back = kernels.forward_dynamics(q, qd, tau)
        bias = kernels.inverse_dynamics(q, qd, 0.0 * qdd)  # of the torques, which cancel in part
        reach = np.abs(np.linalg.inv(kernels.mass_matrix(q)))
        size = np.abs(qdd).max(1) + np.einsum("kij,kj->ki", reach, np.abs(bias)).max(1)
        worst = max(worst, (np.abs(back - qdd).max(1) / size).max())
        tau = np.where(
            rng.uniform(size=(BATCH, 1)) < 0.5, tau, noise * 10 ** rng.uniform(-2, 3, (BATCH, 1))
        )  # any torques
        first, taken = steps(q, qd, tau, 0.0 * q)
        counts += np.bincount(taken.astype(int) + 2, minlength=14)
        for _ in range(STARTS):
            other, _taken = steps(q, qd, tau, rng.normal(size=q.shape) * 10 ** rng.uniform(-1, 5, (BATCH, 1)))
            apart = max(apart, (np.abs(other - first).max(1) / np.abs(first).max(1)).max())
    return worst, apart, counts


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--states", type=int, default=1_000_000)
    states = parser.parse_args().states
    print("| arm | error | other starts | solves: share of states |\n| --- | --- | --- | --- |")
    for name, model in arms().items():
        worst, apart, counts = probed(model, states)
        shares = ", ".join(f"{k}: {c / counts.sum():.2g}" for k, c in enumerate(counts) if c)
        print(f"| {name} | {worst:.1e} | {apart:.1e} | {shares} |", flush=True)


if __name__ == "__main__":
    main()

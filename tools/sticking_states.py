"""Checks the problem of speeds that stick over random and adversarial states, and counts the solves.

    .venv/bin/python tools/sticking_states.py [--states 100000]

Prints the rows of the table in docs/conventions.md: solves that each state took; failures, which are marked NaN; how many of
those that were looked at are wrong without a mark; the largest force that no torque within the limits of its element balances,
as a share of the forces at play; how far the speeds lie from those of another method, as a share of the speeds; and the most
that the energy of arms without load rises, as a share of it.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from armwright.actuators.gear import GearLoss
from armwright.dynamics.gears import newton_steps
from armwright.dynamics.sticking import MOST, DryElement, Side, as_gears, next_speeds
from armwright.kernels.batch import Kernel
from armwright.kernels.target import select_target
from armwright.program import trace

BATCH = 50_000
CHECKED = 300  # states of each family that are compared with another method
STEP = 1e-3  # [s]
ROUNDING = 1e-12  # of the speed that a load gives to a joint in a step
WRONG = 1e-5  # of the forces at play: a failure that is not marked


@dataclass(frozen=True)
class Family:
    """A kind of arm: elements of motors, and of joints where `coupled` tells their speeds from the motors'.

    Attributes:
        n: speeds.   efficiency: of the gears; 1: none.   decades: over which the eigenvalues of the mass matrix lie.
        coupled: joints at the end whose motors all of these turn.
    """

    n: int
    efficiency: float = 1.0
    decades: float = 3.0
    coupled: int = 0

    @property
    def rows(self) -> np.ndarray:
        """Speeds of the elements by the unknowns: of all motors, then of the coupled joints (elements, n)."""
        motors = np.eye(self.n)
        if not self.coupled:
            return motors
        turns = np.eye(self.n)
        k = self.n - self.coupled
        turns[k:, k:] += 0.7 * np.tril(np.ones((self.coupled, self.coupled)), -1)
        return np.vstack([motors, np.linalg.inv(turns)[k:]])

    def elements(self, data: np.ndarray) -> list[DryElement]:
        """The elements from rows of limits, driving torque and rotor's inertia (elements, 4)."""
        found = []
        for row, (plus, minus, torque, inertia) in zip(self.rows, data, strict=True):
            places = [(j, float(f)) for j, f in enumerate(row) if f]
            if len(found) >= self.n or self.efficiency == 1.0:
                sides = (Side(torque, plus, None), Side(torque, -minus, None))
                found.append(DryElement(places, 0.0, *sides))
            else:  # half of the friction before the gear, half behind it
                eta, inverse = self.efficiency, 1.0 / self.efficiency
                forward, backward = GearLoss((0.0,), (inverse, eta)), GearLoss((0.0,), (eta, inverse))
                sides = (
                    Side(torque - 0.5 * plus, 0.5 * plus, forward), Side(torque + 0.5 * minus, -0.5 * minus, backward)
                )  # fmt: skip
                found.append(DryElement(places, inertia, *sides))
        return found

    def kernel(self) -> Kernel:
        """(M, b, v, data) → speeds, directions, and the steps that led there."""

        def function(mass, bias, speeds, data):
            elements = self.elements(data)
            after, directions = next_speeds(mass, bias, speeds, STEP, elements)
            matrix, right, jumps, _ = as_gears(mass, bias, speeds, STEP, elements, (), [0.0] * len(elements))
            return after, directions, newton_steps(matrix, right, [jump.gear for jump in jumps], speeds, MOST)[-1:]

        n, count = self.n, len(self.rows)
        shapes = {"mass": (n, n), "bias": (n,), "speeds": (n,), "data": (count, 4)}
        return Kernel(trace("probe", function, shapes, ("after", "directions", "steps")), select_target())

    def states(self, rng: np.random.Generator, count: int, loaded: bool = True) -> tuple[np.ndarray, ...]:
        """Mass matrices, biases, speeds and elements' data; many speeds 0, many loads at the edge of what holds."""
        n, elements = self.n, len(self.rows)
        axes = np.linalg.qr(rng.normal(size=(count, n, n)))[0]
        values = 10 ** rng.uniform(-0.5 * self.decades, 0.5 * self.decades, (count, n))
        mass = np.einsum("kij,kj,klj->kil", axes, values, axes)
        speeds = rng.normal(size=(count, n)) * 10 ** rng.uniform(-6, 1, (count, n)) * (rng.random((count, n)) < 0.6)
        data = np.zeros((count, elements, 4))
        data[..., 0] = 10 ** rng.uniform(-3, 3, (count, elements)) * (rng.random((count, elements)) < 0.9)
        data[..., 1] = np.where(rng.random((count, elements)) < 0.5, data[..., 0], 2.0 * data[..., 0])
        data[..., 3] = 10 ** rng.uniform(-2, 2, (count, elements))
        bias = rng.normal(size=(count, n)) * 10 ** rng.uniform(-3, 3, (count, n))
        edge = rng.random((count, n)) < 0.3
        bias = np.where(edge, -data[:, :n, 0] * (1.0 + rng.choice([-1e-12, 0.0, 1e-12], (count, n))), bias)
        data[:, :n, 2] = (
            rng.normal(size=(count, n)) * 10 ** rng.uniform(-3, 2, (count, n)) * (rng.random((count, n)) < 0.7)
        )
        return (mass, bias, speeds, data) if loaded else (mass, 0.0 * bias, speeds, data * [1.0, 1.0, 0.0, 1.0])

    def limits(
        self, before: np.ndarray, after: np.ndarray, data: np.ndarray, small: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Least and most torque of every element at speeds after a step; one number where it slides (elements,).

        `small` (n,): speeds that count as 0.
        """
        low, high = [], []
        for row, (plus, minus, torque, inertia) in zip(self.rows, data, strict=True):
            speed, was = row @ after, row @ before
            if abs(speed) <= np.abs(row) @ small + (1e-9 * np.abs(row * after).sum() if (row != 0).sum() > 1 else 0.0):
                speed = 0.0
            if len(low) >= self.n or self.efficiency == 1.0:
                ends = torque - plus, torque + minus
            else:
                eta, entering = self.efficiency, torque - inertia * (speed - was) / STEP
                forth, back = entering - 0.5 * plus, entering + 0.5 * minus
                ends = min(eta * forth, forth / eta) - 0.5 * plus, max(eta * back, back / eta) + 0.5 * minus
            low.append(ends[1] if speed < 0.0 else ends[0])
            high.append(ends[0] if speed > 0.0 else ends[1])
        return np.array(low), np.array(high)


FAMILIES: dict[str, Family] = {
    "7 joints, friction": Family(7),
    "7 joints, friction, η 0.6": Family(7, efficiency=0.6),
    "6 joints, wrist of 3 coupled motors": Family(6, coupled=3),
    "6 joints, wrist of 3 coupled motors, η 0.3": Family(6, efficiency=0.3, coupled=3),
    "2 joints, inertias 1 to 10⁸": Family(2, decades=8.0),
    "7 joints, inertias 1 to 10⁶, η 0.1": Family(7, efficiency=0.1, decades=6.0),
    "12 joints, inertias 1 to 10⁴": Family(12, decades=4.0),
}


@dataclass(frozen=True)
class Probe:
    """Results of one family: counted solves, failures, and largest errors."""

    solves: np.ndarray
    failures: int
    unmarked: int
    unbalanced: float
    difference: float
    risen: float


def unbalanced(family: Family, state: tuple[np.ndarray, ...], after: np.ndarray) -> float:
    """Force that no torques within the limits balance, as a share of the forces at play."""
    mass, bias, speeds, data = state
    force = mass @ (after - speeds) / STEP + bias
    small = ROUNDING * STEP * (np.abs(bias).max() + np.abs(data[:, 2]).max()) / np.diag(mass)
    low, high = family.limits(speeds, after, data, small)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    rows = (family.rows * half[:, None]).T
    left = force - family.rows.T @ middle
    size = np.abs(bias).max() + np.abs(middle).max() + np.abs(half).max() + np.abs(mass @ speeds).max() / STEP
    found = lsq_linear(rows, left, (-1.0, 1.0), method="bvls", tol=1e-14, max_iter=500) if half.any() else None
    rest = left if found is None else rows @ found.x - left
    return float(np.abs(rest).max() / size)


def other_speeds(family: Family, state: tuple[np.ndarray, ...]) -> np.ndarray:
    """Speeds by the dual problem: torques within their limits of least ½ yᵀ A y + sᵀ y, by active sets; without gear loss."""
    mass, bias, speeds, data = state
    rows = family.rows
    free = speeds + STEP * np.linalg.solve(mass, rows.T @ data[:, 2] - bias)
    root = np.linalg.cholesky(np.linalg.inv(mass) * STEP)
    a, b = (rows @ root).T, -np.linalg.solve(root, free)
    held = data[:, 0] + data[:, 1] > 0.0
    found = lsq_linear(a[:, held], b, (-data[held, 0], data[held, 1]), method="bvls", tol=1e-14, max_iter=1000)
    return free + root @ (a[:, held] @ found.x)


def probed(family: Family, count: int, checked: int = CHECKED, seed: int = 5) -> Probe:
    """Solves and errors over that many random states."""
    kernel, rng = family.kernel(), np.random.default_rng(seed)
    counts, failures, unmarked, worst, difference, risen = np.zeros(MOST + 2, dtype=int), 0, 0, 0.0, 0.0, -np.inf
    for _ in range(0, count, BATCH):
        size = min(BATCH, count)
        state = family.states(rng, size)
        after, _, steps = kernel(*state)
        bad = ~np.isfinite(after).all(1)
        failures += int(bad.sum())
        counts += np.bincount(steps[:, 0].astype(int) + 1, minlength=MOST + 2)
        hard = np.argsort(-steps[:, 0])[: checked // 2]  # those that took the most solves, and the first
        for k in [k for k in (*hard, *range(checked // 2)) if not bad[k]]:
            one = tuple(part[k] for part in state)
            left = unbalanced(family, one, after[k])
            worst, unmarked = max(worst, left), unmarked + (left > WRONG)
            if family.efficiency == 1.0:
                largest = max(np.abs(one[2]).max(), np.abs(after[k]).max(), 1e-6)
                difference = max(difference, np.abs(other_speeds(family, one) - after[k]).max() / largest)
        mass, bias, speeds, data = family.states(rng, size, loaded=False)
        after, _, _ = kernel(mass, bias, speeds, data)
        if family.efficiency != 1.0:
            mass = mass + data[:, : family.n, 3][:, None, :] * np.eye(family.n)
        energies = [np.einsum("ki,kij,kj->k", v, mass, v) for v in (speeds, np.nan_to_num(after))]
        risen = max(risen, ((energies[1] - energies[0]) / np.maximum(energies[0], 1e-200)).max())
    return Probe(counts, failures, unmarked, worst, difference, risen)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--states", type=int, default=100_000)
    states = parser.parse_args().states
    heads = ("arm", "solves: share of states", "failures", "unmarked", "unbalanced", "other method", "energy")
    print(f"| {' | '.join(heads)} |\n|{' --- |' * len(heads)}")
    for name, family in FAMILIES.items():
        got = probed(family, states)
        shares = ", ".join(f"{k}: {c / got.solves.sum():.2g}" for k, c in enumerate(got.solves) if c)
        counted = f"{got.failures} | {got.unmarked}"
        other = f"{got.difference:.1e}" if family.efficiency == 1.0 else "-"
        print(
            f"| {name} | {shares} | {counted} | {got.unbalanced:.1e} | {other} | {max(got.risen, 0.0):.1e} |",
            flush=True,
        )


if __name__ == "__main__":
    main()

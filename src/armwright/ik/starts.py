"""Starts of descents: random poses of the arm, and for each target those that are nearest to it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armwright import scalar
from armwright.ik.chain import TURN, JointChain
from armwright.kernels.loop import LoopArrays, NativeLoop
from armwright.kernels.stages import Call, TableStage
from armwright.kernels.target import Target
from armwright.model import Model
from armwright.program import Program, trace
from armwright.scalar import Array, Scalar

STARTS = 2048  # rows of the table
NEAREST_OF = 256  # of them are ranked
RANKED = 4  # of them, the nearest, are tried first, nearest first
OUTSIDE = 1e6  # [m²] the distance of a start whose first joint would leave its limits
FEATURES = 12  # of a pose: position (3) and rotation (9)
GOLDEN_ITERATIONS = 64  # each leaves a third of the error or less
AT_ONCE = 16  # rows of the table that pass by together


def ranking(chain: JointChain) -> Program:
    """Program  row, pose, tick, found → found_next: keeps the `RANKED` nearest, of each `AT_ONCE` rows that pass by the nearest.

    row: features (12), half their square, and in turns the first position less the azimuth, from the middle of its limits.
    pose: features (12) and azimuth in turns.
    found: distances [m²/2] in growing order, then numbers of the rows.
    """
    turned = chain.base is not None
    low, high = chain.low[0], chain.high[0]

    def insert(rows: Array, pose: Array, tick: Array, found: Array) -> np.ndarray:
        first = tick[0] * float(AT_ONCE)
        best, number = distance_of(rows[0], pose), first
        for k in range(1, AT_ONCE):
            distance = distance_of(rows[k], pose)
            nearer = scalar.less(distance, best)
            best, number = scalar.where(nearer, distance, best), scalar.where(nearer, first + float(k), number)
        return inserted(best, number, found)

    def distance_of(row: Array, pose: Array) -> Scalar:
        distance = row[FEATURES] - row[:FEATURES] @ pose[:FEATURES]
        if not (turned and np.isfinite(low) and np.isfinite(high)):
            return distance
        turns = row[FEATURES + 1] + pose[FEATURES]
        turns = scalar.abs(turns - scalar.floor(turns + 0.5))
        return scalar.where(scalar.less(0.5 * (high - low) / TURN, turns), OUTSIDE, distance)

    def inserted(distance: Scalar, number: Scalar, found: Array) -> np.ndarray:
        distances, numbers = [], []
        for k in range(RANKED):
            nearer = scalar.less(distance, found[k])
            distances.append(scalar.where(nearer, distance, found[k]))
            numbers.append(scalar.where(nearer, number, found[RANKED + k]))
            distance = scalar.where(nearer, found[k], distance)
            number = scalar.where(nearer, found[RANKED + k], number)
        return scalar.array([*distances, *numbers])

    shapes = {"row": (AT_ONCE, FEATURES + 2), "pose": (FEATURES + 1,), "tick": (1,), "found": (2 * RANKED,)}
    return trace("ranking", insert, shapes, ("found_next",))


class Starts:
    """A table of starts and the native code that ranks it.

    Attributes:
        rows: (STARTS, n + 1) joint positions and the azimuth of their pose, as `JointChain.start` takes them.
    """

    def __init__(self, chain: JointChain, poses_at: Callable[[np.ndarray], np.ndarray], target: Target):
        """Random positions within the limits, the same each time; `poses_at`: (k, n) → (k, 4, 4) of the frame."""
        self.chain = chain
        positions = random_positions(chain.model, STARTS)
        tasks, features = chain.places(poses_at(positions))
        azimuths = tasks[:, 12:]
        self.rows = np.concatenate([positions, azimuths], axis=1)
        square = 0.5 * (features**2).sum(axis=1, keepdims=True)
        limits = chain.low[0], chain.high[0]
        middle = 0.5 * sum(limits) if np.isfinite(limits).all() else 0.0
        turns = (positions[:, :1] - azimuths - middle) / TURN
        table = np.concatenate([features, square, turns], axis=1)
        self._table = np.ascontiguousarray(table[:NEAREST_OF])
        self._loop = NativeLoop(
            (TableStage("row", AT_ONCE * (FEATURES + 2), spread=False), Call(ranking(chain))), target
        )

    def ranked(self, tasks: np.ndarray, features: np.ndarray) -> np.ndarray:
        """(k, RANKED) numbers of the rows that are nearest to each pose, as floats."""
        lanes = self._loop.lanes(len(tasks))
        lanes.set("pose", np.concatenate([features, tasks[:, 12:] / TURN], axis=1))
        lanes.set("found", np.repeat([np.inf, 0.0], RANKED))
        self._loop.run(lanes, 0.0, (0, len(self._table) // AT_ONCE), LoopArrays({"row": self._table}))
        return np.ascontiguousarray(lanes.get("found")[:, RANKED:])


def random_positions(arm: Model, count: int) -> np.ndarray:
    """(count, n) joint positions spread evenly over the limits; over a whole turn, or a metre, without limits.

    Row k is the fractional part of  k (1/φ, 1/φ², …, 1/φⁿ),  φⁿ⁺¹ = φ + 1: an additive recurrence, even for any count.
    [Roberts2018] Descents from it take as many iterations as from Sobol's points, whose import from SciPy takes longer than
    all compiling.
    """
    golden, (low, high) = 2.0, sampled_ranges(arm)
    for _ in range(GOLDEN_ITERATIONS):
        golden = (1.0 + golden) ** (1.0 / (arm.n + 1))
    shares = np.outer(np.arange(1, count + 1), golden ** -np.arange(1.0, arm.n + 1)) % 1.0
    return low + shares * (high - low)


def sampled_ranges(arm: Model) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest joint positions (n,) for sampling: the limits; a whole turn, or a metre, without limits."""
    low, high = np.array([body.limits.position for body in arm.coordinates]).T
    half = np.array([body.kind.units.half_range for body in arm.coordinates])
    low_known, high_known = np.isfinite(low), np.isfinite(high)
    lowest = np.where(low_known, low, np.where(high_known, high - 2.0 * half, -half))
    return lowest, np.where(high_known, high, lowest + 2.0 * half)

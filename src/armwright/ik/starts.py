"""Starts of descents: random poses of the arm, and for each target those that are nearest to it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armwright import scalar
from armwright.ik.chain import Chain
from armwright.kernels.loop import Loop
from armwright.kernels.stages import Call, Table
from armwright.kernels.target import Target
from armwright.program import Program, trace
from armwright.scalar import Array, Scalar

STARTS = 2048  # rows of the table
NEAREST_OF = 256  # of them are ranked
RANKED = 4  # of them, the nearest, are tried first, nearest first
OUTSIDE = 1e6  # [m²] added to the distance of a start whose first joint would leave its limits
FEATURES = 12
AT_ONCE = 8  # rows of the table that pass by together


def ranking(chain: Chain) -> Program:
    """Program  row, pose, tick, found → found_next: keeps the `RANKED` nearest of the rows that pass by.

    row: features (12), half their square, first position and azimuth of a start. pose: features (12) and azimuth.
    found: distances [m²/2] in growing order, then numbers of the rows.
    """
    turned = chain.base is not None
    low, high = chain.low[0], chain.high[0]

    def insert(rows: Array, pose: Array, tick: Array, found: Array) -> np.ndarray:
        for k in range(AT_ONCE):
            found = insert_one(rows[k], pose, tick[0] * float(AT_ONCE) + float(k), found)
        return found

    def insert_one(row: Array, pose: Array, number: Scalar, found: Array) -> np.ndarray:
        distance = row[FEATURES] - row[:FEATURES] @ pose[:FEATURES]
        if turned and np.isfinite(low) and np.isfinite(high):
            angle = row[FEATURES + 1] + (pose[FEATURES] - row[FEATURES + 2])
            angle = angle - 2.0 * np.pi * scalar.floor(angle / (2.0 * np.pi) + 0.5)
            distance = distance + scalar.where(
                scalar.less(0.5 * (high - low), scalar.abs(angle - 0.5 * (low + high))), OUTSIDE, 0.0
            )
        distances, numbers = [], []
        for k in range(RANKED):
            nearer = scalar.less(distance, found[k])
            distances.append(scalar.where(nearer, distance, found[k]))
            numbers.append(scalar.where(nearer, number, found[RANKED + k]))
            distance = scalar.where(nearer, found[k], distance)
            number = scalar.where(nearer, found[RANKED + k], number)
        return scalar.array([*distances, *numbers])

    shapes = {"row": (AT_ONCE, FEATURES + 3), "pose": (FEATURES + 1,), "tick": (1,), "found": (2 * RANKED,)}
    return trace("ranking", insert, shapes, ("found_next",))


class Starts:
    """A table of starts and the native code that ranks it.

    Attributes:
        rows: (STARTS, n + 1) joint positions and the azimuth of their pose, as `Chain.start` takes them.
    """

    def __init__(self, chain: Chain, poses_at: Callable[[np.ndarray], np.ndarray], target: Target):
        """Random positions within the limits, the same each time; `poses_at`: (k, n) → (k, 4, 4) of the frame."""
        self.chain = chain
        positions = random_positions(chain, STARTS)
        poses = poses_at(positions)
        azimuths = chain.azimuths(poses[:, :3, 3])[:, None]
        self.rows = np.concatenate([positions, azimuths], axis=1)
        features = chain.features(poses)
        square = 0.5 * (features**2).sum(axis=1, keepdims=True)
        table = np.concatenate([features, square, positions[:, :1], azimuths], axis=1)
        self._table = np.ascontiguousarray(table[:NEAREST_OF])
        self._loop = Loop((Table("row", AT_ONCE * (FEATURES + 3)), Call(ranking(chain))), target)

    def ranked(self, tasks: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """(k, RANKED) numbers of the rows that are nearest to each pose, as floats."""
        lanes = self._loop.lanes(len(tasks))
        lanes.set("pose", np.concatenate([self.chain.features(poses), tasks[:, 12:13]], axis=1))
        lanes.set("found", np.repeat([np.inf, 0.0], RANKED))
        self._loop.run(lanes, 0.0, (0, len(self._table) // AT_ONCE), tables={"row": self._table})
        return np.ascontiguousarray(lanes.get("found")[:, RANKED:])


def random_positions(chain: Chain, count: int) -> np.ndarray:
    """(count, n) joint positions, evenly within the limits; a whole turn, or a metre, where there is none."""
    from scipy.stats import qmc

    low, high = chain.limits
    half = np.where([body.kind == "revolute" for body in chain.model.bodies], np.pi, 0.5)
    low = np.where(np.isfinite(low), low, np.where(np.isfinite(high), high - 2.0 * half, -half))
    high = np.where(np.isfinite(high), high, low + 2.0 * half)
    return low + qmc.Sobol(chain.n, rng=np.random.default_rng(0)).random(count) * (high - low)

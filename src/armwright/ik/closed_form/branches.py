"""All branches of a closed form as one program: positions within limits, checked by forward kinematics, and the best of them."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.ik.chain import TURN, JointChain
from armwright.ik.closed_form.geometry import Geometry
from armwright.ik.closed_form.subproblems import Turn
from armwright.ik.solutions import PoseBranches
from armwright.kernels.batch import Kernel
from armwright.kernels.target import select_target
from armwright.model import Model
from armwright.program import Program, trace
from armwright.scalar import Array, Scalar
from armwright.spatial import Placement

BEYOND = 1e-9  # [rad] past a limit where a position is put onto the limit; the pose is checked after that


def branches_program(chain: JointChain, geometry: Geometry, near: bool) -> Program:
    """Program  target, tolerance[, wanted] → q, position_error, angle_error, margin, solved, best.

    target: (4, 4) pose. tolerance: on its errors [m | rad]. wanted: (n,) positions to be near to [rad]. Of every branch q
    (8, n), and (8,) its errors, margin and 1 where it is a solution. best: (n + 4,) q, errors and margin of the best solution
    and the number of its branch, NaN and -1 where there is none: the one nearest to what is wanted, or else the one that is
    farthest from the limits.
    """
    n, rest = chain.n, np.clip(0.0, *chain.limits)

    def find(target: Array, tolerance: Array, wanted: Array = rest) -> tuple[np.ndarray, ...]:
        instead = [Turn.by(wanted[i] + geometry.offsets[i]) for i in range(n)]
        pose = Placement(target[:3, :3], target[:3, 3] * (1.0 / geometry.links.length))
        rows, solved, least = [], [], np.inf
        best = scalar.array([*[np.nan] * (n + 3), -1.0])
        for number, turns in enumerate(geometry.positions(pose, instead)):
            q = _within(chain, [turn.angle for turn in turns] - geometry.offsets, wanted)
            position, angle = chain.errors(q, target)
            margin = chain.margin(q)
            met = scalar.less_equal(scalar.maximum(position, angle), tolerance[0])
            solved.append(met * scalar.less_equal(0.0, margin))
            away = q - wanted
            cost = scalar.where(solved[-1], away @ away if near else -margin, np.inf)
            better = scalar.less(cost, least)
            least = scalar.where(better, cost, least)
            rows.append([*q, position, angle, margin])
            row = scalar.array([*rows[-1], float(number)])
            best = scalar.array([scalar.where(better, x, y) for x, y in zip(row, best, strict=True)])
        table = scalar.array(rows)
        return table[:, :n], table[:, n], table[:, n + 1], table[:, n + 2], scalar.array(solved), best

    shapes = {"target": (4, 4), "tolerance": (1,)} | ({"wanted": (n,)} if near else {})
    outputs = ("q", "position_error", "angle_error", "margin", "solved", "best")
    return trace("closed_form", find, shapes, outputs)


def _within(chain: JointChain, q: Array, wanted: Array) -> np.ndarray:
    """Positions with whole turns added: within the limits where that can be, and then near to what is wanted."""
    moved = []
    for i, (low, high) in enumerate(zip(*chain.limits, strict=True)):
        if chain.turns_around[i]:
            middle = scalar.clip(wanted[i], low, high)
            x = _turned(q[i], middle)
            if np.isfinite(high):
                x = scalar.where(scalar.less(high + BEYOND, x), x - TURN, x)
            if np.isfinite(low):
                x = scalar.where(scalar.less(x, low - BEYOND), x + TURN, x)
        elif np.isfinite(low) and np.isfinite(high):
            x = _turned(q[i], 0.5 * (low + high))
        else:
            x = _turned(q[i], low + np.pi if np.isfinite(low) else high - np.pi)
        clipped = scalar.clip(x, low, high)
        moved.append(scalar.where(scalar.less(scalar.abs(x - clipped), BEYOND), clipped, x))
    return scalar.array(moved)


def _turned(angle: Scalar, middle: Scalar) -> Scalar:
    """The angle within half a turn of another."""
    return angle - TURN * scalar.floor((angle - middle) * (1.0 / TURN) + 0.5)


class ClosedForm:
    """An arm's closed form for one of its frames in native code.

    Attributes:
        geometry: of its axes.   kind: what it is called.
    """

    kind = "closed form"

    def __init__(self, model: Model, frame: str | None, geometry: Geometry, near: bool):
        self.geometry, self.near = geometry, near
        chain = JointChain(model, frame, 1.0)
        self._limits, self._joints = np.array(chain.limits), tuple(model.names)
        self._kernel = Kernel(branches_program(chain, geometry, near), select_target())

    def solve(
        self, poses: np.ndarray, near: np.ndarray | None, tolerance: float, threads: int
    ) -> tuple[PoseBranches, np.ndarray]:
        """All branches of poses (k, 4, 4) and the best of each (k, n + 4), see `branches_program`."""
        inputs = [poses, np.array([tolerance])] + ([near] if self.near else [])
        q, position, angle, margin, solved, best = self._kernel(*inputs, threads=threads)
        return PoseBranches(q, solved == 1.0, position, angle, margin, self._limits, self._joints), best

"""Closed forms of arms with almost exact geometry, such as 1.5708 for π/2: branches of the ideal arm, then iterations."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from armwright.ik.chain import Chain
from armwright.ik.closed_form.branches import BEYOND, ClosedForm
from armwright.ik.closed_form.geometry import NEARLY, Geometry, geometry_of
from armwright.ik.descent import descent
from armwright.ik.solutions import PoseBranches
from armwright.kernels.batch import Kernel
from armwright.kernels.loop import LoopArrays, NativeLoop, Tasks
from armwright.kernels.stages import Call, Exchange
from armwright.kernels.target import select_target
from armwright.model import Model
from armwright.program import trace

POLISHED = 1e-12  # [m and rad], where a descent ends
AWAY = 0.1  # [rad]: a descent that ends farther from its branch has left it
POLISHED_ON = 4096  # targets of one call of native code


class NearlyClosedForm(ClosedForm):
    """The branches of the ideal arm, each moved on to the pose by a descent of the arm itself, without limits.

    Close to singular poses, where the branches of the two differ by the root of what the axes are off, one can be missed.
    """

    kind = "closed form of nearly this arm, polished"

    def __init__(self, model: Model, frame: str | None, geometry: Geometry, near: bool):
        super().__init__(model, frame, geometry, near)
        n, self._target = model.n, select_target()
        self._chain = Chain(model, frame, geometry.links.length / 3.0, bounds=(np.full(n, -np.inf), np.full(n, np.inf)))
        exchange = Exchange(self._chain.task_size + n, n + 1, n + 3, 1, 1)
        self._loop = NativeLoop((exchange, Call(descent(self._chain, POLISHED, near=True))), self._target)
        limited = Chain(model, frame, 1.0)
        self._errors = Kernel(
            trace("errors", lambda q, pose: (*limited.errors(q, pose), limited.margin(q)), {"q": (n,), "pose": (4, 4)},
                  ("position", "angle", "margin")), self._target
        )  # fmt: skip

    def solve(
        self, poses: np.ndarray, near: np.ndarray | None, tolerance: float, threads: int
    ) -> tuple[PoseBranches, np.ndarray]:
        """All branches of poses (k, 4, 4) and the best of each (k, n + 4), see `branches_program`."""
        ideal = super().solve(poses, near, tolerance, threads)[0]
        count, n = len(poses), ideal.q.shape[2]
        begin, targets = ideal.q.reshape(-1, n), np.repeat(poses, ideal.q.shape[1], axis=0)
        q = self._polished(begin, targets)
        q = np.where((np.abs(q - begin) < AWAY).all(axis=1, keepdims=True), q, begin)
        inside = np.clip(q, *self._limits)
        q = np.where(np.abs(q - inside) < BEYOND, inside, q)
        position, angle, margin = self._errors(q, targets)
        solved = (np.maximum(position, angle) <= tolerance) & (margin >= 0.0)
        cost = -margin if near is None else ((q - np.repeat(near, len(q) // max(count, 1), axis=0)) ** 2).sum(axis=1)
        q = q.reshape(ideal.q.shape)
        position, angle, margin, solved, cost = (
            each.reshape(ideal.success.shape) for each in (position, angle, margin, solved, cost)
        )
        branch = np.where(solved, cost, np.inf).argmin(axis=1)
        row = np.arange(count)
        numbers = [values[row, branch][:, None] for values in (position, angle, margin)]
        best = np.concatenate([q[row, branch], *numbers, branch[:, None]], axis=1)
        best[~solved.any(axis=1)] = [*[np.nan] * (n + 3), -1.0]
        return PoseBranches(q, solved, position, angle, margin, self._limits, self._joints), best

    def _polished(self, begin: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """(k, n) ends of descents from positions (k, n) to targets (k, 4, 4)."""
        results = np.empty((len(begin), begin.shape[1] + 3))
        for first in range(0, len(begin), POLISHED_ON):
            part = slice(first, first + POLISHED_ON)
            tasks = np.concatenate([self._chain.tasks(targets[part]), begin[part]], axis=1)
            lanes = self._loop.lanes(self._target.width)
            lanes.blocks["over"].fill(2.0)
            lanes.blocks["task_number"].fill(-1.0)
            none = np.zeros((1, begin.shape[1] + 1))
            work = Tasks(np.array([0, len(tasks)]), tasks, none, np.zeros((len(tasks), 1)), results[part])
            self._loop.run(lanes, 0.0, (0, 2**62), LoopArrays(tasks=work))
        return results[:, : begin.shape[1]]


@lru_cache(maxsize=16)
def closed_form(model: Model, frame: str | None, near: bool) -> ClosedForm | None:
    """The closed form of an arm, cached; polished by iterations for an almost exact geometry; None if there is none."""
    geometry = geometry_of(model, frame)
    if geometry is not None:
        return ClosedForm(model, frame, geometry, near)
    geometry = geometry_of(model, frame, NEARLY)
    return None if geometry is None else NearlyClosedForm(model, frame, geometry, near)

"""Inverse kinematics by descent from many starts, in native code: every lane works on a target until it is solved."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, lru_cache

import numpy as np

from armwright.ik.chain import JointChain
from armwright.ik.descent import descent
from armwright.ik.starts import RANKED, Starts
from armwright.ik.task_loop import TaskLoop
from armwright.kernels.compiled import compile_arm
from armwright.kernels.target import select_target
from armwright.kinematics.aim import Aim
from armwright.kinematics.reach import turn_length
from armwright.model import Model

ATTEMPTS = 1000  # starts of one target, at most
CHUNK = 8192  # targets of one call of native code
MARGIN = 0.3  # of the tolerance: where a descent ends


class PoseSolver:
    """The native code that solves an arm's targets, made once for each arm, frame, aim and tolerance."""

    def __init__(self, chain: JointChain, tolerance: float, near: bool):
        self.chain, self.tolerance = chain, MARGIN * tolerance
        options = {} if chain.frame is None else {"frame": chain.frame}
        poses = compile_arm(chain.model).kernel("forward_kinematics", **options)
        self.starts = Starts(chain, poses, select_target())
        # the first attempt is the given start
        self._loop = TaskLoop(descent(chain, self.tolerance, near), ATTEMPTS, RANKED + near)

    def solve(
        self, poses: np.ndarray, near: np.ndarray | None, threads: int, ranks: np.ndarray | None = None
    ) -> np.ndarray:
        """(k, n + 3): joint positions, squared error [m²], iterations and attempts for poses (k, 4, 4).

        Args:
            poses: where to.   near: (k, n) positions to begin with, of a solver that takes them.
            threads: for large batches.   ranks: (RANKED,) starts to try first, in place of those nearest to each pose.
        """
        results = np.empty((len(poses), self.chain.n + 3))

        def solve_part(first: int) -> None:
            part = slice(first, first + CHUNK)
            results[part] = self._solve(poses[part], None if near is None else near[part], ranks)

        firsts = range(0, len(poses), CHUNK)
        if threads == 1 or len(firsts) == 1:
            for each in firsts:
                solve_part(each)
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(solve_part, firsts))
        return results

    @cached_property
    def _long_descent(self) -> TaskLoop:
        """One long descent from given positions."""
        return TaskLoop(descent(self.chain, self.tolerance, near=True, patient=True))

    def nearest(self, poses: np.ndarray, q: np.ndarray) -> np.ndarray:
        """(k, n) positions as near to poses out of reach as a long descent from positions (k, n) comes."""
        tasks = np.concatenate([self.chain.tasks(poses), q], axis=1)
        return self._long_descent.run(tasks)[:, : self.chain.n]

    def judged(
        self, q: np.ndarray, poses: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """(k,) True where positions (k, n) within the limits bring the frame to poses (k, 4, 4); the errors [m], [rad]; margins.

        False where there are no positions (NaN).
        """
        position, angle, margin = self.chain.judge(q, poses)
        return (position <= tolerance) & (angle <= tolerance) & (margin >= 0.0), position, angle, margin

    def _solve(self, poses: np.ndarray, near: np.ndarray | None, given: np.ndarray | None) -> np.ndarray:
        tasks, features = self.chain.places(poses)
        ranks = self.starts.ranked(tasks, features) if given is None else np.tile(given, (len(tasks), 1))
        if near is not None:
            tasks, ranks = np.concatenate([tasks, near], axis=1), np.concatenate([ranks[:, :1], ranks], axis=1)
        return self._loop.run(tasks, self.starts.rows, ranks)


@lru_cache(maxsize=16)
def solver(
    model: Model, frame: str | None, aim: Aim, tolerance: float, near: bool, length: float | None = None
) -> PoseSolver:
    """The solver of an arm, kept for the next call; `length`: [m/rad] of angles, by default a third of the reach."""
    radian = turn_length(model, frame) if length is None else float(length)
    return PoseSolver(JointChain(model, frame, radian, aim), tolerance, near)

"""Several solutions of a target, different ones, the best by a secondary goal first."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from armwright.ik.chain import TURN, Chain
from armwright.ik.goals import Goal, goal_search
from armwright.ik.measures import limit_margin
from armwright.ik.starts import NEAREST_OF, RANKED, STARTS
from armwright.kernels.loop import LoopArrays, NativeLoop, Tasks
from armwright.kernels.stages import Call, Exchange
from armwright.kernels.target import Target

if TYPE_CHECKING:
    from armwright.ik.solve import Solver

DESCENTS, EACH = 16, 4  # from different starts: at least; for every solution that is asked for
STRIDE = 5  # rows of the table from the first start of a descent to that of the next
DIFFERENT = 0.05  # [rad | m]: solutions whose joints are all closer than this are one


class GoalSearch:
    """Native code that moves solutions within their poses until a goal grows no better."""

    def __init__(self, chain: Chain, goal: Goal, tolerance: float, target: Target):
        """Search for one chain and goal; tolerance [m | rad] on poses, which positions must meet before."""
        self.chain, self.target = chain, target
        size, n = chain.task_size + 2 * chain.n, chain.n
        program = goal_search(chain, goal, tolerance)
        self._loop = NativeLoop((Exchange(size, 1, n + 2, 1, 1), Call(program)), self.target)

    def improved(self, tasks: np.ndarray, q: np.ndarray, preferred: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (k, n) and goals (k,) from solutions (k, n) of tasks (k, 13)."""
        lanes, count = self._loop.lanes(self.target.width), len(tasks)
        lanes.blocks["over"].fill(2.0)
        lanes.blocks["task_number"].fill(-1.0)
        results = np.empty((count, self.chain.n + 2))
        every = np.ascontiguousarray(np.concatenate([tasks, q, preferred], axis=1))
        work = Tasks(np.array([0, count]), every, np.zeros((1, 1)), np.zeros((count, 1)), results)
        self._loop.run(lanes, 0.0, (0, 2**62), LoopArrays(tasks=work))
        return self.chain.wrapped(results[:, : self.chain.n].T).T, results[:, self.chain.n]


goal_searcher = lru_cache(maxsize=16)(GoalSearch)


def descended(
    solver: Solver, near_solver: Solver | None, poses: np.ndarray, near: np.ndarray | None, count: int, threads: int
) -> np.ndarray:
    """Candidates (k, d, n) for `count` different solutions of poses (k, 4, 4), by descents from different starts."""
    parts = [] if near_solver is None else [near_solver.solve(poses, near, threads)]
    parts.append(solver.solve(poses, None, threads))
    parts += [solver.solve(poses, None, threads, ranks=_ranks(k)) for k in range(max(DESCENTS, EACH * count) - 1)]
    return np.stack(parts, axis=1)[..., : solver.chain.n]


def best_different(
    solver: Solver,
    poses: np.ndarray,
    candidates: np.ndarray,
    near: np.ndarray | None,
    goal: Goal | None,
    count: int,
    tolerance: float,
) -> np.ndarray:
    """Positions (k, count, n): the best distinct solutions among candidates (k, d, n), best first; NaN if fewer.

    The first of a target without a solution has the candidate that comes nearest.
    """
    chain, each = solver.chain, candidates.shape[1]
    q, targets = candidates.reshape(-1, chain.n).copy(), np.repeat(poses, each, axis=0)
    wanted = None if near is None else np.repeat(near, each, axis=0)
    solved, off = solver.solved(q, targets, tolerance)
    order = -limit_margin(chain.model, q)
    if goal is not None and solved.any():
        search = goal_searcher(chain, goal, solver.tolerance, solver.target)
        preferred = np.zeros_like(q) if wanted is None else wanted
        moved, order[solved] = search.improved(chain.tasks(targets[solved]), q[solved], preferred[solved])
        still, _ = solver.solved(moved, targets[solved], tolerance)
        q[np.flatnonzero(solved)[still]] = moved[still]
    if wanted is not None:
        q = chain.nearest_turns(q, wanted)
        if goal is None:
            order = np.abs(q - wanted).max(axis=1)
    order = np.where(solved, order, np.inf)
    shape = candidates.shape[:2]
    kept = _different(chain, q.reshape(candidates.shape), order.reshape(shape), count)
    off = np.where(np.isfinite(off), off, np.inf).reshape(shape)
    missed = np.isnan(kept[:, 0]).any(axis=1) & np.isfinite(off).any(axis=1)
    if missed.any():
        closest = q.reshape(candidates.shape)[missed, off[missed].argmin(axis=1)]
        kept[missed, 0] = solver.nearest(poses[missed], closest)
    return kept


def _ranks(descent: int) -> np.ndarray:
    """(RANKED,) rows of the table of starts that a further descent tries first, behind those that are ranked by distance.

    An odd number apart: every second or fourth point of a Sobol sequence lies in the same half or quarter of all of them.
    """
    return ((NEAREST_OF + STRIDE * descent + np.arange(RANKED)) % STARTS).astype(float)


def _different(chain: Chain, q: np.ndarray, order: np.ndarray, count: int) -> np.ndarray:
    """(k, count, n): of solutions (k, d, n) with finite order, those that differ, in that order; NaN behind them."""
    rows = np.arange(len(q))
    kept = np.full((len(q), count, chain.n), np.nan)
    order = order.copy()
    for place in range(count):
        best = order.argmin(axis=1)
        some = np.isfinite(order[rows, best])
        kept[some, place] = q[rows, best][some]
        apart = q - q[rows, best][:, None]
        apart = np.where(chain.turns_around, apart - TURN * np.round(apart / TURN), apart)
        order[np.abs(apart).max(axis=2) < DIFFERENT] = np.inf
        order[rows, best] = np.inf
    return kept

"""Several solutions of a target, different ones, the best by a secondary goal first."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from armwright.ik.chain import TURN, JointChain
from armwright.ik.goals import Best, goal_search
from armwright.ik.measures import limit_margin
from armwright.ik.solver import PoseSolver
from armwright.ik.starts import NEAREST_OF, RANKED, STARTS
from armwright.ik.task_loop import TaskLoop

DESCENTS, EACH = 16, 4  # from different starts: at least; for every solution that is asked for
STRIDE = 5  # rows of the table from the first start of a descent to that of the next
DIFFERENT = 0.05  # [rad | m]: solutions whose joints are all closer than this are one


@lru_cache(maxsize=16)
def goal_loop(chain: JointChain, best: Best, tolerance: float) -> TaskLoop:
    """Native code that moves solutions within their poses, met to a tolerance [m | rad], until a goal grows no better."""
    return TaskLoop(goal_search(chain, best, tolerance))


def descended(
    solver: PoseSolver,
    near_solver: PoseSolver | None,
    poses: np.ndarray,
    near: np.ndarray | None,
    count: int,
    threads: int,
) -> np.ndarray:
    """Candidates (k, d, n) for `count` different solutions of poses (k, 4, 4), by descents from different starts."""
    parts = [] if near_solver is None else [near_solver.solve(poses, near, threads)]
    parts.append(solver.solve(poses, None, threads))
    parts += [solver.solve(poses, None, threads, ranks=_ranks(k)) for k in range(max(DESCENTS, EACH * count) - 1)]
    return np.stack(parts, axis=1)[..., : solver.chain.n]


def best_different(
    solver: PoseSolver,
    poses: np.ndarray,
    candidates: np.ndarray,
    near: np.ndarray | None,
    goal: Best | None,
    count: int,
    tolerance: float,
) -> np.ndarray:
    """Positions (k, count, n): the best distinct solutions among candidates (k, d, n), best first; NaN if fewer.

    The first of a target without a solution has the candidate that comes nearest.
    """
    chain, each = solver.chain, candidates.shape[1]
    q, targets = candidates.reshape(-1, chain.n).copy(), np.repeat(poses, each, axis=0)
    wanted = None if near is None else np.repeat(near, each, axis=0)
    solved, position, angle, margin = solver.judged(q, targets, tolerance)
    off = np.where(margin >= 0.0, np.hypot(position, chain.weight * angle), np.inf)  # also where there are no positions
    order = -limit_margin(chain.model, q)
    if goal is not None and solved.any():
        preferred = np.zeros_like(q) if wanted is None else wanted
        tasks = np.concatenate([chain.tasks(targets[solved]), q[solved], preferred[solved]], axis=1)
        improved = goal_loop(chain, goal, solver.tolerance).run(tasks)
        moved, order[solved] = chain.wrapped(improved[:, : chain.n].T).T, improved[:, chain.n]
        still = solver.judged(moved, targets[solved], tolerance)[0]
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

    Rows that follow one another lie far apart in every joint.
    """
    return ((NEAREST_OF + STRIDE * descent + np.arange(RANKED)) % STARTS).astype(float)


def _different(chain: JointChain, q: np.ndarray, order: np.ndarray, count: int) -> np.ndarray:
    """(k, count, n): of solutions (k, d, n) with finite order, those that differ, in that order; NaN behind them."""
    rows = np.arange(len(q))
    kept = np.full((len(q), count, chain.n), np.nan)
    order = order.copy()
    for place in range(count):
        best = order.argmin(axis=1)
        some = np.isfinite(order[rows, best])
        kept[some, place] = q[rows, best][some]
        difference = q - q[rows, best][:, None]
        difference = np.where(chain.turns_around, difference - TURN * np.round(difference / TURN), difference)
        order[np.abs(difference).max(axis=2) < DIFFERENT] = np.inf
        order[rows, best] = np.inf
    return kept

"""Nonlinear least squares by Levenberg and Marquardt's method, many searches side by side. [Marquardt1963]

    (JᵀJ + λ diag JᵀJ) δ = −Jᵀ e,    λ smaller behind a step that lowers eᵀe, larger behind one that does not and is undone

Every search is a lane with a damping λ of its own. What differs between problems are parts: the `Damping`, the step from a point
to the next (`move`: bounds, a longest step), and the `ends` of a search. Infinite errors refuse a point.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Evaluate = Callable[
    [np.ndarray], tuple[np.ndarray, np.ndarray]
]  # points (lanes, k) → errors (lanes, m), J (lanes, m, k)
Ends = Callable[
    [np.ndarray, np.ndarray, np.ndarray], np.ndarray
]  # gained, cost, (J δ)² of accepted steps (lanes,) → (lanes,)
ROUNDS = 60  # accepted steps of a lane at most


@dataclass(frozen=True)
class Damping:
    """Damping of a search: `better` and `worse` are its factors behind a step that helps and one that does not.

    Beyond `most` no step helps any more: the lane is at a minimum to rounding, or at the edge of what is allowed.
    """

    first: float = 1e-3
    better: float = 0.1
    worse: float = 4.0
    least: float = 1e-12
    most: float = 1e10


USUAL = Damping()


def cost_of(errors: np.ndarray) -> np.ndarray:
    """eᵀe (lanes,), infinite where it is no number."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.nan_to_num(np.einsum("lm,lm->l", errors, errors), nan=np.inf)


@dataclass(frozen=True, eq=False)
class Descent:
    """Searches and how far they are.

    Attributes:
        x: (lanes, k).   errors: (lanes, m).   jacobian: (lanes, m, k).   damping: (lanes,).   ended: (lanes,) bool.
    """

    x: np.ndarray
    errors: np.ndarray
    jacobian: np.ndarray
    damping: np.ndarray
    ended: np.ndarray

    @classmethod
    def begin(cls, evaluate: Evaluate, x: np.ndarray, first: float = USUAL.first) -> Descent:
        """Searches from points (lanes, k)."""
        return cls(x, *evaluate(x), np.full(len(x), first), np.zeros(len(x), dtype=bool))

    @property
    def cost(self) -> np.ndarray:
        """(lanes,) eᵀe."""
        return cost_of(self.errors)

    def only(self, lanes: np.ndarray) -> Descent:
        """Some of the searches."""
        return Descent(*(each[lanes] for each in vars(self).values()))


def descended(
    evaluate: Evaluate,
    begun: Descent,
    *,
    damping: Damping = USUAL,
    move: Callable[[np.ndarray, np.ndarray], np.ndarray] = np.add,
    ends: Ends,
    rounds: int = ROUNDS,
    trials: float = np.inf,
) -> Descent:
    """The searches behind further steps.

    Args:
        evaluate: errors and their derivatives.   begun: where they are.   move: (x, δ) → the next points.
        ends: whether a lane's accepted step was its last, by what it gained, the cost and the squares of what it moves.
        rounds: accepted steps of any lane.   trials: steps, accepted or not.
    """
    now, accepted = begun, np.zeros(len(begun.x), dtype=int)
    while not now.ended.all() and accepted.max() < rounds and trials > 0:
        trials -= 1
        size = np.maximum(np.linalg.norm(now.jacobian, axis=1), 1e-300)
        unit = now.jacobian / size[:, None]
        normal = np.matmul(unit.transpose(0, 2, 1), unit)
        damped = normal + now.damping[:, None, None] * np.eye(size.shape[1])
        step = np.linalg.solve(damped, -np.einsum("lmk,lm->lk", unit, now.errors)[..., None])[..., 0]
        x = move(now.x, step / size)
        errors, jacobian = evaluate(x)
        cost, new = now.cost, cost_of(errors)
        better = (new <= cost) & ~now.ended
        moved = np.einsum("lj,ljk,lk->l", step, normal, step)
        ended = now.ended | (better & ends(cost - new, new, moved)) | (~better & (now.damping >= damping.most))
        factor = np.where(better, damping.better, damping.worse)
        now = Descent(
            np.where(better[:, None], x, now.x),
            np.where(better[:, None], errors, now.errors),
            np.where(better[:, None, None], jacobian, now.jacobian),
            np.clip(now.damping * factor, damping.least, damping.most),
            ended,
        )
        accepted += better
    return now

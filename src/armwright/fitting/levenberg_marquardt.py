"""Nonlinear least squares by Levenberg and Marquardt's method, many searches side by side. [Marquardt1963]

    (JᵀJ + λ diag JᵀJ) δ = −Jᵀ e,    λ smaller behind a step that lowers eᵀe, larger behind one that does not and is undone

Every search is a lane with a damping λ of its own. What differs between problems are parts: the `Damping`, the step from a point
to the next (`move`, or a `box` within which δ is least), and the `ends` of a search. Infinite errors refuse a point.

A narrow valley that bends is left by a straight step. With the second derivative e″ along δ, by the errors at its end, the step
follows the bend: δ + a / 2, (JᵀJ + λ diag JᵀJ) a = −Jᵀ e″. [TranstrumSethna2012]
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

# points (lanes, k) → errors (lanes, m), J (lanes, m, k)
Evaluate = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
# gained, cost, (J δ)² of accepted steps (lanes,) → (lanes,)
Ends = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
Errors = Callable[[np.ndarray], np.ndarray]  # points (points, k) → errors (points, m)
Box = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # points (lanes, k) → least and largest δ (lanes, k)
ROUNDS = 60  # accepted steps of a lane at most


@dataclass(frozen=True)
class Damping:
    """Damping of a search: `better` and `worse` are its factors behind a step that helps and one that does not.

    Where steps are compared, that of the best one takes the place of `better`.

    Beyond `most` no step helps any more: the lane is at a minimum to rounding, or at the edge of what is allowed.
    `tried` are factors of λ whose steps are compared, where errors alone cost less than their derivatives.
    """

    first: float = 1e-3
    better: float = 0.1
    worse: float = 4.0
    least: float = 1e-12
    most: float = 1e10
    tried: tuple[float, ...] = (0.1, 1.0, 10.0)


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
    box: Box | None = None,
    errors: Errors | None = None,
) -> Descent:
    """The searches behind further steps.

    Args:
        evaluate: errors and their derivatives.   begun: where they are.   move: (x, δ) → the next points.
        ends: whether a lane's accepted step was its last, by what it gained, the cost and the squares of what it moves.
        rounds: accepted steps of any lane.   trials: steps, accepted or not.
        box: within which δ is the least-squares step; None: anywhere. A step that is cut off at a bound leaves a narrow valley.
        errors: by which the steps of `damping.tried`, straight and bent, are compared; None: the step of λ is taken. Where none
            of these helps, and the best loses no more than a last step gains, the lane has ended.
    """
    now, accepted = begun, np.zeros(len(begun.x), dtype=int)
    while not now.ended.all() and accepted.max() < rounds and trials > 0:
        trials -= 1
        here = _Linear.at(now, box)
        level, step = now.damping, here.solved(now.damping[:, None], -here.slope[:, None])[:, 0]
        if errors is not None:
            level, step = _compared(now, here, damping.tried, move, errors)
        x = move(now.x, step / here.size)
        new_errors, jacobian = evaluate(x)
        cost, new = now.cost, cost_of(new_errors)
        better = (new <= cost) & ~now.ended
        moved = np.einsum("lj,ljk,lk->l", step, here.normal, step)
        last = ends(np.where(better, cost - new, new - cost), new, moved)
        spent = now.damping >= damping.most
        ended = now.ended | np.where(better, last, spent if errors is None else spent | last)
        factor = np.where(better, damping.better if errors is None else 1.0, damping.worse)
        now = Descent(
            np.where(better[:, None], x, now.x),
            np.where(better[:, None], new_errors, now.errors),
            np.where(better[:, None, None], jacobian, now.jacobian),
            np.clip(level * factor, damping.least, damping.most),
            ended,
        )
        accepted += better
    return now


@dataclass(frozen=True, eq=False)
class _Linear:
    """The linear problems at the points of searches, in steps scaled by the size of their columns.

    Attributes:
        size: (lanes, k) norms of J's columns.   unit: (lanes, m, k) J / size.   normal: (lanes, k, k) unitᵀ unit.
        slope: (lanes, k) unitᵀ e.   low, high: (lanes, k) of scaled steps; None: without bounds.
    """

    size: np.ndarray
    unit: np.ndarray
    normal: np.ndarray
    slope: np.ndarray
    low: np.ndarray | None
    high: np.ndarray | None

    @classmethod
    def at(cls, now: Descent, box: Box | None) -> _Linear:
        """At the points where searches are."""
        size = np.maximum(np.linalg.norm(now.jacobian, axis=1), 1e-300)
        unit = now.jacobian / size[:, None]
        low, high = (None, None) if box is None else (each * size for each in box(now.x))
        normal = np.matmul(unit.transpose(0, 2, 1), unit)
        return cls(size, unit, normal, np.einsum("lmk,lm->lk", unit, now.errors), low, high)

    def solved(self, levels: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Scaled steps (lanes, tried, k) of least cost in the box:  (normal + λ) δ = right.

        Args:
            levels: (lanes, tried) λ.   right: (lanes, tried, k).
        """
        damped = self.normal[:, None] + levels[:, :, None, None] * np.eye(self.size.shape[1])
        steps = np.linalg.solve(damped, right[..., None])[..., 0]
        if self.low is None or self.high is None:
            return steps
        beyond = ((steps < self.low[:, None]) | (steps > self.high[:, None])).any(axis=2)
        for lane, tried in np.argwhere(beyond):
            root = np.linalg.cholesky(damped[lane, tried]).T  # ‖root (δ − step)‖² is the cost above its least
            bounds = (self.low[lane], self.high[lane])
            steps[lane, tried] = lsq_linear(root, root @ steps[lane, tried], bounds, method="bvls").x
        return steps


def _compared(
    now: Descent,
    here: _Linear,
    tried: Sequence[float],
    move: Callable[[np.ndarray, np.ndarray], np.ndarray],
    errors: Errors,
) -> tuple[np.ndarray, np.ndarray]:
    """The damping (lanes,) and the scaled step (lanes, k) of least cost, of straight steps and of such that follow the bend."""
    lanes, k = now.x.shape
    levels = now.damping[:, None] * np.array(tried)

    def behind(steps: np.ndarray) -> np.ndarray:
        points = move(now.x[:, None], steps / here.size[:, None])
        return errors(points.reshape(-1, k)).reshape(lanes, -1, now.errors.shape[1])

    right = np.repeat(-here.slope[:, None], len(tried), axis=1)
    straight = here.solved(levels, right)
    wrong = behind(straight)
    rest = wrong - now.errors[:, None] - np.matmul(straight, here.unit.transpose(0, 2, 1))  # e″ / 2
    bent = here.solved(levels, right - np.matmul(np.nan_to_num(rest, posinf=0.0, neginf=0.0), here.unit))
    every, wrong = np.concatenate([straight, bent], axis=1), np.concatenate([wrong, behind(bent)], axis=1)
    best = np.argmin(cost_of(wrong.reshape(-1, wrong.shape[2])).reshape(lanes, -1), axis=1)
    return levels[np.arange(lanes), best % len(tried)], every[np.arange(lanes), best]

"""One iteration of the search for joint positions, by damped least squares within joint limits. [Marquardt1963]

    (Jᵀ J + λ |e|² 1) s = Jᵀ e,    q += s

The damping falls with the squared error, so that steps are short far from the target, the last ones are Gauss-Newton's, and
nothing depends on the size of the arm. [Sugihara2011]

A lane descends from a start to a solution or gives up and takes another start; see `kernels.stages.Exchange`. The error of a
pose is (p* - p, w φ) with φ the rotation vector from the pose to its target and w a length that turns an angle into one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.ik.chain import JointChain, unlimited
from armwright.ik.family import Family
from armwright.program import Program, trace
from armwright.scalar import Array, Scalar

DAMPING, INCREASE = 0.1, 4.0  # λ at first [1/rad² | 1/m²]; its factor after a step that did not help
MOST = 1e4  # of λ; with more of it an attempt is given up
SLOW = 0.9  # share of the squared error that a step leaves where an attempt is given up
ITERATIONS = 24  # of one attempt
# Close to the target, nearer than this share of a radian's length: at a singular pose the last way leads along a curved valley,
# where errors grow for a step before they fall. So the squared error may grow by this factor, λ falls, and nothing is slow.
CLOSE, GROWTH, FALL, PATIENCE = 1e-3, 10.0, 0.2, 40
# The same as SLOW and ITERATIONS, and λ's factor after a step that helped, of a patient descent.
STEADY, LONG, DECREASE = 1.0 - 1e-9, 400, 0.1
TINY = 1e-14  # [m²] on the diagonal, so that no direction is without resistance


@dataclass(frozen=True)
class LaneState:
    """Places of what a lane remembers, in its block "state": entries by name, in order."""

    sizes: dict[str, int]

    def split(self, state: Array) -> dict[str, Array]:
        """The state by names."""
        ends = np.cumsum(list(self.sizes.values()))
        parts = np.split(np.asarray(state), ends[:-1])
        return dict(zip(self.sizes, parts, strict=True))

    def joined(self, parts: dict[str, Array]) -> np.ndarray:
        """The other way round."""
        return scalar.array(np.concatenate([np.asarray(parts[name]).reshape(-1) for name in self.sizes]))

    @property
    def size(self) -> int:
        """All entries."""
        return sum(self.sizes.values())


def descent(arms: JointChain | Family, tolerance: float, near: bool, patient: bool = False) -> Program:
    """Program  task, attempt, fresh, state → state_next, over, fresh_next, result  of one iteration.

    task: what `JointChain.tasks` makes of a pose, and the joint positions to begin with where `near`. attempt: a start's row, as
    `JointChain.start` has it. result: joint positions, squared error [m²], iterations,
    attempts.

    Args:
        arms: the arm, or all arms of a structure.   tolerance: on the error where a descent ends [m | rad].
        near: the first attempt begins there.   patient: a slow descent goes on, to the nearest pose of a target out of reach.
    """
    n = arms.n
    numbers = dict.fromkeys(("cost", "damping", "iterations", "least", "spent", "attempts"), 1)
    layout = LaneState({"q": n, "trial": n, "best": n, "slope": n, "normal": n * (n + 1) // 2} | numbers)
    weight = float(arms.weight)
    solved, close = (tolerance * min(1.0, weight)) ** 2, (CLOSE * weight) ** 2

    def step(task: Array, attempt: Array, fresh: Array, state: Array) -> tuple[np.ndarray, ...]:
        chain, old = arms.of(task), layout.split(state)
        new, first = scalar.less(0.0, fresh[0]), scalar.less(1.0, fresh[0])
        start = chain.start(task, attempt)
        if near:
            start = chosen(first, task[-n:], start)
        trial = chosen(new, start, old["trial"])
        error, slope = chain.error(trial, task)
        cost = error @ error
        before = old["cost"][0]
        may_be = before if patient else before * scalar.where(scalar.less(before, close), GROWTH, 1.0)
        better = scalar.where(new, 1.0, scalar.less(cost, may_be))
        normal, gradient = slope.T @ slope, slope.T @ error
        entries = scalar.array([normal[i, j] for i in range(n) for j in range(i + 1)])
        q = chosen(better, trial, old["q"])
        held = chosen(better, entries, old["normal"])
        downhill = chosen(better, gradient, old["slope"])
        now = scalar.where(better, cost, before)
        is_close = scalar.less(now, close)
        fall = DECREASE if patient else scalar.where(is_close, FALL, 1.0)
        damping = scalar.where(new, DAMPING, old["damping"][0] * scalar.where(better, fall, INCREASE))
        iterations = scalar.where(new, 1.0, old["iterations"][0] + 1.0)
        spent = scalar.where(first, 1.0, old["spent"][0] + 1.0)
        attempts = scalar.where(first, 1.0, old["attempts"][0] + new)
        least = scalar.where(first, np.inf, old["least"][0])
        leads = scalar.less(now, least)
        least = scalar.where(leads, now, least)
        best = chosen(leads, q, old["best"])
        share = STEADY if patient else scalar.where(is_close, GROWTH, SLOW)
        slow = scalar.where(new, 0.0, better * scalar.less(share * before, cost))
        most = float(LONG) if patient else scalar.where(is_close, float(PATIENCE), float(ITERATIONS))
        failed = slow + scalar.less(MOST, damping) + scalar.less_equal(most, iterations)
        over = scalar.where(scalar.less(least, solved), 2.0, scalar.where(scalar.less(0.0, failed), 1.0, 0.0))
        following = chain.within(q + _step(chain, q, held, downhill, damping * now))
        parts = {"q": q, "trial": following, "best": best, "slope": downhill, "normal": held}
        numbers = {"cost": now, "damping": damping, "iterations": iterations, "least": least, "spent": spent}
        numbers["attempts"] = attempts
        state_next = layout.joined(parts | {name: scalar.array([value]) for name, value in numbers.items()})
        result = scalar.array([*chain.wrapped(best), least, spent, attempts])
        return state_next, scalar.array([over]), scalar.zeros(1), result

    shapes = {"task": (arms.task_size + n * near,), "attempt": (n + 1,), "fresh": (1,), "state": (layout.size,)}
    return trace("descent", step, shapes, ("state_next", "over", "fresh_next", "result"))


def _step(chain: JointChain, q: Array, normal: Array, gradient: Array, damping: Scalar) -> np.ndarray:
    """The damped Gauss-Newton step; joints at a limit that it would cross stay there."""
    n = chain.n
    free = []
    for i in range(n):
        low, high = chain.low[i], chain.high[i]
        at_low = (
            0.0 if unlimited(low) else scalar.where(scalar.less_equal(q[i], low), scalar.less(gradient[i], 0.0), 0.0)
        )
        at_high = (
            0.0 if unlimited(high) else scalar.where(scalar.less_equal(high, q[i]), scalar.less(0.0, gradient[i]), 0.0)
        )
        free.append(1.0 - at_low - at_high)
    matrix, k = scalar.zeros(n, n), 0
    for i in range(n):
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = normal[k] * (free[i] * free[j])
            k += 1
        matrix[i, i] = matrix[i, i] + (damping + TINY) + (1.0 - free[i])
    return scalar.solve_symmetric(matrix, scalar.array([gradient[i] * free[i] for i in range(n)]))


def chosen(which: Scalar, a: Array, b: Array) -> np.ndarray:
    """a or b as a whole."""
    return scalar.array([scalar.where(which, x, y) for x, y in zip(a, b, strict=True)])

"""One iteration of the search for joint positions, by damped least squares within joint limits. [Marquardt1963]

A lane descends from a start to a solution or gives up and takes another start; see `kernels.stages.Exchange`. The error of a
pose is (p* - p, w φ) with φ the rotation vector from the pose to its target and w a length that turns an angle into one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.ik.chain import Chain, unlimited
from armwright.ik.family import Family
from armwright.program import Program, trace
from armwright.scalar import Array, Scalar

DAMPING, DECREASE, INCREASE = 1e-3, 0.1, 4.0  # at first [m²]; factors after a step that helped and one that did not
LEAST, MOST = 1e-12, 1e6  # of the damping; with more of it an attempt is given up
SLOW = 0.9  # share of the squared error that a step leaves where an attempt is given up
STEADY, LONG = 1.0 - 1e-9, 400  # the same, and iterations, of a patient descent
ITERATIONS, CLOSE, PATIENCE = (
    24,
    1e-4,
    80,
)  # of one attempt; of one that comes closer than this share of a radian's length
TINY = 1e-14  # [m²] on the diagonal, so that no direction is without resistance


@dataclass(frozen=True)
class Layout:
    """Places of what a lane remembers, in its block "state" of so many numbers."""

    n: int

    @property
    def sizes(self) -> dict[str, int]:
        """Entries by name, in order."""
        n = self.n
        scalars = dict.fromkeys(("cost", "damping", "iterations", "least", "spent", "attempts"), 1)
        return {"q": n, "trial": n, "best": n, "slope": n, "normal": n * (n + 1) // 2, **scalars}

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


def descent(arms: Chain | Family, tolerance: float, near: bool, patient: bool = False) -> Program:
    """Program  task, attempt, fresh, state → state_next, over, fresh_next, result  of one iteration.

    task: what `Chain.task` makes of a pose, and the joint positions to begin with where `near`. attempt: a start's row, as
    `Chain.starts` has it. result: joint positions, squared error [m²], iterations,
    attempts.

    Args:
        arms: the arm, or all arms of a structure.   tolerance: on the error where a descent ends [m | rad].
        near: the first attempt begins there.   patient: a slow descent goes on, to the nearest pose of a target out of reach.
    """
    share, iterations_at_most = (STEADY, LONG) if patient else (SLOW, ITERATIONS)
    layout, n = Layout(arms.n), arms.n
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
        better = scalar.where(new, 1.0, scalar.less(cost, old["cost"][0]))
        slow = scalar.where(new, 0.0, scalar.less(share * old["cost"][0], cost))
        normal, gradient = slope.T @ slope, slope.T @ error
        entries = scalar.array([normal[i, j] for i in range(n) for j in range(i + 1)])
        q = chosen(better, trial, old["q"])
        held = chosen(better, entries, old["normal"])
        downhill = chosen(better, gradient, old["slope"])
        now = scalar.where(better, cost, old["cost"][0])
        changed = old["damping"][0] * scalar.where(better, DECREASE, INCREASE)
        damping = scalar.where(new, DAMPING, scalar.maximum(changed, LEAST))
        iterations = scalar.where(new, 1.0, old["iterations"][0] + 1.0)
        spent = scalar.where(first, 1.0, old["spent"][0] + 1.0)
        attempts = scalar.where(first, 1.0, old["attempts"][0] + new)
        least = scalar.where(first, np.inf, old["least"][0])
        leads = scalar.less(now, least)
        least = scalar.where(leads, now, least)
        best = chosen(leads, q, old["best"])
        stuck = scalar.where(better, slow, 0.0) + scalar.less(MOST, damping)
        most = scalar.where(
            scalar.less(now, close), float(max(PATIENCE, iterations_at_most)), float(iterations_at_most)
        )  # a singular pose takes its time
        failed = stuck + scalar.less_equal(most, iterations)
        over = scalar.where(scalar.less(least, solved), 2.0, scalar.where(scalar.less(0.0, failed), 1.0, 0.0))
        following = chain.within(q + _step(chain, q, held, downhill, damping))
        parts = {"q": q, "trial": following, "best": best, "slope": downhill, "normal": held}
        numbers = {"cost": now, "damping": damping, "iterations": iterations, "least": least, "spent": spent}
        numbers["attempts"] = attempts
        state_next = layout.joined(parts | {name: scalar.array([value]) for name, value in numbers.items()})
        result = scalar.array([*chain.wrapped(best), least, spent, attempts])
        return state_next, scalar.array([over]), scalar.zeros(1), result

    shapes = {"task": (arms.task_size + n * near,), "attempt": (n + 1,), "fresh": (1,), "state": (layout.size,)}
    return trace("descent", step, shapes, ("state_next", "over", "fresh_next", "result"))


def _step(chain: Chain, q: Array, normal: Array, gradient: Array, damping: Scalar) -> np.ndarray:
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

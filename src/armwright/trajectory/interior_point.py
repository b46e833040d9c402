"""Shortest sum of times 1 / x under banded constraints: a primal-dual interior-point method. [WachterBiegler2006]

    min Σ 1 / x_i   with  |f(y)| ≤ most  and  g(y) = 0,   the rates x among the unknowns y.

Each f and g depends on unknowns whose numbers are near each other, so that Newton's matrix is banded and a step takes a time in
proportion to their count. g = 0 is met by the method of multipliers [FriedlanderOrban2012], which keeps that matrix positive
definite where it is so at all; elsewhere just enough is added to its diagonal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce
from itertools import islice
from typing import Any, Protocol

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

FIRST_STEPS, STEPS = 20, 45  # at least and at most
PATIENCE, SETTLED = 5, 3e-4  # last steps, and the part of the sum that they gain at least
BARRIER, LEAST_BARRIER, FALL = 0.1, 1e-6, 0.7  # weight of the slacks' logarithms, where times are about 1
FAR_ENOUGH = 0.3  # length of a step after which the barrier falls
LOOSE, LEAST_LOOSE, TIGHTER = 0.1, 1e-3, 0.8  # 1 / weight of the squares of g
TO_BOUNDARY, LEFT = 0.95, 0.01  # of a slack or a rate: the most that a step takes, and what must be left at last
SHORTER, SHORTEST = 0.7, 1e-6  # steps that are tried
SAFEGUARD = 10.0  # times or parts of barrier / slack, that a multiplier may be
CONVEX, STRONGER, STRONGEST = 0.05, 2.5, 1e4  # curvature that is added where Newton's matrix is not positive definite
PINNED = 1e12  # on the diagonal, of unknowns that stay


@dataclass(frozen=True, eq=False)
class Terms:
    """Functions of a few unknowns each, all of the same form.

    Attributes:
        value: (r, n).   at: numbers of the unknowns (r, n), one array each.   first: derivatives by them (r, n).
        second: second derivatives (r, n) or a number, by pairs (a, b), a ≤ b, of unknowns; 0 where absent.
        most: (n,) largest magnitude.
    """

    value: np.ndarray
    at: tuple[np.ndarray, ...]
    first: tuple[np.ndarray, ...]
    second: dict[tuple[int, int], Any]
    most: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __add__(self, other: Terms) -> Terms:
        """Sums, by row."""
        shifted = {(a + len(self.at), b + len(self.at)): curve for (a, b), curve in other.second.items()}
        return Terms(self.value + other.value, self.at + other.at, self.first + other.first, self.second | shifted)

    @property
    def slacks(self) -> np.ndarray:
        """(2, r, n) distances to the upper and the lower limit."""
        return np.stack([self.most - self.value, self.most + self.value])

    def change(self, step: np.ndarray) -> np.ndarray:
        """(r, n) by which the values change along a step, to first order."""
        return _sum(slope * step[at] for slope, at in zip(self.first, self.at, strict=True))

    def sums(self, weight: np.ndarray, multiplier: np.ndarray, force: np.ndarray) -> Sums:
        """force ∇f by unknown, and by pairs  weight ∇f ∇fᵀ  and  multiplier ∇²f;  all given (r, n)."""
        pairs = [(a, b) for a in range(len(self.at)) for b in range(a, len(self.at))]
        return (
            [force * slope for slope in self.first],
            {(a, b): weight * self.first[a] * self.first[b] for a, b in pairs},
            {pair: multiplier * curve for pair, curve in self.second.items()},
        )


@dataclass(frozen=True, eq=False)
class Combined:
    """Linear combinations  f_nr = Σ_k rows_knr φ_kr  of a few functions φ of the unknowns: n of them at each of r places.

    Attributes:
        rows: (n, r) factors, one array each.   values: (r,) of φ.   at: numbers of the unknowns (r,), one array each.
        first: by unknown and by number of the function the derivatives (r,), or a number; 0 where absent.
        second: by pairs of unknowns a ≤ b, and by number of the function; 0 where absent.
        most: (n, r) or less, largest value.   least: smallest one; None: -most.
    """

    rows: tuple[np.ndarray, ...]
    values: tuple[np.ndarray, ...]
    at: tuple[np.ndarray, ...]
    first: tuple[dict[int, Any], ...]
    second: dict[tuple[int, int], dict[int, Any]]
    most: Any = 1.0
    least: Any = None

    @cached_property
    def value(self) -> np.ndarray:
        """(n, r)."""
        return self._combined(dict(enumerate(self.values)))

    @property
    def slacks(self) -> np.ndarray:
        """(2, n, r) distances to the upper and the lower limit."""
        return np.stack([self.most - self.value, self.value + (self.most if self.least is None else -self.least)])

    def change(self, step: np.ndarray) -> np.ndarray:
        """(n, r) by which the values change along a step, to first order."""
        changes: dict[int, Any] = {}
        for slopes, at in zip(self.first, self.at, strict=True):
            for k, slope in slopes.items():
                changes[k] = changes.get(k, 0.0) + slope * step[at]
        return self._combined(changes)

    def sums(self, weight: np.ndarray, multiplier: np.ndarray, force: np.ndarray) -> Sums:
        """As of `Terms`, but summed over the combinations: by unknown and by pair (r,)."""
        count = range(len(self.rows))
        weighted = [weight * row for row in self.rows]
        products = {(k, m): np.einsum("nr,nr->r", weighted[k], self.rows[m]) for k in count for m in count if k <= m}
        products |= {(m, k): each for (k, m), each in products.items()}
        forces, multipliers = ([np.einsum("nr,nr->r", each, row) for row in self.rows] for each in (force, multiplier))
        first = [list(slopes.items()) for slopes in self.first]
        pairs = [(a, b) for a in range(len(first)) for b in range(a, len(first))]
        return (
            [_sum(forces[k] * slope for k, slope in slopes) for slopes in first],
            {(a, b): _sum(x * products[k, m] * y for k, x in first[a] for m, y in first[b]) for a, b in pairs},
            {pair: _sum(multipliers[k] * each for k, each in curves.items()) for pair, curves in self.second.items()},
        )

    def _combined(self, values: dict[int, np.ndarray]) -> np.ndarray:
        return _sum(self.rows[k] * value for k, value in values.items())


def _sum(arrays: Iterable[np.ndarray]) -> np.ndarray:
    return reduce(np.add, arrays)


Sums = tuple[list[np.ndarray], dict[tuple[int, int], np.ndarray], dict[tuple[int, int], np.ndarray]]


class TimesProblem(Protocol):
    """Constraints of a problem."""

    @property
    def rates(self) -> np.ndarray:
        """Indices of the unknowns x."""
        ...

    @property
    def pinned(self) -> np.ndarray:
        """Indices of the fixed unknowns."""
        ...

    @property
    def band(self) -> int:
        """Largest distance of the numbers of two unknowns of one term."""
        ...

    def limited(self, y: np.ndarray) -> Sequence[Terms | Combined]:
        """f, with its limits."""
        ...

    def zero(self, y: np.ndarray) -> list[Terms]:
        """g."""
        ...

    def typical(self, y: np.ndarray) -> np.ndarray:
        """Size of every unknown."""
        ...


def shortest_times(problem: TimesProblem, y: np.ndarray, scaled: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Times 1 / x of the step with the least sum, or of the start, until steps gain no more.

    Args:
        problem: constraints.   y: unknowns at the start, within all limits.
        scaled: times that keep all limits, from those of a step, which may exceed them a little.
    """
    best, sums = scaled(1.0 / y[problem.rates]), []
    with np.errstate(all="ignore"):  # numbers that are not finite end the search
        for step in islice(iterates(problem, y), STEPS):
            best = min(best, scaled(1.0 / step[problem.rates]), key=np.sum)
            sums.append(best.sum())
            if len(sums) > FIRST_STEPS and sums[-1] > (1.0 - SETTLED) * sums[-1 - PATIENCE]:
                break
    return best


def iterates(
    problem: TimesProblem, y: np.ndarray, barrier: float = BARRIER, fall: float = FALL, convex: float = CONVEX
) -> Iterator[np.ndarray]:
    """Unknowns after each step, without end but where no step is left; limits hold in all, equations in the later ones.

    Args:
        problem: constraints.   y: unknowns at the start, within all limits.
        barrier: the first; lower near the solution.   fall: factor by which it falls.
        convex: part of the curvature that is added at least where Newton's matrix is not positive definite; it slows the steps.
    """
    loose, added, limited = LOOSE, 0.0, problem.limited(y)
    slacks = [each.slacks for each in limited]
    pressure = [barrier / each for each in slacks]  # the multipliers of both limits
    multipliers = [np.zeros_like(each.value) for each in problem.zero(y)]
    while True:
        jumps, loose = problem.zero(y), max(LEAST_LOOSE, TIGHTER * loose)
        system = _System(problem, y)
        for each, slack, forces in zip(limited, slacks, pressure, strict=True):
            pull = barrier / slack
            system.add(each, (forces / slack).sum(axis=0), forces[0] - forces[1], pull[0] - pull[1])
        for each, force in zip(jumps, multipliers, strict=True):
            force = force + each.value / loose
            system.add(each, np.full_like(force, 1.0 / loose), force, force)
        step, added = system.step(added, convex)
        if step is None:
            return
        length, limited, slacks_then = _within(problem, y, step, limited, slacks)
        if length < SHORTEST:
            return
        for k, each in enumerate(jumps):
            multipliers[k] = multipliers[k] + length * (each.value + length * each.change(step)) / loose
        for k, (slack, then) in enumerate(zip(slacks, slacks_then, strict=True)):
            change = barrier / slack - pressure[k] - pressure[k] / slack * (then - slack) / length
            pressure[k] = np.clip(pressure[k] + length * change, barrier / then / SAFEGUARD, SAFEGUARD * barrier / then)
        y, slacks = y + length * step, slacks_then
        yield y
        barrier = max(LEAST_BARRIER, fall * barrier) if length > FAR_ENOUGH else barrier


def _within(
    problem: TimesProblem,
    y: np.ndarray,
    step: np.ndarray,
    limited: Sequence[Terms | Combined],
    slacks: list[np.ndarray],
) -> tuple[float, Sequence[Terms | Combined], list[np.ndarray]]:
    """Length of a step that keeps all limits, the limited terms after it and their slacks.

    The first length that is tried keeps them if they were linear.
    """
    rates = problem.rates
    shrinking = [(y[rates], step[rates])]
    for each, slack in zip(limited, slacks, strict=True):
        change = each.change(step)
        shrinking += [(slack[0], -change), (slack[1], change)]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rooms = [np.where(change < 0.0, -room / change, np.inf).min() for room, change in shrinking]
    length = min(1.0, TO_BOUNDARY * float(min(rooms)))
    while True:
        limited = problem.limited(y + length * step)
        then = [each.slacks for each in limited]
        if length < SHORTEST or all((after >= LEFT * before).all() for after, before in zip(then, slacks, strict=True)):
            return length, limited, then
        length *= SHORTER


class _System:
    """Newton's system in banded form, filled term by term."""

    def __init__(self, problem: TimesProblem, y: np.ndarray):
        rates = problem.rates
        self.pinned, self.size, self.band, self.typical = problem.pinned, len(y), problem.band, problem.typical(y)
        self.entries = [(rates, rates, 2.0 / y[rates] ** 3)]
        self.slopes = [(rates, -1.0 / y[rates] ** 2)]
        self.curves: list[tuple[np.ndarray, np.ndarray]] = []  # that make all terms convex

    def add(self, terms: Terms | Combined, weight: np.ndarray, multiplier: np.ndarray, force: np.ndarray) -> None:
        """weight ∇f ∇fᵀ + multiplier ∇²f  to the matrix, and  force ∇f  to the gradient."""
        slopes, products, curves = terms.sums(weight, multiplier, force)
        self.slopes += zip(terms.at, slopes, strict=True)
        for (a, b), value in products.items():
            at, to = terms.at[a], terms.at[b]
            if (a, b) in curves:
                curve = curves[a, b]
                value = value + curve
                if a == b:
                    self.curves.append((at, np.maximum(-curve, 0.0)))
                else:  # |c| (r da² + db² / r) ≥ 2 |c da db|
                    ratio = self.typical[to] / self.typical[at]
                    self.curves += [(at, np.abs(curve) * ratio), (to, np.abs(curve) / ratio)]
            if isinstance(terms, Terms):
                # a sum may have an unknown twice: its product with itself then stands on both sides of the diagonal
                value = value * (1.0 + ((at == to) & (a != b)))
            self.entries.append((at, to, value))

    def step(self, added: float, convex: float) -> tuple[np.ndarray | None, float]:
        """Newton's step, and the added curvature that made its matrix positive definite; None: none does.

        Args:
            added: curvature of the step before; a little less is tried first.   convex: the least.
        """
        rows, columns, values = (np.concatenate([each[k].ravel() for each in self.entries]) for k in range(3))
        places = np.abs(rows - columns) * self.size + np.minimum(rows, columns)
        matrix = np.bincount(places, values, self.size * (self.band + 1)).reshape(self.band + 1, self.size)
        gradient = self._sum(self.slopes)
        matrix[0, self.pinned] += PINNED
        gradient[self.pinned] = 0.0
        if not (np.isfinite(gradient).all() and np.isfinite(matrix).all()):
            return None, 0.0
        added = added / STRONGER if added > convex else 0.0
        diagonal, curve = matrix[0].copy(), self._sum(self.curves) if added else np.zeros(self.size)
        while added < STRONGEST:
            matrix[0] = diagonal + added * curve
            try:
                return -cho_solve_banded((cholesky_banded(matrix, lower=True), True), gradient), added
            except np.linalg.LinAlgError:
                curve = curve if added else self._sum(self.curves)
                added = max(convex, STRONGER * added)
        return None, added

    def _sum(self, parts: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Sums of numbers by unknown."""
        at, values = (np.concatenate([each[k].ravel() for each in parts]) for k in range(2))
        return np.bincount(at, values, self.size)

"""Profile of a likelihood over a whole number: values that the data do not distinguish from the best one. [Ljung1999]

With S(d) the least sum of squares beside a number d, and d* the best one, both models are part of one with |d − d*| numbers more.
The true d is thus kept with a probability by  (S(d) − S(d*)) / variance ≤ χ² of |d − d*| degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from scipy.stats import chi2

Fit = TypeVar("Fit")


def profile_interval(
    fitted: Callable[[int, Fit], tuple[Fit, float]], begin: tuple[int, Fit], highest: int, variance: float, level: float, gap: int
) -> list[int]:  # fmt: skip
    """The kept numbers from 0 to `highest`.

    Args:
        fitted: (number, the fit of its neighbour) → its fit, and its cost S.   begin: a number near the best, and a fit.
        highest: number that is tried.   variance: of the errors, as the parameters see it.   level: probability.
        gap: successive numbers that fit worse, behind which no further ones are tried.
    """
    best = begin[0]
    first, cost = fitted(*begin)
    costs = {best: cost}

    def refused(number: int) -> bool:
        return bool(costs[number] - costs[best] > variance * chi2.ppf(level, max(abs(number - best), 1)))

    for numbers in (range(best - 1, -1, -1), range(best + 1, highest + 1)):
        last, misses = first, 0
        for number in numbers:
            last, costs[number] = fitted(number, last)
            best = min(costs, key=lambda each: costs[each])
            misses = misses + 1 if refused(number) else 0
            if misses == gap:
                break
    return [number for number in costs if not refused(number)]

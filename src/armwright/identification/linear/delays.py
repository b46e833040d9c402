"""Interval of delays that the data do not distinguish from the chosen one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armwright.fitting.profile import profile_interval
from armwright.identification.linear.prediction_error import PredictionFit, estimate, with_best_numerator
from armwright.identification.linear.records import RecordedStretch

LEVEL = 0.95  # of the test that keeps a delay
GAP = 2  # successive delays that fit worse: further ones are not tried
FEWEST = 10  # rows for each parameter: with fewer the test's distribution does not hold


def delay_interval(fit: PredictionFit, stretches: Sequence[RecordedStretch], initial: bool) -> tuple[int, int] | None:
    """Smallest and largest delay [samples] of models that fit the data as well as the best one; None for too few rows.

    Every delay d gets a model of the same poles and of as many coefficients of B, at least one for each pole: a sampled
    continuous system has that many, and its first ones may be lost in the noise. The sums of squares are a profile of the delay.

    Coloured errors enlarge the variance as they enlarge that of B's coefficients.

    Args:
        fit: of the chosen order and delay.   stretches: rows that were fitted.   initial: initial states are estimated.
    """
    orders = replace(fit.orders, nb=max(fit.orders.na, fit.orders.nb))
    highest = fit.orders.delay + orders.nb
    skip = replace(orders, delay=highest).past
    if max(len(each.y) for each in stretches) < skip + FEWEST * orders.count:
        return None
    variance = fit.cost / max(fit.equations - fit.orders.count, 1) * _inflation(fit)

    def fitted(delay: int, last: PredictionFit) -> tuple[PredictionFit, float]:
        model = replace(last.orders.polynomials(last.theta), b=np.zeros(delay + orders.nb), delay=delay)
        now = replace(orders, delay=delay)
        near = with_best_numerator(now, stretches, skip, initial, model)
        found = estimate(now, stretches, skip, initial, None, [near])
        return found, found.cost

    kept = profile_interval(fitted, (fit.orders.delay, fit), highest, variance, LEVEL, GAP)
    return min(*kept, fit.orders.delay), max(*kept, fit.orders.delay)


def _inflation(fit: PredictionFit) -> float:
    """Mean variance of B's coefficients over what it would be if the errors were white; at least 1."""
    part = slice(fit.orders.na, fit.orders.na + fit.orders.nb)
    ratio = np.diag(fit.test_covariance)[part] / np.maximum(np.diag(fit.white_covariance)[part], 1e-300)
    return max(float(ratio.mean()), 1.0)

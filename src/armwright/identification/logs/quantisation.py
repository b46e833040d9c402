"""Steps of quantised signals: encoder counts, current converters, differenced counts."""

from __future__ import annotations

import numpy as np

NEAR = 0.05  # of a step: how far values may be from whole multiples, which printed digits round
SHARE = 0.98  # of the differences that must be whole multiples
MOST_LEVELS = 100_000  # between the extremes; a finer grid is none
LARGEST = 1e100  # of values: squares of their sums are numbers


def quantisation_step(values: np.ndarray) -> float | None:
    """The largest step such that all differences between values are whole multiples of it; None if absent.

    The smallest difference between values is refined by the larger ones, which say the step to more digits.

    Args:
        values: (k,) finite.
    """
    levels = np.unique(values)
    if len(levels) < 4 or len(levels) > len(values) // 2:
        return None
    steps = np.diff(levels)
    scale = np.abs(levels[[0, -1]]).max()
    if scale > LARGEST:
        return None
    steps = steps[steps > 1e-9 * scale]  # printed digits of one level
    if not len(steps) or (levels[-1] - levels[0]) / steps.min() > MOST_LEVELS:
        return None
    step = float(np.median(steps[steps < 1.5 * steps.min()]))
    for reach in (10, 100, len(levels)):
        spans = (levels - levels[0])[1 : reach + 1]
        counts = np.round(spans / step)
        whole = counts > 0
        if whole.any():  # else digits of one level stand before all others
            step = float((counts[whole] @ spans[whole]) / (counts[whole] @ counts[whole]))
    multiples = (levels - levels[0]) / step
    fits = np.abs(multiples - np.round(multiples)) < NEAR
    return step if fits.mean() >= SHARE else None

"""Single rows of a signal that stand out from those beside them, as glitches of a bus or an encoder do.

A row stands out if it differs from the median of the five rows around it by more than 6 times the 90 % quantile of the steps from
row to row, 14 deviations of white noise. Steps that stay, as dry friction makes them, are in the median too. [DaviesGather1993]
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.ndimage import median_filter

from armwright.identification.logs.census import Census
from armwright.identification.logs.quantisation import quantisation_step

SIGNALS = ("q", "qd", "tau", "tau_link", "current")  # that are measured; a command may have pulses
AROUND, USUAL, TIMES = 5, 0.9, 6.0
FEWEST = 64  # rows that a limit is made of
MOST = 0.04  # share of the rows, a tenth of whose steps they then are: more belong to the signal


def spike_limits(census: Census) -> dict[str, tuple[float, ...]]:
    """By signal, for each of its columns, by how much single rows stand out; infinite where none does."""
    rows, found = census.longest, {}
    for name in SIGNALS if rows is not None and len(rows.t) >= FEWEST else ():
        if name in census.excerpt.values:
            limits = tuple(map(_limit, rows.values[name].T))  # type: ignore[union-attr]
            if np.isfinite(limits).any():
                found[name] = limits
    return found


def without_spikes(
    values: Mapping[str, np.ndarray], limits: Mapping[str, tuple[float, ...]]
) -> Mapping[str, np.ndarray]:
    """Signals (rows, joints), rows that stand out replaced by lines between those beside them.

    Args:
        values: by name, of one stretch.   limits: of `spike_limits`.
    """
    if not limits:
        return values
    found = {name: each.copy() if name in limits else each for name, each in values.items()}
    for name, each in limits.items():
        for k, limit in enumerate(each):
            column = found[name][:, k]
            spikes = standing_out(column, limit)
            if spikes.any() and not spikes.all():
                rows = np.arange(len(column))
                column[spikes] = np.interp(rows[spikes], rows[~spikes], column[~spikes])
    return found


def standing_out(column: np.ndarray, limit: float) -> np.ndarray:
    """(rows,) True where a signal differs from its rows around by more than a limit."""
    if not np.isfinite(limit):
        return np.zeros(len(column), dtype=bool)
    return np.abs(column - median_filter(column, AROUND, mode="nearest")) > limit


def _limit(column: np.ndarray) -> float:
    steps = np.abs(np.diff(column))
    steps = steps[steps > 0.0]
    if len(steps) < FEWEST:
        return np.inf
    limit = TIMES * max(float(np.quantile(steps, USUAL)), quantisation_step(column) or 0.0)
    return limit if 0.0 < standing_out(column, limit).mean() < MOST else np.inf

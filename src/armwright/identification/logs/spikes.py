"""Single rows of a signal that stand out from those beside them, as glitches of a bus or an encoder do.

A row stands out if it differs from the median of the five rows around it by more than 6 times the 90 % quantile of the steps from
row to row, 14 deviations of white noise, and 6 times the 80 % quantile of those of the 51 rows around: noise may grow with speed.
Steps that stay, as dry friction makes them, are in the median too. [DaviesGather1993]
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from scipy.ndimage import median_filter, percentile_filter

from armwright.identification.logs.census import Census
from armwright.identification.logs.quantisation import quantisation_step

SIGNALS = ("q", "qd", "tau", "tau_link", "current")  # that are measured
AROUND, USUAL, TIMES = 5, 0.9, 6.0
NEAR, OF_THEM = 51, 80.0  # rows around, and per cent of them
FEWEST = 64  # rows that a limit is made of
MOST = 0.04  # share of the rows, a tenth of whose steps they then are: more belong to the signal


def spike_limits(census: Census, held: Collection[str]) -> dict[str, tuple[float, ...]]:
    """By signal, for each of its columns, by how much single rows stand out; infinite where none does.

    Args:
        census: of a run.   held: signals that are commands, which may have pulses.
    """
    rows = census.longest
    if rows is None or len(rows.t) < FEWEST:
        return {}
    names = [name for name in SIGNALS if name in rows.values and name not in held]
    limits = {name: tuple(map(_limit, rows.values[name].T)) for name in names}
    return {name: each for name, each in limits.items() if np.isfinite(each).any()}


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
    off = np.abs(column - median_filter(column, AROUND, mode="nearest"))
    if not (off > limit).any():
        return off > limit
    steps = np.abs(np.diff(column, append=column[-1]))
    return off > np.maximum(limit, TIMES * percentile_filter(steps, OF_THEM, NEAR, mode="nearest"))


def _limit(column: np.ndarray) -> float:
    steps = np.abs(np.diff(column))
    steps = steps[steps > 0.0]
    if len(steps) < FEWEST:
        return np.inf
    limit = TIMES * max(float(np.quantile(steps, USUAL)), quantisation_step(column) or 0.0)
    return limit if 0.0 < standing_out(column, limit).mean() < MOST else np.inf

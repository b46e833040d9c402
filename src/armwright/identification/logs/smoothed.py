"""Motion of a run's excerpt through a zero-phase low-pass, for the checks that compare signals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import signal as sp

from armwright.errors import LogError
from armwright.identification.logs.log import Log, LogRun
from armwright.identification.logs.preparation import EDGE, choose_preparation, settling

FEWEST = 128  # rows without a gap


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Evenly sampled rows of a run, all signals through the same filter.

    Attributes:
        log: whose these are.   values: signal → (rows, columns).   period: from row to row [s].
        sections: of the filter, as `low_pass` has them.
    """

    log: Log
    values: Mapping[str, np.ndarray]
    period: float
    sections: np.ndarray

    def columns(self, signal: str) -> Iterator[tuple[int, np.ndarray]]:
        """(joint, column) of a signal, (rows,) each; empty if not logged."""
        if signal in self.values:
            yield from zip(self.log.layout[signal].joints or (), self.values[signal].T, strict=True)

    @cached_property
    def rates(self) -> dict[int, np.ndarray]:
        """Joint → derivative of its position (rows,)."""
        return {j: np.gradient(q, self.period) for j, q in self.columns("q")}

    @property
    def speeds(self) -> dict[int, np.ndarray]:
        """Joint → speed (rows,), differentiated from positions if these are logged."""
        return self.rates if "q" in self.values else dict(self.columns("qd"))


def smoothed(log: Log, run: LogRun) -> Smoothed | None:
    """The excerpt's longest part without gaps, all signals through one zero-phase low-pass; None if too short."""
    census = run.census
    assert census is not None
    begin = census.excerpt.row
    end = begin + len(census.excerpt.t)
    parts = [(max(s.begin, begin) - begin, min(s.end, end) - begin) for s in census.stretches]
    low, high = max(parts, key=lambda part: part[1] - part[0], default=(0, 0))
    if high - low < FEWEST or census.excerpt.t[high - 1] <= census.excerpt.t[low]:
        return None
    try:
        preparation = choose_preparation(log, run.name)
    except LogError:
        return None
    t = census.excerpt.t[low:high]
    period = float(t[-1] - t[0]) / (len(t) - 1)
    even, edge = t[0] + period * np.arange(len(t)), min(settling(preparation.sections, EDGE) + 1, (high - low) // 8)
    values = {}
    for name, logged in census.excerpt.values.items():
        columns = np.stack([np.interp(even, t, column[low:high]) for column in logged.T], axis=1)
        filtered = sp.sosfiltfilt(preparation.sections, columns, axis=0, padlen=min(len(columns) - 1, 300))
        values[name] = filtered[edge : len(filtered) - edge]
    return Smoothed(log, values, period, preparation.sections)

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
    rows = run.census.longest
    if rows is None or len(rows.t) < FEWEST or rows.period <= 0.0:
        return None
    try:
        preparation = choose_preparation(log, run.name)
    except LogError:
        return None
    edge = min(settling(preparation.sections, EDGE) + 1, len(rows.t) // 8)
    values = {}
    for name, columns in rows.values.items():
        filtered = sp.sosfiltfilt(preparation.sections, columns, axis=0, padlen=min(len(columns) - 1, 300))
        values[name] = filtered[edge : len(filtered) - edge]
    return Smoothed(log, values, rows.period, preparation.sections)

"""Rows of a run at even times: as they were sampled, or by splines through them where rows are missing or times uneven."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from armwright.identification.logs.blocks import ROWS, Block, run_blocks
from armwright.identification.logs.sampling import Sampling, sampled
from armwright.identification.logs.stretches import EvenRows, Span

if TYPE_CHECKING:
    from armwright.identification.logs.log import Log, LogRun

ROUNDED = 2.0  # digits that times are off even ones, where a clock was rounded, in the row and where the stretch begins
UNEVEN = 1e-3  # of a period: rows further from even times are interpolated
BESIDE = 8  # rows beyond a window that a spline goes through


@dataclass(frozen=True, eq=False)
class EvenStretch:
    """Even rows of a stretch in memory: times t (rows,) and period [s], and signals (rows, joints that have them)."""

    t: np.ndarray
    period: float
    values: Mapping[str, np.ndarray]

    def middle(self, most: int) -> EvenStretch:
        """Its middle rows, so many at most."""
        first = max(len(self.t) - most, 0) // 2
        part = slice(first, first + most)
        return EvenStretch(self.t[part], self.period, {name: each[part] for name, each in self.values.items()})


def excerpt_rows(excerpt: Block, stretches: Sequence[Span], sampling: Sampling) -> list[EvenStretch]:
    """Even rows of an excerpt in memory, stretch by stretch.

    Args:
        excerpt: rows of a run with the times of their samples.   stretches, sampling: of the run.
    """
    found, end = [], excerpt.row + len(excerpt.t)
    for span in stretches:
        part = span.between(excerpt.row, end, excerpt.t)
        if part is not None:
            stretch = EvenRows.of(part, sampling.period)
            rows = SampledRows(iter([excerpt]), sampling.resolution)
            found.append(EvenStretch(*rows.even(stretch, 0, stretch.rows)))
    return found


def sampled_rows(log: Log, run: LogRun) -> SampledRows:
    """Rows of a checked run, from its files."""
    return SampledRows(sampled(run_blocks(log, run, ROWS), run.census.sampling), run.census.resolution)


class SampledRows:
    """Rows of a run by number; rows long before the last request are dropped.

    Args:
        blocks: of the run, with the times of their samples.   resolution: to which times are rounded [s].
    """

    def __init__(self, blocks: Iterator[Block], resolution: float):
        self._blocks, self._resolution = blocks, resolution
        self._begin: int | None = None
        self._t = np.zeros(0)
        self._values: dict[str, np.ndarray] = {}

    def even(self, stretch: EvenRows, low: int, high: int) -> tuple[np.ndarray, float, dict[str, np.ndarray]]:
        """Even times [s] of rows `low` to `high` of a stretch, their period [s], and the signals there.

        Rows may go back only a limited distance.
        """
        even = stretch.start + stretch.period * np.arange(low, high)
        if not stretch.has_gaps:
            times, values = self._rows(stretch.begin + low, stretch.begin + high)
            if np.abs(times - even).max() <= max(UNEVEN * stretch.period, ROUNDED * self._resolution):
                return even, stretch.period, values
        return even, stretch.period, self._between(stretch, even)

    def _between(self, stretch: EvenRows, times: np.ndarray) -> dict[str, np.ndarray]:
        """Signals at some times of a stretch, by cubic splines through the cells that are there."""
        while self._end < stretch.end and not (len(self._t) and _increasing(self._t)[-1] > times[-1]):
            late = (self._begin or 0) + int(np.searchsorted(_increasing(self._t), times[0])) - BESIDE
            self._add(next(self._blocks), late)
        first, end = (min(max(row - (self._begin or 0), 0), len(self._t)) for row in (stretch.begin, stretch.end))
        low, high = np.searchsorted(_increasing(self._t[first:end]), times[[0, -1]])
        part = slice(first + max(int(low) - BESIDE, 0), min(first + int(high) + BESIDE, end))
        t = self._t[part]
        with np.errstate(invalid="ignore"):  # before the first time
            newer = np.isfinite(t) & (np.diff(_increasing(t), prepend=-np.inf) > 0)
        found = {}
        for name, values in self._values.items():
            columns = []
            for column in values[part].T:
                known = newer & np.isfinite(column)
                columns.append(CubicSpline(t[known], column[known])(np.clip(times, t[known][0], t[known][-1])))
            found[name] = np.stack(columns, axis=1)
        return found

    @property
    def _end(self) -> int:
        """Number of the row behind those that were read."""
        return (self._begin or 0) + len(self._t)

    def _rows(self, begin: int, end: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Times and signals of rows `begin` to `end`."""
        while self._end < end:
            self._add(next(self._blocks), begin)
        part = slice(begin - (self._begin or 0), end - (self._begin or 0))
        return self._t[part], {name: each[part] for name, each in self._values.items()}

    def _add(self, block: Block, begin: int) -> None:
        """Adds rows and forgets those before `begin`."""
        if self._begin is None:
            self._begin = block.row
        count = min(max(begin - self._begin, 0), len(self._t))
        self._begin += count
        self._t = np.concatenate([self._t[count:], block.t])
        self._values = {
            name: np.concatenate([self._values[name][count:], each]) if name in self._values else each
            for name, each in block.values.items()
        }


def _increasing(t: np.ndarray) -> np.ndarray:
    """Times (rows,), those that are missing or go back as the latest before them."""
    return np.maximum.accumulate(np.where(np.isfinite(t), t, -np.inf))

"""Stretches of a run: rows without gaps but short ones, and the evenly timed rows that preparation makes of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

GAP = 1.5  # times the usual period: a longer step of time is a gap
BRIDGED, BRIEF = 3, 5e-3  # rows or time [s], the larger: gaps of so many are bridged


@dataclass(frozen=True)
class Span:
    """Rows of a run without a gap that is not bridged: `begin` to `end` (not included), at times `start` to `stop` [s].

    Attributes:
        pieces: that gaps which are bridged cut it into.
    """

    begin: int
    end: int
    start: float
    stop: float
    pieces: int = 1

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.end - self.begin

    def joined(self, after: Span, period: float) -> Span | None:
        """With the next one, if the gap between them is short by this period [s]; else None."""
        if not 0 < after.start - self.stop < (bridged_rows(period) + GAP) * period:
            return None
        return Span(self.begin, after.end, self.start, after.stop, self.pieces + after.pieces)

    def between(self, begin: int, end: int, t: Sequence[float] | np.ndarray) -> Span | None:
        """Its part from row `begin` to `end`, of rows at times t (end - begin,) [s]; None if there is none."""
        low, high = max(self.begin, begin), min(self.end, end)
        known = np.flatnonzero(np.isfinite(t[low - begin : max(high - begin, 0)])) if high > low else []
        if len(known) < 2:
            return None
        first, last = low + int(known[0]), low + int(known[-1])
        pieces = self.pieces if (low, high) == (self.begin, self.end) else 2  # there may be a gap
        return Span(first, last + 1, float(t[first - begin]), float(t[last - begin]), min(self.pieces, pieces))


def bridged_rows(period: float) -> int:
    """Most rows [of this period in s] of a gap that is bridged."""
    return max(BRIDGED, int(BRIEF / period)) if period else BRIDGED


@dataclass(frozen=True)
class EvenRows:
    """Evenly timed rows of a run, from rows without gaps but short ones.

    Attributes:
        begin, end: rows of the run that they come from, `end` not included.   start: time of the first [s].
        rows: their number, missing ones included.   period: from row to row [s].   has_gaps: rows are missing.
    """

    begin: int
    end: int
    start: float
    rows: int
    period: float
    has_gaps: bool

    @classmethod
    def of(cls, span: Span, usual: float) -> Self:
        """Those of a stretch, of a log with this usual period [s]."""
        duration, has_gaps = span.stop - span.start, span.pieces > 1
        rows = max(round(duration / usual), 1) + 1 if has_gaps else span.rows
        return cls(span.begin, span.end, span.start, rows, duration / (rows - 1) if rows > 1 else 0.0, has_gaps)

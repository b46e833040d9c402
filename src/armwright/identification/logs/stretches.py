"""Stretches of a run: rows without gaps, and the evenly timed rows that preparation makes of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

BRIDGED = 3  # rows: gaps of so many are bridged


@dataclass(frozen=True)
class Span:
    """Rows of a run without gap: `begin` to `end` (not included), at times `start` to `stop` [s]."""

    begin: int
    end: int
    start: float
    stop: float

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.end - self.begin


@dataclass(frozen=True)
class EvenRows:
    """Evenly timed rows of a run, from one stretch or from several with short gaps between them.

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
    def of(cls, spans: Sequence[Span], usual: float) -> Self:
        """Those of successive stretches, of a log with this usual period [s]."""
        first, last = spans[0], spans[-1]
        duration, has_gaps = last.stop - first.start, len(spans) > 1
        rows = max(round(duration / usual), 1) + 1 if has_gaps else first.rows
        return cls(first.begin, last.end, first.start, rows, duration / (rows - 1) if rows > 1 else 0.0, has_gaps)


def evenly_timed(stretches: Sequence[Span], usual: float, bridge: bool) -> tuple[EvenRows, ...]:
    """Evenly timed rows of a run's stretches.

    Args:
        stretches: one after the other.   usual: time from row to row [s].
        bridge: join stretches with at most three rows, lost or with empty cells, between them.
    """
    joined: list[list[Span]] = []
    for each in stretches:
        if bridge and joined and _is_short(joined[-1][-1], each, usual):
            joined[-1].append(each)
        else:
            joined.append([each])
    return tuple(EvenRows.of(spans, usual) for spans in joined)


def _is_short(before: Span, after: Span, usual: float) -> bool:
    """True of a gap that is bridged."""
    return after.begin - before.end <= BRIDGED and 0 < after.start - before.stop < (BRIDGED + 1.5) * usual

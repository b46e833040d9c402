"""Clocks of measured files: times in seconds from a column or from a rate, and signals of one clock at the times of another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armwright.errors import LogError
from armwright.identification.logs.log_file import OwnTime
from armwright.identification.logs.measured_table import MeasuredTable
from armwright.identification.logs.units import TIME

WIDEST = 4.0  # times a clock's usual period: signals are not interpolated across a wider gap


class Clock:
    """Times of a file in seconds; whole numbers, such as nanoseconds since 1970, keep their last digit."""

    def __init__(self, time: OwnTime, table: MeasuredTable | None):
        self.column, self._rate = time.column, time.rate_hz
        self.origin: int | float | None = None  # the first time, in the column's unit
        self.scale = 1.0
        if time.column is not None:
            assert table is not None
            stated = table.unit(time.column)
            unit = time.unit or stated
            if unit not in TIME or (stated in TIME and time.unit not in (None, stated)):
                what = f"the header says {stated!r}" if stated else "missing"
                file = table.path if stated else ""  # a missing unit is to be written into the log's file
                raise LogError(what, place="time.unit", expected=f"one of {', '.join(TIME)}", file=file)
            self.scale = TIME[unit]

    def seconds(self, times: np.ndarray | None, row: int, count: int, origin: int | float | None = None) -> np.ndarray:
        """(count,) [s] since `origin`, by default the first time of all.

        Args:
            times: (count,) as in the file; None: from the rate.   row: number of the first.   origin: in the column's unit.
        """
        if times is None:
            assert self._rate is not None
            return (row + np.arange(count)) / self._rate
        if self.origin is None:
            finite = times[np.isfinite(times)] if times.dtype.kind == "f" else times
            self.origin = finite[0].item() if len(finite) else 0.0
        return (times - (self.origin if origin is None else origin)) * self.scale


class Interpolated:
    """Columns of a file at the times of another clock, linearly between its rows; NaN outside and across gaps.

    Both clocks count from the same moment where both are columns; a rate counts from its file's first row.
    """

    def __init__(self, table: MeasuredTable, clock: Clock, columns: Sequence[int | str], rows: int, main: Clock):
        self._clock, self._main, self._row = clock, main, 0
        heads = [] if clock.column is None else [clock.column]
        self._source = table.blocks([*heads, *columns], rows)
        self._t = np.zeros(0)
        self._values = np.zeros((0, len(columns)))
        self._period = 0.0
        self._path = table.path

    def at(self, t: np.ndarray) -> list[np.ndarray]:
        """A column (rows,) each, at times t (rows,) [s] that do not run back from call to call."""
        finite = t[np.isfinite(t)]
        while len(finite) and (not len(self._t) or self._t[-1] < finite[-1]):
            if not self._append():
                break
        if len(self._t) < 2:
            return [np.full(len(t), np.nan) for _ in range(self._values.shape[1])]
        columns = [np.interp(t, self._t, column, np.nan, np.nan) for column in self._values.T]
        after = np.clip(np.searchsorted(self._t, t), 1, len(self._t) - 1)
        wide = self._t[after] - self._t[after - 1] > WIDEST * self._period
        if len(finite):
            keep = max(int(np.searchsorted(self._t, finite[-1])) - 2, 0)
            self._t, self._values = self._t[keep:], self._values[keep:]
        return [np.where(wide, np.nan, column) for column in columns]

    def _append(self) -> bool:
        """Reads a block; False at the end of the file."""
        part = next(self._source, None)
        if part is None:
            return False
        times = part.pop(0) if self._clock.column is not None else None
        count = len(part[0])
        # the other clock's origin, in this one's unit, so that both count from the same moment
        same = times is not None and self._main.origin is not None
        origin = self._main.origin * (self._main.scale / self._clock.scale) if same else None  # type: ignore[operator]
        if same and self._main.scale == self._clock.scale:
            origin = self._main.origin
        t = self._clock.seconds(times, self._row, count, origin)
        timed = np.isfinite(t)
        t, part = t[timed], [column[timed] for column in part]
        if not (np.diff(t) >= 0).all():
            k = np.argmin(np.diff(t) >= 0) + 1
            row = int(np.flatnonzero(timed)[k])
            raise LogError("time goes backwards", value=float(t[k]), file=f"{self._path} row {self._row + row + 1}")
        if not self._period and len(t) > 1:
            self._period = float(np.median(np.diff(t)))
        self._row += count
        self._t = np.concatenate([self._t, t])
        self._values = np.concatenate([self._values, np.stack(part, axis=1).astype(float)])
        return True

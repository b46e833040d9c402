"""Census of a run: counts of one pass over its rows in bounded memory, and an excerpt for checks that need rows."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from armwright.errors import LogError
from armwright.identification.logs.blocks import Block
from armwright.identification.logs.findings import number_of
from armwright.identification.logs.stretches import Span

if TYPE_CHECKING:
    from armwright.identification.logs.log import Log, LogRun

GAP = 1.5  # times the usual period: a longer step of time is a gap
BRIEFEST = 1e-9  # [s] from row to row: less is no clock
OFTEN = 0.05  # share of steps
COARSE = 1 / 16  # of a period: finer digits of times do not count
DIGITS = (1.0, 0.1, 0.01, 1e-3, 1e-4, 1e-5, 1e-6)  # [s] that times may be rounded to
FEW = 5  # places of a kind of event that are kept
MOST_BREAKS = 100_000  # of a run: more is no run
SHORTEST = 64  # rows of an excerpt


@dataclass(frozen=True)
class EventPlaces:
    """Events of one kind: how many, and the rows of the first few."""

    count: int = 0
    rows: tuple[int, ...] = ()

    def plus(self, rows: np.ndarray) -> EventPlaces:
        """With further events."""
        return EventPlaces(self.count + len(rows), (*self.rows, *(int(r) for r in rows[: FEW - len(self.rows)])))


@dataclass
class SignalCensus:
    """Numbers about the columns of a signal, one entry a joint.

    Attributes:
        missing: empty or NaN cells.   low, high: extremes.   at_low, at_high: longest stay at each, in rows.
        repeats: rows that equal the row before, elsewhere.   counted: rows that had one before them.
    """

    missing: list[EventPlaces]
    low: np.ndarray
    high: np.ndarray
    at_low: np.ndarray
    at_high: np.ndarray
    repeats: np.ndarray
    counted: int = 0

    @classmethod
    def of(cls, joints: int) -> SignalCensus:
        """An empty one."""
        infinite, none = np.full(joints, np.inf), np.zeros(joints, dtype=int)
        return cls([EventPlaces()] * joints, infinite, -infinite, none, none.copy(), none.copy())

    def add(self, values: np.ndarray, row: int) -> None:
        """Counts a block (rows, joints) that begins at a row."""
        for j, column in enumerate(values.T):
            finite = np.isfinite(column)
            if not finite.all():
                self.missing[j] = self.missing[j].plus(row + np.flatnonzero(~finite))
            if not finite.any():
                continue
            low, high = column[finite].min(), column[finite].max()
            for extreme, stay, value, beyond in (
                (self.low, self.at_low, low, low < self.low[j]),
                (self.high, self.at_high, high, high > self.high[j]),
            ):
                if beyond:
                    extreme[j], stay[j] = value, 0
                if value == extreme[j]:
                    stay[j] = max(stay[j], longest(column == value))
        repeated = (np.diff(values, axis=0) == 0) & (values[1:] != self.low) & (values[1:] != self.high)
        self.repeats = self.repeats + repeated.sum(axis=0)
        self.counted += len(values) - 1


@dataclass
class Census:
    """Numbers about all rows of a run, while they go by and in the end.

    Attributes:
        rows: of the run.   first, last: times [s].   period: usual time from row to row [s].
        resolution: to which times are rounded [s]; 0 where that is fine.
        gaps: rows after a step longer than 1.5 periods.
        lost: rows that gaps would hold.   widest: of the gaps [s].   same_time: rows at the time of the row before.
        backwards: rows earlier than the row before.   no_time: rows without time.
        whole_repeats: rows that repeat all signals but temperatures.
        repeat_runs: how many groups of such rows, one behind the other.
        stretches: rows without gaps and missing cells.   signals: by name.
        excerpt: block of rows with the most motion.   motion: of it.   squares, steps: of the jitter [s²], and their number.
        open_begin, open_start: row and time [s] at which the open stretch begins; None: none is open.
    """

    signals: dict[str, SignalCensus]
    rows: int = 0
    first: float = np.nan
    last: float = np.nan
    period: float = 0.0
    resolution: float = 0.0
    gaps: EventPlaces = EventPlaces()
    lost: int = 0
    widest: float = 0.0
    same_time: EventPlaces = EventPlaces()
    backwards: EventPlaces = EventPlaces()
    no_time: EventPlaces = EventPlaces()
    whole_repeats: EventPlaces = EventPlaces()
    repeat_runs: int = 0
    stretches: list[Span] = field(default_factory=list)
    excerpt: Block = field(default_factory=lambda: Block(0, np.zeros(0), {}))
    motion: float = -1.0
    squares: float = 0.0
    steps: int = 0
    open_begin: int | None = None
    open_start: float = np.nan

    @property
    def jitter(self) -> float:
        """Standard deviation of the time from row to row, gaps left out [s]."""
        return float(np.sqrt(self.squares / self.steps)) if self.steps else 0.0


def census_of(log: Log, run: LogRun) -> Census:
    """The census of a run, all of its rows read once.

    Raises:
        LogError: as `read_log`; numbers beyond all sizes, fewer than two rows, or times that are all the same.
    """
    state = Census({signal.name: SignalCensus.of(signal.size) for signal in log.layout})
    for block in log.blocks(run.name):
        _add_times(state, block)
        for name, values in block.values.items():
            state.signals[name].add(values, block.row)
        _add_excerpt(state, block)
        state.rows += len(block.t)
        if len(state.stretches) > MOST_BREAKS:
            what = f"falls into more than {MOST_BREAKS} pieces"
            raise LogError(what, place=f"run {run.name!r}", expected="rows one after the other", file=log.path)
    _close(state, state.rows, state.last)
    if state.rows < 2 or not state.period or state.motion < 0.0:
        what = number_of(state.rows, "row") if state.rows < 2 else f"rows less than {BRIEFEST:g} s after each other"
        raise LogError(what, place=f"run {run.name!r}", expected="at least two rows over time", file=log.path)
    return state


def _add_times(state: Census, block: Block) -> None:
    """Counts the steps of time, and cuts stretches where a step or a cell is missing."""
    t, row = block.t, block.row
    known = np.isfinite(t)
    if not known.all():
        state.no_time = state.no_time.plus(row + np.flatnonzero(~known))
    if not state.period:
        steps = np.diff(t[known])
        period = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
        state.period = period if period > BRIEFEST else 0.0
        state.resolution = resolution_of(t[known], state.period)
        if state.resolution:  # then a usual step is a digit too long or too short
            state.period = float(np.mean(steps[(steps >= 0) & (steps <= _longest_step(period, state.resolution))]))
        state.first = float(t[known][0]) if known.any() else np.nan
    steps = np.diff(t, prepend=state.last)
    gap, same, back = steps > _longest_step(state.period, state.resolution), steps == 0, steps < 0
    state.gaps = state.gaps.plus(row + np.flatnonzero(gap))
    state.same_time = state.same_time.plus(row + np.flatnonzero(same))
    state.backwards = state.backwards.plus(row + np.flatnonzero(back))
    if gap.any() and state.period:
        state.lost += int(np.round(steps[gap] / state.period - 1).sum())
        state.widest = max(state.widest, float(steps[gap].max()))
    usual = np.isfinite(steps) & ~gap & ~same & ~back
    state.squares += float(((steps[usual] - state.period) ** 2).sum())
    state.steps += int(usual.sum())
    whole = np.concatenate(list(block.values.values()), axis=1)
    fast = [values for name, values in block.values.items() if name != "temperature"] or [whole]
    repeated = np.flatnonzero((np.diff(np.concatenate(fast, axis=1), axis=0) == 0).all(axis=1)) + 1
    state.whole_repeats = state.whole_repeats.plus(row + repeated)
    state.repeat_runs += int((np.diff(repeated, prepend=-1) > 1).sum())
    good = known & np.isfinite(whole).all(axis=1)
    _cut(state, t, row, good, gap | back)
    if known.any():
        state.last = float(t[known][-1])


def _longest_step(period: float, resolution: float) -> float:
    """Longest step of time [s] without a gap; rounding alone makes steps a digit longer."""
    return GAP * period + resolution * (0.5 if period > GAP * resolution else 1.0) + BRIEFEST


def resolution_of(t: np.ndarray, period: float) -> float:
    """Digit [s] to which times (rows,) [s] were rounded; 0 if fine beside the period or without effect on the steps."""
    steps = np.diff(t)
    for digit in DIGITS if period else ():
        if digit <= COARSE * period:
            break
        whole = np.abs(steps / digit - np.round(steps / digit)).max(initial=0.0) < 1e-4
        shorter, longer = (np.abs(steps - (period + off)) < 0.5 * digit for off in (-digit, digit))
        if whole and (shorter.any() or longer.mean() > OFTEN):  # a lost row or two make steps longer too
            return digit
    return 0.0


def _cut(state: Census, t: np.ndarray, row: int, good: np.ndarray, breaks: np.ndarray) -> None:
    """Ends the open stretch before gaps and at rows that are not good, and begins the next one behind them."""
    before = np.concatenate([[state.open_begin is not None], good[:-1]])
    ends, begins = before & (~good | breaks), good & (~before | breaks)
    for k in np.flatnonzero(ends | begins):
        if ends[k]:
            _close(state, row + int(k), float(t[k - 1] if k else state.last))
        if begins[k]:
            state.open_begin, state.open_start = row + int(k), float(t[k])


def _close(state: Census, end: int, stop: float) -> None:
    """Ends the open stretch before a row."""
    if state.open_begin is not None and end > state.open_begin:
        state.stretches.append(Span(state.open_begin, end, state.open_start, stop))
    state.open_begin = None


def _add_excerpt(state: Census, block: Block) -> None:
    """Keeps the block in which signals change most from row to row."""
    if len(block.t) < SHORTEST and state.motion >= 0.0:
        return
    name = next((name for name in ("q", "qd") if name in block.values), next(iter(block.values)))
    with np.errstate(invalid="ignore"):
        motion = float(np.nan_to_num(np.abs(np.diff(block.values[name], axis=0))).sum())
    if motion > state.motion:
        state.excerpt, state.motion = block, motion


def longest(happens: np.ndarray) -> int:
    """Length of the longest run of true entries."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], happens, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max()) if len(edges) else 0

"""Census of a run: counts of one pass over its rows in bounded memory, and an excerpt for checks that need rows."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from armwright.errors import LogError
from armwright.fitting.measures import runs_of_true
from armwright.identification.logs.blocks import ROWS, Block
from armwright.identification.logs.even_rows import EvenStretch, excerpt_rows
from armwright.identification.logs.findings import number_of
from armwright.identification.logs.sampling import (
    BRIEFEST,
    SampleClock,
    Sampling,
    repeated_rows,
    sampling_of,
    with_following,
)
from armwright.identification.logs.stretches import Span

if TYPE_CHECKING:
    from armwright.identification.logs.log import Log, LogRun

MOVES = 0.2  # share of rows
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
        bridges: short gaps are bridged.   rows: of the run.   first, last: times [s].   sampling: as the first rows tell it.
        gaps: rows after a step longer than 1.5 periods.
        lost: rows that gaps would hold.   widest: of the gaps [s].   same_time: rows at the time of the row before.
        backwards: rows earlier than the row before.   no_time: rows without time.
        whole_repeats: rows that repeat all signals but temperatures.
        repeat_runs: number of groups of successive rows of this kind.
        none: rows that are none.   stretches: rows without gaps and missing cells that are not bridged.   signals: by name.
        excerpt: block of rows with the most motion.   sampled: times of its samples [s].   motion: of it.
        squares, steps: of the jitter [s²], and their number.
        open_begin, open_start: row and time [s] at which the open stretch begins; None: none is open.   stop: time of its
            last row [s].
    """

    signals: dict[str, SignalCensus]
    bridges: bool = True
    rows: int = 0
    first: float = np.nan
    last: float = np.nan
    sampling: Sampling = field(default_factory=Sampling)
    gaps: EventPlaces = EventPlaces()
    lost: int = 0
    widest: float = 0.0
    same_time: EventPlaces = EventPlaces()
    backwards: EventPlaces = EventPlaces()
    no_time: EventPlaces = EventPlaces()
    whole_repeats: EventPlaces = EventPlaces()
    repeat_runs: int = 0
    none: int = 0
    stretches: list[Span] = field(default_factory=list)
    excerpt: Block = field(default_factory=lambda: Block(0, np.zeros(0), {}))
    sampled: np.ndarray = field(default_factory=lambda: np.zeros(0))
    motion: float = -1.0
    squares: float = 0.0
    steps: int = 0
    open_begin: int | None = None
    open_start: float = np.nan
    stop: float = np.nan

    @property
    def period(self) -> float:
        """Usual time from row to row [s]."""
        return self.sampling.period

    @property
    def resolution(self) -> float:
        """To which times are rounded [s]; 0 where that is fine."""
        return self.sampling.resolution

    @cached_property
    def even(self) -> list[EvenStretch]:
        """Even rows of the excerpt, stretch by stretch; of a run of a block or less they are all."""
        return excerpt_rows(replace(self.excerpt, t=self.sampled), self.stretches, self.sampling)

    @property
    def excerpt_seconds(self) -> float:
        """Time from the excerpt's first row to its last [s]."""
        return float(np.ptp(self.excerpt.t[np.isfinite(self.excerpt.t)]))

    @property
    def longest(self) -> EvenStretch | None:
        """Even rows of the excerpt's longest stretch; None where there is none."""
        return max(self.even, key=lambda each: len(each.t), default=None)

    @property
    def pieces(self) -> int:
        """Of the run, with every gap."""
        return sum(each.pieces for each in self.stretches)

    @property
    def jitter(self) -> float:
        """Standard deviation of the time from row to row, gaps left out [s]."""
        return float(np.sqrt(self.squares / self.steps)) if self.steps else 0.0


def census_of(log: Log, run: LogRun) -> Census:
    """The census of a run, all of its rows read once.

    Raises:
        LogError: as `read_log`; numbers beyond all sizes, fewer than two rows, or times that are all the same.
    """
    # what was commanded in a gap is not known: logs of voltages or of held commands stay cut, and may repeat rows
    mends = "voltage" not in log.layout and not log.held
    state = Census({signal.name: SignalCensus.of(signal.size) for signal in log.layout}, mends)
    clock = SampleClock(state.sampling)
    for block, following in with_following(log.blocks(run.name)):
        if not state.period:
            state.sampling = sampling_of(_moving(log, run, block) if mends else block, mends)
            clock = SampleClock(state.sampling)
        t = clock.times(block, following)
        _add_times(state, block, t)
        for name, values in block.values.items():
            state.signals[name].add(values, block.row)
        _add_stretches(state, block, t)
        state.rows += len(block.t)
        if len(state.stretches) > MOST_BREAKS:
            what = f"falls into more than {MOST_BREAKS} pieces"
            raise LogError(what, place=f"run {run.name!r}", expected="rows one after the other", file=log.path)
    _close(state, state.rows)
    if state.rows < 2 or not state.period or state.motion < 0.0:
        what = number_of(state.rows, "row") if state.rows < 2 else f"rows less than {BRIEFEST:g} s after each other"
        raise LogError(what, place=f"run {run.name!r}", expected="at least two rows over time", file=log.path)
    return state


def _moving(log: Log, run: LogRun, first: Block) -> Block:
    """The first block in which positions change in a fifth of the rows; a run's first block, if none does."""
    further = log.blocks(run.name) if len(first.t) >= ROWS else ()
    for block in chain((first,), further):
        steps = [np.diff(values, axis=0) for n, values in block.values.items() if n in ("q", "qd") and len(values) > 1]
        if not steps or max((each != 0).any(axis=1).mean() for each in steps) > MOVES:
            return block
    return first


def _add_times(state: Census, block: Block, sampled: np.ndarray) -> None:
    """Counts the stamps as they are, jitter of those rows alone that were sampled at some time (rows,) [s], and repeated rows."""
    t, row, fresh = block.t, block.row, np.isfinite(sampled)
    known = np.isfinite(t)
    if not known.all():
        state.no_time = state.no_time.plus(row + np.flatnonzero(~known))
    if not np.isfinite(state.first) and known.any():
        state.first = float(t[known][0])
    steps = np.diff(t, prepend=state.last)
    same, back = steps == 0, steps < 0
    state.same_time = state.same_time.plus(row + np.flatnonzero(same))
    state.backwards = state.backwards.plus(row + np.flatnonzero(back))
    usual = np.isfinite(steps) & ~(steps > state.sampling.longest_step + state.resolution) & ~same & ~back
    usual &= fresh & np.concatenate([[True], fresh[:-1]])
    state.squares += float(((steps[usual] - state.period) ** 2).sum())
    state.steps += int(usual.sum())
    repeated = np.flatnonzero(repeated_rows(block.values))
    state.whole_repeats = state.whole_repeats.plus(row + repeated)
    state.repeat_runs += int((np.diff(repeated, prepend=-1) > 1).sum())
    if known.any():
        state.last = float(t[known][-1])


def _add_stretches(state: Census, block: Block, t: np.ndarray) -> None:
    """Cuts stretches where a step of the samples' times t (rows,) [s], or a cell, is missing."""
    row, known = block.row, np.isfinite(t)
    before = np.maximum.accumulate(np.where(known, np.arange(len(t)), -1))
    earlier = np.concatenate([[-1], before[:-1]])
    steps = t - np.where(earlier >= 0, t[earlier], state.stop)  # from the last row that has a time
    gap, back = steps > state.sampling.longest_step, steps < 0
    if gap.any() and state.period:
        # less rows that are none
        lost = np.where(gap, np.round(steps / state.period - 1) - (np.arange(len(t)) - earlier - 1), 0)
        state.gaps = state.gaps.plus(row + np.flatnonzero(lost > 0))
        state.lost += int(lost[lost > 0].sum())
        state.widest = max(state.widest, float(steps[lost > 0].max(initial=0.0)))
    state.none += int((np.isfinite(block.t) & ~known).sum())
    good = known & np.isfinite(np.concatenate(list(block.values.values()), axis=1)).all(axis=1)
    _cut(state, t, row, good, gap | back)
    if known.any():
        state.stop = float(t[known][-1])
    _add_excerpt(state, block, t)


def _cut(state: Census, t: np.ndarray, row: int, good: np.ndarray, breaks: np.ndarray) -> None:
    """Ends the open stretch before gaps and at rows that are not good, and begins the next one behind them."""
    before = np.concatenate([[state.open_begin is not None], good[:-1]])
    ends, begins = before & (~good | breaks), good & (~before | breaks)
    for k in np.flatnonzero(ends | begins):
        if ends[k]:
            _close(state, row + int(k), float(t[k - 1]) if k else state.stop)
        if begins[k]:
            state.open_begin, state.open_start = row + int(k), float(t[k])


def _close(state: Census, end: int, stop: float | None = None) -> None:
    """Ends the open stretch before a row, at the time `stop` [s]; a short gap before it is bridged."""
    if state.open_begin is not None and end > state.open_begin:
        span = Span(state.open_begin, end, state.open_start, state.stop if stop is None else stop)
        joined = state.stretches[-1].joined(span, state.period) if state.stretches and state.bridges else None
        state.stretches[-1:] = [*state.stretches[-1:], span] if joined is None else [joined]
    state.open_begin = None


def _add_excerpt(state: Census, block: Block, t: np.ndarray) -> None:
    """Keeps the block in which signals change most from row to row, with the times t (rows,) [s] of its samples."""
    if len(block.t) < SHORTEST and state.motion >= 0.0:
        return
    name = next((name for name in ("q", "qd") if name in block.values), next(iter(block.values)))
    with np.errstate(invalid="ignore"):
        motion = float(np.nan_to_num(np.abs(np.diff(block.values[name], axis=0))).sum())
    if motion > state.motion:
        state.excerpt, state.sampled, state.motion = block, t, motion


def longest(happens: np.ndarray) -> int:
    """Length of the longest run of true entries."""
    return int(np.diff(runs_of_true(happens)).max(initial=0))

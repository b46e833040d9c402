"""Races: ours and its peers do the same work in turns (A B A B …), and nobody's time is shown before its result was checked."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Check:
    """Error of a result, and the largest allowed one."""

    error: float  # NaN where the result is not finite
    tolerance: float

    @property
    def passed(self) -> bool:
        return bool(self.error <= self.tolerance)

    def __str__(self) -> str:
        return f"{self.error:.1e} {'≤' if self.passed else 'not ≤'} {self.tolerance:.0e}"


def relative_error(result: np.ndarray, truth: np.ndarray, axes: int = 1) -> float:
    """The largest error of all states, each relative to the largest entry of its last `axes` axes; NaN where not finite."""
    last = tuple(range(-axes, 0))
    if result.shape != truth.shape or not (np.isfinite(result).all() and np.isfinite(truth).all()):
        return float("nan")
    return float((np.abs(result - truth).max(axis=last) / np.abs(truth).max(axis=last)).max())


@dataclass(frozen=True, eq=False)
class Contestant:
    """Somebody who does the work.

    Args:
        name: for the table.   run: does the work once.   units: states or steps in one run.
        check: looks at what `run` returned.
    """

    name: str
    run: Callable[[], Any]
    units: int
    check: Callable[[Any], Check]


@dataclass(frozen=True)
class Entry:
    """A row of a table: contestants by column, who all do the same work.

    Args:
        labels: what the row is about: arm, joints, work, …   contestants: by column.
        beside: the column of ours that a peer's column is divided by.   expected: the least ratio wanted of a peer's column.
        facts: other numbers of the row.
    """

    labels: Mapping[str, Any]
    contestants: Mapping[str, Contestant]
    beside: Mapping[str, str] = field(default_factory=dict)
    expected: Mapping[str, float] = field(default_factory=dict)
    facts: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Timing:
    """Samples of one contestant [ns per unit], none where its check failed."""

    name: str
    check: Check
    samples: list[float]

    @property
    def median(self) -> float:
        return statistics.median(self.samples)

    @property
    def best(self) -> float:
        return min(self.samples)


@dataclass(frozen=True)
class Row:
    """An entry with its times, by column."""

    entry: Entry
    timings: Mapping[str, Timing]

    def ratios(self, column: str) -> list[float]:
        """A peer's time over that of ours, each sample against its neighbour in time; empty where a check failed."""
        ours, peer = self.timings[self.entry.beside[column]], self.timings[column]
        return [b / a for a, b in zip(ours.samples, peer.samples, strict=False)]


def race(
    entries: list[Entry], repetitions: int, least: float = 2e-3, clock: Callable[[], float] = time.perf_counter
) -> list[Row]:
    """Checks every contestant, then times those that passed, in turns.

    Args:
        entries: rows to come; a contestant may be in several.   repetitions: samples of each.
        least: [s] a sample takes at least; short work is repeated within one.   clock: [s]; `time.process_time` where
            everything is done by this process: waiting for a processor does not count.
    """
    contestants = list(dict.fromkeys(c for entry in entries for c in entry.contestants.values()))
    timings = {c: Timing(c.name, c.check(c.run()), []) for c in contestants}
    able = [c for c in contestants if timings[c].check.passed]
    loops = {c: max(1, round(least / max(_seconds(c.run, 1, clock), 1e-9))) for c in able}
    gc.collect()
    gc.disable()
    try:
        for _ in range(repetitions):
            for c in able:
                timings[c].samples.append(1e9 * _seconds(c.run, loops[c], clock) / (loops[c] * c.units))
    finally:
        gc.enable()
    return [Row(e, {column: timings[c] for column, c in e.contestants.items()}) for e in entries]


def _seconds(run: Callable[[], Any], loops: int, clock: Callable[[], float]) -> float:
    start = clock()
    for _ in range(loops):
        run()
    return clock() - start

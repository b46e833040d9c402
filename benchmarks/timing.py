"""Races: ours and its peers do the same work in turns (A B A B …), and nobody's time is shown before its result was checked."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Check:
    """How far a result is from the truth, and how far it may be."""

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


@dataclass(frozen=True)
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
class Pair:
    """A row of the table: one of ours beside one peer.

    Args:
        work: what is done.   ours, peer: contestants.   expected: the ratio that is expected, if any.   note: if any.
    """

    work: str
    ours: Contestant
    peer: Contestant
    expected: float | None = None
    note: str = ""


@dataclass(frozen=True)
class Timing:
    """Samples of one contestant [ns per unit], and the check that allowed them."""

    samples: list[float]
    check: Check

    @property
    def median(self) -> float:
        return statistics.median(self.samples)

    @property
    def best(self) -> float:
        return min(self.samples)


@dataclass(frozen=True)
class Row:
    """A pair with its times."""

    pair: Pair
    ours: Timing
    peer: Timing

    @property
    def checked(self) -> bool:
        return self.ours.check.passed and self.peer.check.passed

    @property
    def ratio(self) -> float:
        """Peer's time over ours: the median over the repetitions, each against its neighbour in time."""
        return statistics.median(b / a for a, b in zip(self.ours.samples, self.peer.samples, strict=True))

    @property
    def ratio_at_best(self) -> float:
        return self.peer.best / self.ours.best


def race(pairs: list[Pair], repetitions: int, least: float = 2e-3) -> list[Row]:
    """Checks every contestant, then times those that passed, in turns.

    Args:
        pairs: rows to come; a contestant may be in several.   repetitions: samples of each.
        least: [s] a sample takes at least; short work is repeated within one.
    """
    contestants = list(dict.fromkeys(c for pair in pairs for c in (pair.ours, pair.peer)))
    checks = {c: c.check(c.run()) for c in contestants}
    able = [c for c in contestants if checks[c].passed]
    samples: dict[Contestant, list[float]] = {c: [] for c in contestants}
    loops = {c: max(1, round(least / _seconds(c.run, 1))) for c in able}
    gc.collect()
    gc.disable()
    try:
        for _ in range(repetitions):
            for c in able:
                samples[c].append(1e9 * _seconds(c.run, loops[c]) / (loops[c] * c.units))
    finally:
        gc.enable()
    timings = {c: Timing(samples[c], checks[c]) for c in contestants}
    return [Row(pair, timings[pair.ours], timings[pair.peer]) for pair in pairs]


def _seconds(run: Callable[[], Any], loops: int) -> float:
    start = time.perf_counter()
    for _ in range(loops):
        run()
    return time.perf_counter() - start

"""Sampling times of a run whose stamps jitter or whose rows repeat.

A logger that runs beside the controller takes some states twice and misses others, and stamps each row when it comes by. So a row
that repeats the one before is none. Whether samples were taken when the stamps say, or evenly while the stamps jitter, the motion
tells: with V a joint's mean speed around a row, the step of its position took

    d = Σ_j w_j Δq_j V_j / Σ_j w_j V_j²,

which is the step of the stamps, or a whole number of periods. Of even samples the time of a row is a whole number of periods: by
d where the motion is fast enough, else by the stamps.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise

import numpy as np

from armwright.identification.logs.blocks import Block
from armwright.identification.logs.quantisation import quantisation_step
from armwright.identification.logs.stretches import GAP

BRIEFEST = 1e-9  # [s] from row to row: less is no clock
OFTEN = 0.05  # share of steps
REGULAR = 0.6  # deviation of the rows between longer steps, by their mean; 1 by chance
COARSE = 1 / 16  # of a period: finer digits of times do not count
DIGITS = (1.0, 0.1, 0.01, 1e-3, 1e-4, 1e-5, 1e-6)  # [s] that times may be rounded to
LEVELS = 32  # different values: a signal of so few steps or stays by its nature
SELDOM = 20  # rows to one change: a signal that changes so seldom stays by its nature
SHORT = 3  # rows that repeat: of longer groups the motion says whether the arm rests
JUMPS = 1.5  # times the steps beside a group of repeated rows: the arm has moved meanwhile
COUNTS = 2.0  # of an encoder that a joint must move in a period if its position is to change
UNEVEN = 0.01  # jitter by the period: less is of the clock's digits
SPANS = (32, 256)  # rows between two stamps that a mean period is taken from
BESIDE = 2  # steps on either side of one over which its speed is meant
CERTAIN = 0.15  # of a period: deviation of d that still tells a whole number
FEWEST = 64  # rows that a clock is estimated from


@dataclass(frozen=True, eq=False)
class Sampling:
    """Sampling of a run, estimated from its first rows.

    Attributes:
        period: from row to row [s], usually.   resolution: to which times are rounded [s]; 0 where that is fine.
        repeats: rows that repeat the one before are none.   even: samples are even, and the stamps jitter about their times.
        weights: (joints,) w of the positions' steps.   noise: c of the deviation c / √(Σ w V²) of d [s].
        by_speeds: V are the logged speeds.
        counts: (joints,) [rad | m] by which a joint must move in a period for its position to change; empty without speeds.
        encoder: (joints,) [rad | m] of a position's counts; 0 where it has none.
    """

    period: float = 0.0
    resolution: float = 0.0
    repeats: bool = False
    even: bool = False
    weights: np.ndarray = field(default_factory=lambda: np.zeros(0))
    noise: float = np.inf
    by_speeds: bool = False
    counts: np.ndarray = field(default_factory=lambda: np.zeros(0))
    encoder: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def longest_step(self) -> float:
        """Longest step of time [s] without a gap; rounding alone makes steps a digit longer."""
        rounded = self.resolution * (0.5 if self.period > GAP * self.resolution else 1.0)
        return GAP * self.period + (0.0 if self.even else rounded) + BRIEFEST


def sampling_of(block: Block, mends: bool) -> Sampling:
    """The sampling of a run, estimated from its first rows.

    Args:
        block: of its beginning.   mends: look for repeated rows and jittering stamps; in logs of commands these may be meant.
    """
    found = _clock(block.t)
    if not mends or not found.period:
        return found
    restless = any(map(is_restless, _columns(block.values)))
    found = replace(found, repeats=restless, counts=_counts(block.values), encoder=_encoder(block.values.get("q")))
    fresh = ~_stale(found, block, None)
    if not fresh.all():
        times = _clock(block.t[fresh])
        found = replace(found, period=times.period, resolution=times.resolution)
    q, qd = _motion(block)
    known = fresh & np.isfinite(block.t) & np.isfinite(q).all(axis=1)
    if qd is not None:
        known &= np.isfinite(qd).all(axis=1)
    t, q, qd = block.t[known], q[known], None if qd is None else qd[known]
    steps = np.diff(t)
    usual = steps[(steps > 0) & (steps <= found.longest_step)]
    jitters = len(usual) > FEWEST and float(np.std(usual)) > UNEVEN * found.period
    if jitters and not found.resolution:
        found = replace(found, period=_mean_period(found, block.t))
    return _by_motion(found, t, q, qd) if jitters else found


def _motion(block: Block) -> tuple[np.ndarray, np.ndarray | None]:
    """Positions (rows, joints), and speeds of the same joints where these are logged."""
    q, qd = block.values.get("q", np.zeros((len(block.t), 0))), block.values.get("qd")
    return q, None if qd is None or qd.shape != q.shape else qd


def _mean_period(found: Sampling, t: np.ndarray) -> float:
    """Mean time [s] between samples, by the stamps of rows far apart; repeated rows count, as they alone come early."""
    t = t[np.isfinite(t)]
    steps = np.diff(t)
    period = float(np.median(steps[steps > 0]))
    for count in (each for each in SPANS if each < len(t) // 4):
        spans = t[count:] - t[:-count]
        period = float(np.median(spans / np.maximum(np.round(spans / period), 1.0)))
    return period * max(round(found.period / period), 1)


def _clock(t: np.ndarray) -> Sampling:
    """Period and resolution of times (rows,) [s]."""
    steps = np.diff(t[np.isfinite(t)])
    period = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    found = Sampling(period if period > BRIEFEST else 0.0)
    digit = resolution_of(t[np.isfinite(t)], found.period)
    if not digit:
        return found
    found = replace(found, resolution=digit)  # then a usual step is a digit too long or too short
    return replace(found, period=float(np.mean(steps[(steps >= 0) & (steps <= found.longest_step)])))


def resolution_of(t: np.ndarray, period: float) -> float:
    """Digit [s] to which times (rows,) [s] were rounded; 0 if fine beside the period or without effect on the steps."""
    steps = np.diff(t)
    for digit in DIGITS if period else ():
        if digit <= COARSE * period:
            break
        whole = np.abs(steps / digit - np.round(steps / digit)).max(initial=0.0) < 1e-4
        shorter, longer = (np.abs(steps - (period + off)) < 0.5 * digit for off in (-digit, digit))
        # lost rows make steps longer too
        if whole and (shorter.any() or (longer.mean() > OFTEN and _is_regular(longer))):
            return digit
    return 0.0


def _is_regular(longer: np.ndarray) -> bool:
    """True of longer steps (rows,) that come in turn, as rounding makes them; rows are lost by chance."""
    apart = np.diff(np.flatnonzero(longer))
    return len(apart) > 1 and float(apart.std()) < REGULAR * float(apart.mean())


@dataclass(frozen=True, eq=False)
class _Steps:
    """From each sample to the next: times dt (k,) of the stamps [s], motion (k, joints), and mean speeds (k, joints)."""

    dt: np.ndarray
    motion: np.ndarray
    speeds: np.ndarray

    @classmethod
    def of(cls, t: np.ndarray, q: np.ndarray, qd: np.ndarray | None) -> _Steps:
        """Those between samples at stamps t (rows,), by logged speeds qd (rows, joints) or by the motion around each step."""
        if qd is not None:
            return cls(np.diff(t), np.diff(q, axis=0), 0.5 * (qd[1:] + qd[:-1]))
        k = np.arange(1, len(t))
        low, high = np.maximum(k - 1 - BESIDE, 0), np.minimum(k + BESIDE, len(t) - 1)
        speeds = (q[high] - q[low]) / np.maximum(t[high] - t[low], BRIEFEST)[:, None]
        return cls(np.diff(t), np.diff(q, axis=0), speeds)

    def times(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """d (k,) [s], and Σ w V² (k,)."""
        size = (weights * self.speeds**2).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            return (weights * self.motion * self.speeds).sum(axis=1) / size, size

    def periods(self, sampling: Sampling) -> tuple[np.ndarray, np.ndarray]:
        """(k,) whole periods, by the motion where it tells, else by the stamps; and where it tells."""
        dt = self.dt / sampling.period
        late = self.dt > sampling.longest_step + sampling.resolution
        three = np.convolve(np.pad(dt, 1, mode="edge"), np.ones(3), "valid") if len(dt) else dt
        # else the stamps beside it are early
        by_stamps = np.where(late & ((three > 3.5) | (dt > 2.5)), np.round(dt), 1.0)
        if len(sampling.weights) != self.motion.shape[1]:
            return np.maximum(by_stamps, 1.0), np.zeros(len(dt), dtype=bool)
        d, size = self.times(sampling.weights)
        with np.errstate(divide="ignore", invalid="ignore"):
            by_motion = sampling.noise / np.sqrt(size) < CERTAIN * sampling.period
            by_motion &= np.isfinite(d) & (np.abs(d / sampling.period - dt) < GAP)
        return np.maximum(
            np.where(by_motion, np.round(np.where(by_motion, d / sampling.period, 0.0)), by_stamps), 1.0
        ), by_motion


def _by_motion(found: Sampling, t: np.ndarray, q: np.ndarray, qd: np.ndarray | None) -> Sampling:
    """The sampling with `even`, judged by the motion (rows, joints) at stamps (rows,), else by the stamps."""
    if found.resolution or len(t) < FEWEST:
        return replace(found, even=bool(found.resolution))
    least, best = np.inf, found
    for by_speeds in (False, True) if qd is not None else (False,):
        each = _Steps.of(t, q, qd if by_speeds else None)
        rest = np.median((each.motion - each.speeds * each.dt[:, None]) ** 2, axis=0)
        weights = np.where((each.motion != 0).any(axis=0), 1.0 / np.maximum(rest, 1e-300), 0.0)
        d, size = each.times(weights)
        moving = (size > np.median(size)) & np.isfinite(d)
        if moving.sum() < FEWEST:
            continue
        off = d[moving] - found.period * np.round(d[moving] / found.period)
        by_grid, by_stamps = (float(np.median(np.abs(error))) for error in (off, d[moving] - each.dt[moving]))
        if by_grid < min(by_stamps, least):
            noise = float(np.median(np.abs(off) * np.sqrt(size[moving]))) / 0.6745
            least = by_grid
            best = replace(found, even=True, weights=weights, noise=noise, by_speeds=by_speeds)
    return best


# --- rows that repeat the one before ----------------------------------------------------------------------------------


def _columns(values: Mapping[str, np.ndarray]) -> Iterator[np.ndarray]:
    """Columns of all signals but slow temperatures."""
    fast = {name: each for name, each in values.items() if name != "temperature"} or values
    return (column for each in fast.values() for column in each.T)


def repeated_rows(values: Mapping[str, np.ndarray]) -> np.ndarray:
    """(rows,) True where a row repeats the one before in all signals but temperatures."""
    table = np.stack(list(_columns(values)), axis=1)
    return np.concatenate([[False], (np.diff(table, axis=0) == 0).all(axis=1)])


def is_restless(column: np.ndarray) -> bool:
    """True of a signal that does not repeat by itself, as commands of few levels or long holds and slow encoders do."""
    column = column[np.isfinite(column)]
    steps = np.abs(np.diff(column))
    steps = steps[steps > 0]
    if len(np.unique(column)) <= LEVELS or len(steps) * SELDOM < len(column):
        return False
    count = quantisation_step(column)
    return not count or float(np.median(steps)) > JUMPS * count


def _counts(values: Mapping[str, np.ndarray]) -> np.ndarray:
    """(joints,) motion in a period [rad | m] that must change a position, where speeds of the same joints are logged."""
    q, qd = values.get("q"), values.get("qd")
    if q is None or qd is None or q.shape != qd.shape:
        return np.zeros(0)
    found = []
    for column in q.T:
        column = column[np.isfinite(column)]
        steps = np.abs(np.diff(column))
        count = quantisation_step(column) if len(column) > FEWEST else None
        found.append(COUNTS * (count or float(np.median(steps[steps > 0])) if (steps > 0).any() else np.inf))
    return np.array(found)


def _encoder(q: np.ndarray | None) -> np.ndarray:
    """(joints,) [rad | m] of the counts of positions (rows, joints); 0 where they have none."""
    columns = [] if q is None else [column[np.isfinite(column)] for column in q.T]
    return np.array([quantisation_step(each) or 0.0 if len(each) > FEWEST else 0.0 for each in columns])


def _stale(sampling: Sampling, block: Block, following: Block | None) -> np.ndarray:
    """(rows,) True where a row is none: it repeats the one before, though the arm moves.

    Args:
        block: rows, with the one before them as their first where there is one.   following: the next rows.
    """
    stale = np.zeros(len(block.t), dtype=bool)
    if sampling.repeats:
        more = {} if following is None else {n: v[: len(block.t)] for n, v in following.values.items()}
        joined = {n: np.concatenate([v, more[n]]) if more else v for n, v in block.values.items()}
        stale = _of_motion(repeated_rows(joined), joined.get("q"), sampling.encoder)[: len(stale)]
    if len(sampling.counts):
        q, qd = block.values["q"], block.values["qd"]
        same = np.concatenate([[False], (np.diff(q, axis=0) == 0).all(axis=1)])
        with np.errstate(invalid="ignore"):
            stale |= same & (np.abs(qd) * sampling.period > sampling.counts).any(axis=1)
    return stale


def _of_motion(repeated: np.ndarray, q: np.ndarray | None, encoder: np.ndarray) -> np.ndarray:
    """Repeated rows (rows,) without those in which the arm rests: positions (rows, joints) go on as before a long group, or
    move by no more than a count (joints,) around a short one.
    """
    fresh, found = np.flatnonzero(~repeated), repeated.copy()
    rows = np.diff(fresh)  # from one fresh row to the next
    if q is None:
        speeds = np.zeros((len(rows), 0))
    else:
        speeds = np.abs(np.diff(q[fresh], axis=0)) / rows[:, None]  # a row
    creeping = encoder.size > 0 and speeds.shape[1] == encoder.size
    rests = np.zeros(len(rows), dtype=bool)
    if creeping:
        rests = np.asarray((speeds * rows[:, None] <= JUMPS * encoder).all(axis=1))
    around = np.convolve(np.pad(rests, 1, constant_values=True), np.ones(3), "valid") if len(rows) else rests
    for k in np.flatnonzero((rows > 1) & (rows - 1 <= SHORT) & (around == 3)):
        found[fresh[k] + 1 : fresh[k + 1]] = False
    for k in np.flatnonzero(rows - 1 > SHORT):
        beside = [speeds[j] for j in (k - 1, k + 1) if 0 <= j < len(speeds)]
        moved = len(beside) == 2 and (speeds[k] * rows[k] > JUMPS * np.max(beside, axis=0)).any()
        found[fresh[k] + 1 : fresh[k + 1]] = moved
    if len(fresh):
        found[fresh[-1] + 1 :] &= len(found) - fresh[-1] - 1 <= SHORT
    return found


class SampleClock:
    """Times of a run's rows, block by block in their order."""

    def __init__(self, sampling: Sampling):
        self.sampling = sampling
        self._last: Block | None = None  # the row before
        self._sample: Block | None = None  # the last one, with its stamp
        self._time = np.nan  # of it

    def times(self, block: Block, following: Block | None = None) -> np.ndarray:
        """(rows,) [s]; NaN for rows that are none.

        Args:
            block: the next rows.   following: those after them, if there are any.
        """
        s = self.sampling
        if not (s.repeats or s.even or len(s.counts)):
            return block.t
        whole = block if self._last is None else _joined(self._last, block)
        stale = _stale(s, whole, following)[len(whole.t) - len(block.t) :]
        self._last = Block(0, whole.t[-3:], {name: each[-3:] for name, each in whole.values.items()})
        t = np.where(stale, np.nan, block.t)
        return self._even(t, block) if s.even else t

    def _even(self, t: np.ndarray, block: Block) -> np.ndarray:
        """Times on the grid of samples; rows that go back in time stay so."""
        known = np.flatnonzero(np.isfinite(t))
        if not len(known):
            return t
        part = Block(0, t[known], {name: each[known] for name, each in block.values.items() if name in ("q", "qd")})
        part = part if self._sample is None else _joined(self._sample, part)
        q, qd = _motion(part)
        periods, _ = _Steps.of(part.t, q, qd if self.sampling.by_speeds else None).periods(self.sampling)
        times = (part.t[0] if self._sample is None else self._time) + self.sampling.period * np.cumsum([0.0, *periods])
        if self._sample is None:
            times += np.median(part.t - times)  # the first stamp is as late as any
        times = np.where(np.diff(part.t, prepend=part.t[0]) < 0, part.t, times)
        even = t.copy()
        even[known] = times[-len(known) :]
        self._time = float(times[-1])
        self._sample = Block(0, part.t[-1:], {name: each[-1:] for name, each in part.values.items()})
        return even


def _joined(first: Block, second: Block) -> Block:
    """Rows of both."""
    values = {name: np.concatenate([each, second.values[name]]) for name, each in first.values.items()}
    return Block(first.row, np.concatenate([first.t, second.t]), values)


def with_following(blocks: Iterable[Block]) -> Iterator[tuple[Block, Block | None]]:
    """Each block with the next one."""
    return pairwise(chain(blocks, [None]))  # type: ignore[arg-type]


def sampled(blocks: Iterable[Block], sampling: Sampling) -> Iterator[Block]:
    """Blocks of a run with the times at which their rows were sampled."""
    clock = SampleClock(sampling)
    for block, following in with_following(blocks):
        yield replace(block, t=clock.times(block, following))

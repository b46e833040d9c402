"""Checks of single rows and cells of a log: its clock, its columns, and its motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import pi

import numpy as np

from armwright.identification.logs.census import Census, EventPlaces, SignalCensus
from armwright.identification.logs.findings import Found, error, note, number_of, warning
from armwright.identification.logs.log import Log, LogRun
from armwright.identification.logs.quantisation import quantisation_step
from armwright.identification.logs.sampling import is_restless
from armwright.identification.logs.spectrum import longest_finite, motion_band
from armwright.identification.logs.spikes import spike_limits, standing_out
from armwright.identification.logs.stretches import bridged_rows

UNEVEN, WILD = 0.01, 0.3  # jitter as a share of the period that is noted, and that no interpolation mends
STILL = 1e-3  # of a joint's largest range over all runs: less is rest
STEPS = 3  # of quantisation: less is rest
SHORTEST = 32  # rows of a signal that has a spectrum
STAY = 5  # rows at an extreme that look like a limit
HELD = 0.2  # share of rows that repeat: a command in steps
FEW_LEVELS, OFTEN = 8, 2.0  # of a command in steps; times as often at the extremes as at other levels
LEVELS = 32  # different values: a signal of so few steps or stays by its nature
REPEATED, LONG = 0.005, 20  # share of repeated rows that is noted; rows at a time, above which the arm rests
FEWEST = 32  # rows of a stretch that can be used


def _rows(places: EventPlaces) -> str:
    """`row 12, row 90 and 3 more`; rows from 1."""
    first = ", ".join(f"row {row + 1}" for row in places.rows)
    more = places.count - len(places.rows)
    return f"{first} and {more} more" if more else first


def clock(log: Log, run: LogRun, census: Census) -> Found:
    """Findings about time: backward steps, missing or repeated times, gaps, jitter."""
    rate = 1.0 / census.period
    if census.backwards.count:
        place = log.place(run, census.backwards.rows[0])
        what = f"time goes backwards {number_of(census.backwards.count, 'time')}: {_rows(census.backwards)}; first at {place}"
        many = census.backwards.count > 0.01 * census.rows
        expected = "one clock in the column; two recordings are two runs" if many else "rows in the order of time"
        yield error(what, "time", expected)
    if census.no_time.count:
        rows = number_of(census.no_time.count, "row")
        first = log.place(run, census.no_time.rows[0])
        yield note(f"{rows} without time left out: {_rows(census.no_time)}; first at {first}", "time")
    if census.same_time.count:
        share = census.same_time.count / census.rows
        rows = number_of(census.same_time.count, "row")
        what = f"{rows} ({share:.2%}) at the time of the row before: {_rows(census.same_time)}"
        yield (error if share > 0.5 else note)(f"{what}; times are too coarse, or rows were written twice", "time")
    if census.gaps.count:
        parts = f"the run falls into {_stretches(run)}"
        each = "" if census.gaps.count == 1 else " in all"
        missing = f"{number_of(census.gaps.count, 'gap')} of about {number_of(census.lost, 'row')}{each}"
        what = f"{missing}; the widest is {census.widest:.4g} s: before {_rows(census.gaps)}; {parts}"
        yield note(what, "time")
    share = census.jitter / census.period
    if census.jitter <= census.resolution:
        if census.resolution:
            what = f"times are rounded to {1e3 * census.resolution:g} ms, from row to row it takes {1e3 * census.period:.4g} ms"
            yield note(f"{what}: rows count as evenly spaced", "time")
    elif share > UNEVEN:
        what = f"uneven: {rate:.5g} Hz, from row to row {1e3 * census.period:.4g} ms ± {1e3 * census.jitter:.2g} ms ({share:.1%})"
        if census.sampling.even:
            yield note(f"{what}; the motion is even: stamps are late, rows stand at whole periods", "time")
        elif share > WILD:
            yield error(what, "time", "steps of time that are nearly equal; is it the clock of the samples?")
        else:
            yield note(f"{what}; preparation interpolates at even times", "time")


def _stretches(run: LogRun) -> str:
    """`3 stretches`, and how many are left for the fit of an arm."""
    count, joined = run.census.pieces, len(run.census.stretches)
    cut = f"{count} stretch{'es' * (count != 1)}"
    bridged = bridged_rows(run.period)
    return cut if joined == count else f"{cut}, of which preparation makes {joined}: it bridges up to {bridged} rows"


def none(log: Log, run: LogRun, census: Census) -> Found:
    """A finding about rows that are none, where no other finding says how many."""
    if census.none and not any(True for _ in _repeats(census)):
        what = f"{number_of(census.none, 'row')} ({census.none / census.rows:.2%}) left out"
        yield warning(f"{what}: they repeat the row before, or its positions, though the arm moves", "rows")


def _columns(log: Log, census: Census) -> Iterator[tuple[str, str, str, SignalCensus, int]]:
    """(signal, place in words, unit, its census, entry) of every column."""
    for signal in log.layout:
        for k, joint in enumerate(signal.joints or ()):
            yield signal.name, f"{signal.name} {log.joints[joint]}", signal.units[k], census.signals[signal.name], k


def runs_at_rest(log: Log, joint: str, runs: Sequence[str]) -> set[str]:
    """Runs of a joint at rest: its range is a thousandth of that over all runs, a few counts, or noise."""
    name = next(name for name in ("q", "qd") if name in log.layout)
    places = log.layout[name].joints or ()
    if log.joints.index(joint) not in places:
        return set()
    column, order, still = places.index(log.joints.index(joint)), 2 if name == "q" else 1, set()
    ends = [(run.census.signals[name].low[column], run.census.signals[name].high[column]) for run in log.runs]
    largest = max(high for _, high in ends) - min(low for low, _ in ends)
    for run in (log.run(each) for each in runs):
        extent = float(run.census.signals[name].high[column] - run.census.signals[name].low[column])
        values = longest_finite(run.census.excerpt.values[name][:, column])
        step = quantisation_step(values) or 0.0
        within = extent <= max(STILL * largest, STEPS * step)
        has_spectrum = len(values) >= SHORTEST and values.std() > 0
        if within or (has_spectrum and motion_band(values, 1.0 / run.census.period, order, step)[0] == 0.0):
            still.add(run.name)
    return still


def cells(log: Log, run: LogRun, census: Census) -> Found:
    """Findings about cells: empty ones, constant and quantised columns, saturation, and repeated rows."""
    yield from _repeats(census)
    for name, place, unit, counted, k in _columns(log, census):
        if counted.missing[k].count:
            if counted.missing[k].count >= census.rows:
                yield error("all cells are empty", place, expected="numbers")
                continue
            first = log.missing_cell(run, name, (log.layout[name].joints or ())[k], counted.missing[k].rows[0])
            places = f"{_rows(counted.missing[k])}; first at {first}"
            count = counted.missing[k].count
            what = f"{number_of(count, 'cell')} {'is' if count == 1 else 'are'} empty or not finite: {places}"
            yield note(f"{what}; the run falls into {_stretches(run)}", place)
        low, high = counted.low[k], counted.high[k]
        if low == high:
            yield note(f"constant, {low:.6g} {unit}: this run says nothing about it", place)
            continue
        if name == "q" and run.name in runs_at_rest(log, log.joints[(log.layout[name].joints or ())[k]], [run.name]):
            yield note(f"at rest within {high - low:.3g} {unit}: this run says nothing about its friction", place)
        column = longest_finite(census.excerpt.values[name][:, k])
        step = quantisation_step(column) if len(column) > 16 else None
        if step:
            turn = f", {2 * pi / step:.6g} in a turn" if name == "q" and unit == "rad" else ""
            yield note(f"quantised in steps of {step:.4g} {unit}{turn}", place)
        if name in ("tau", "current", "voltage", "qd"):
            if counted.repeats[k] > HELD * counted.counted:
                yield from _clipped(column, place, unit)
            else:
                yield from _stuck_at_extreme(counted, k, place, unit, column)


def _repeats(census: Census) -> Found:
    """Rows that repeat all signals in short runs: held by a slower loop, or lost; long runs are rest."""
    repeats, runs = census.whole_repeats.count, census.repeat_runs
    if census.sampling.repeats and census.none < REPEATED * census.rows:  # the arm rests
        return
    columns = [column for name, values in census.excerpt.values.items() if name != "temperature" for column in values.T]
    changing = [column for column in columns if np.ptp(column) > 0]
    if not any(map(is_restless, changing)) or repeats < REPEATED * census.rows or repeats > LONG * max(runs, 1):
        return
    rate = (census.rows - repeats) / max(census.last - census.first, census.period)
    what = f"{repeats} rows ({repeats / census.rows:.0%}) repeat the row before in all signals, {repeats / runs:.1f} at a time"
    left = f"; {number_of(census.none, 'row')} left out" if census.none else ""
    yield warning(f"{what}: samples were lost, or held by a loop of about {rate:.4g} Hz{left}", "rows")


def limits_reached(counted: SignalCensus, k: int, column: np.ndarray) -> tuple[float, float]:
    """Extremes of a signal that else changes from row to row, -inf or inf where it does not stay.

    Args:
        counted, k: its census.   column: rows of it.
    """
    if counted.repeats[k] > HELD * counted.counted or len(np.unique(column)) <= LEVELS:
        return -np.inf, np.inf
    low = counted.low[k] if counted.at_low[k] >= STAY else -np.inf
    return low, counted.high[k] if counted.at_high[k] >= STAY else np.inf


def spikes(log: Log, run: LogRun, census: Census) -> Found:
    """Findings about single rows that stand out, of the rows with the most motion."""
    limits = spike_limits(census, log.held)
    for name, place, unit, _, k in _columns(log, census) if limits else ():
        limit = limits[name][k] if name in limits else np.inf
        rows = np.concatenate([standing_out(each.values[name][:, k], limit) for each in census.even])
        if rows.any():
            what = f"{number_of(int(rows.sum()), 'row')} ({rows.mean():.2%}) by more than {limit:.4g} {unit}"
            yield warning(f"{what} off the rows beside: glitches of a bus or a sensor; the fit goes past them", place)


def _stuck_at_extreme(counted: SignalCensus, k: int, place: str, unit: str, column: np.ndarray) -> Found:
    """Stays at an extreme, where the signal else changes from row to row."""
    stays = counted.at_low[k], counted.at_high[k]
    for value, stay in zip(limits_reached(counted, k, column), stays, strict=True):
        if np.isfinite(value):
            what = f"stays at its extreme {value:.6g} {unit} for {stay} rows"
            yield warning(f"{what}: a limit, or a full converter", place)


def _clipped(column: np.ndarray, place: str, unit: str) -> Found:
    """A command in steps that goes to its extremes far more often than to its other levels."""
    visited = column[np.flatnonzero(np.diff(column, prepend=np.nan) != 0)]
    levels, extremes = len(np.unique(visited)), (visited == visited.min()) | (visited == visited.max())
    if levels >= FEW_LEVELS and extremes.mean() > OFTEN * 2 / levels:
        ends = f"{visited.min():.6g} and {visited.max():.6g} {unit}"
        what = f"{extremes.mean():.0%} of its {len(visited)} steps go to its extremes {ends}, of {levels} levels"
        yield warning(f"{what}: a limit, or a full converter", place)


def motion(log: Log, run: LogRun, census: Census) -> Found:
    """Findings about logs without motion, without a torque signal, or without a long enough stretch."""
    moving = [census.signals[name] for name in ("q", "qd") if name in census.signals]
    found = note if {"voltage", "current"} <= set(log.layout.names) else error  # of locked rotors, they tell R and L
    if not moving:
        yield found("neither positions nor speeds are logged", "signals", "one of them")
    elif not any((each.low < each.high).any() for each in moving):
        yield found("nothing moves: positions and speeds are constant", "signals", "a run with motion")
    if not any(name in log.layout for name in ("tau", "tau_link", "current", "voltage")):
        yield note("no torque, current or voltage is logged: nothing can be said about forces", "signals")
    longest = max((stretch.rows for stretch in census.stretches), default=0)
    if longest <= FEWEST:
        yield error(f"the longest stretch without a gap has {number_of(longest, 'row')}", "rows", f"more than {FEWEST}")

"""Checks of a log: each says what it found with numbers and place, and what that means.

| check        | what it looks at                                                                                        |
|--------------|---------------------------------------------------------------------------------------------------------|
| clock        | rate, jitter, gaps, rows at the same time, time that goes backwards, rows without time                  |
| cells        | empty cells, columns that never change, stays at an extreme, rows repeated, quantisation                |
| units        | positions against limits, speed against the derivative of position: units, sides, signs, mixed-up joints |
| delays       | speed behind position, torque behind motion, in fractions of a sample                                   |
| power        | torques, currents and voltages that would take energy out of a machine that only loses it               |
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import pi
from typing import Any, Literal

import numpy as np
from scipy import signal as sp

from armwright.errors import LogError, Problem
from armwright.identification.logs.census import Census, Places, SignalCensus
from armwright.identification.logs.delay import Delay, delay_between
from armwright.identification.logs.log import Finding, Log, LogRun
from armwright.identification.logs.preparation import choose_preparation, longest_finite, settling
from armwright.identification.logs.quantisation import quantisation_step

UNEVEN, WILD = 0.01, 0.3  # jitter as a share of the period that is noted, and that no interpolation mends
STAY = 5  # rows at an extreme that look like a limit
LEVELS = 32  # different values: a signal of so few steps or stays by its nature
REPEATED, LONG = 0.005, 20  # share of repeated rows that is noted; rows at a time, above which the arm rests
SAME, CLOSE = 0.03, 0.10  # gain of speed to derivative: equal, nearly
OFF, CERTAIN = 0.9, 0.99  # correlation above which a gain says something, and a delay
EXPLAINED, BETTER = (
    0.9,
    0.7,
)  # by a joint's model: share of the variance, and residual at the best delay by that at none
DELAYED = 0.1  # of a sample
TURNS = 8 * pi  # [rad]: few joints turn further
BEYOND = 0.02  # [rad | m] beyond its limits a joint may be, by overshoot and calibration
FEWEST = 32  # rows of a stretch that can be used
SLOWEST = 1e-50  # [rad/s, or N m]: squares of less underflow
LEVEL = 1e-6  # of its size: an effort that changes less is constant
SOFT = 0.02  # of the largest speed: where Coulomb friction changes its sign
AGAINST, CERTAINLY = 0.5, 0.9  # share of the power that goes against the motion: noted, and an error of voltages
LOSS, RETURNED = (
    0.1,
    0.1,
)  # work below which it is negative, by the power's flow; distance by the motion that is a return
FACTORS = {  # speed / derivative of position → the mistake that makes it
    180 / pi: "the speed is in degrees where radians are meant, or the position in radians where degrees are",
    pi / 180: "the position is in degrees where radians are meant, or the speed in radians where degrees are",
    30 / pi: "the speed is in rpm where rad/s is meant",
    pi / 30: "the speed is in rad/s where rpm is meant",
    1 / (2 * pi): "the speed is in turns where radians are meant",
    2 * pi: "the position is in turns where radians are meant",
    1e3: "the time is in ms where s is meant, or the rate a thousand times too low",
    1e-3: "the time is in s where ms is meant, or the rate a thousand times too high",
}
NUMBERS = re.compile(r"-?[\d.]+(e[+-]?\d+)?")
Level = Literal["error", "note"]
Found = Iterator[tuple[Level, Problem]]


def _error(what: str, place: str, expected: str = "") -> tuple[Level, Problem]:
    return "error", Problem(what, place, expected=expected)


def _note(what: str, place: str, expected: str = "") -> tuple[Level, Problem]:
    return "note", Problem(what, place, expected=expected)


def check_log(log: Log) -> list[Finding]:
    """All findings about a log whose runs have their census."""
    checks: dict[str, tuple[Callable[[Log, LogRun, Census], Found], ...]] = {
        "clock": (_clock,),
        "cells": (_cells, _motion),
        "units": (_limits, _speeds),
        "delays": (_torque_delays,),
        "power": (_power,),
    }
    findings = [
        Finding(level, name, run.name, problem)
        for run in log.runs
        for name, functions in checks.items()
        for function in functions
        for level, problem in (() if run.census is None else function(log, run, run.census))
    ]
    return _once(findings, log)


def _once(findings: list[Finding], log: Log) -> list[Finding]:
    """Findings that several runs share, but for their numbers, as one, with the first run's numbers."""
    alike: dict[tuple[Any, ...], list[Finding]] = {}
    for each in findings:
        key = (each.level, each.check, each.problem.place, NUMBERS.sub("#", each.problem.what))
        before = sum(other.run == each.run for k, group in alike.items() if k[:4] == key for other in group)
        alike.setdefault((*key, before), []).append(each)  # a second of the same run stands for itself
    kept = []
    for first, *others in alike.values():
        if others:
            more = (
                "all other runs"
                if len(others) + 1 == len(log.runs)
                else f"{len(others)} of {len(log.runs) - 1} other runs"
            )
            first = replace(first, problem=replace(first.problem, what=f"{first.problem.what} (alike in {more})"))
        kept.append(first)
    return kept


def _rows(places: Places) -> str:
    """`row 12, row 90 and 3 more`; rows from 1."""
    first = ", ".join(f"row {row + 1}" for row in places.rows)
    more = places.count - len(places.rows)
    return f"{first} and {more} more" if more else first


def _clock(log: Log, run: LogRun, census: Census) -> Found:
    rate = 1.0 / census.period
    if census.backwards.count:
        place = log.place(run, "time", 0, census.backwards.rows[0])
        what = f"time goes backwards {census.backwards.count} times: {_rows(census.backwards)}; first at {place}"
        many = census.backwards.count > 0.01 * census.rows
        expected = "one clock in the column; two recordings are two runs" if many else "rows in the order of time"
        yield _error(what, "time", expected)
    if census.no_time.count:
        yield _note(f"{census.no_time.count} rows have no time and are left out: {_rows(census.no_time)}", "time")
    if census.same_time.count:
        share = census.same_time.count / census.rows
        what = f"{census.same_time.count} rows ({share:.2%}) have the time of the row before: {_rows(census.same_time)}"
        yield (_error if share > 0.5 else _note)(f"{what}; times are too coarse, or rows were written twice", "time")
    if census.gaps.count:
        what = (
            f"{census.gaps.count} gaps, where about {census.lost} rows are missing; the widest is {census.widest:.4g} s: "
            f"before {_rows(census.gaps)}; the run falls into {len(census.stretches)} stretches"
        )
        yield _note(what, "time")
    share = census.jitter / census.period
    if share > UNEVEN:
        what = f"uneven: {rate:.5g} Hz, from row to row {1e3 * census.period:.4g} ms ± {1e3 * census.jitter:.2g} ms ({share:.1%})"
        if share > WILD:
            yield _error(what, "time", "steps of time that are nearly equal; is it the clock of the samples?")
        else:
            yield _note(f"{what}; preparation interpolates at even times", "time")


def _columns(log: Log, census: Census) -> Iterator[tuple[str, str, str, SignalCensus, int]]:
    """(signal, place in words, unit, its census, entry) of every column."""
    for signal in log.layout:
        for k, joint in enumerate(signal.joints or ()):
            yield signal.name, f"{signal.name} {log.joints[joint]}", signal.units[k], census.signals[signal.name], k


def _cells(log: Log, run: LogRun, census: Census) -> Found:
    yield from _repeats(census)
    for name, place, unit, counted, k in _columns(log, census):
        if counted.missing[k].count:
            everything = counted.missing[k].count >= census.rows
            first = log.place(run, name, (log.layout[name].joints or ())[k], counted.missing[k].rows[0])
            what = f"{counted.missing[k].count} cells are empty or not finite: {_rows(counted.missing[k])}; first at {first}"
            if everything:
                yield _error("all cells are empty", place, expected="numbers")
                continue
            yield _note(f"{what}; the run is cut there, into {len(census.stretches)} stretches", place)
        low, high = counted.low[k], counted.high[k]
        if low == high:
            yield _note(f"constant, {low:.6g} {unit}: this run says nothing about it", place)
            continue
        column = longest_finite(census.excerpt.values[name][:, k])
        step = quantisation_step(column) if len(column) > 16 else None
        if step:
            turn = f", {2 * pi / step:.6g} in a turn" if name == "q" and unit == "rad" else ""
            yield _note(f"quantised in steps of {step:.4g} {unit}{turn}", place)
        if name in ("tau", "current", "voltage", "qd") and len(np.unique(column)) > LEVELS:
            yield from _stays(counted, k, place, unit)


def _repeats(census: Census) -> Found:
    """Rows that repeat all signals in short runs: held by a slower loop, or lost; long runs are rest."""
    repeats, runs = census.whole_repeats.count, census.repeat_runs
    columns = [column for values in census.excerpt.values.values() for column in values.T]
    changing = [column for column in columns if np.ptp(column) > 0]
    coarse = any(len(np.unique(column)) <= LEVELS for column in changing)  # such a signal repeats by itself
    if coarse or not changing or repeats < REPEATED * census.rows or repeats > LONG * max(runs, 1):
        return
    fresh = census.rows - repeats
    rate = fresh / census.rows / census.period
    what = f"{repeats} rows ({repeats / census.rows:.0%}) repeat the row before in all signals, {repeats / runs:.1f} at a time"
    yield _note(f"{what}: samples were lost, or held by a loop of about {rate:.4g} Hz", "rows")


def _stays(counted: SignalCensus, k: int, place: str, unit: str) -> Found:
    """Stays at an extreme, where the signal else changes from row to row."""
    if counted.repeats[k] > 0.2 * counted.counted:
        return
    for value, stay in ((counted.low[k], counted.at_low[k]), (counted.high[k], counted.at_high[k])):
        if stay >= STAY:
            yield _note(f"stays at its extreme {value:.6g} {unit} for {stay} rows: a limit, or a full converter", place)


def _motion(log: Log, run: LogRun, census: Census) -> Found:
    motion = [census.signals[name] for name in ("q", "qd") if name in census.signals]
    found = _note if {"voltage", "current"} <= set(log.layout.names) else _error  # of locked rotors, they tell R and L
    if not motion:
        yield found("neither positions nor speeds are logged", "signals", "one of them")
    elif not any((each.low < each.high).any() for each in motion):
        yield found("nothing moves: positions and speeds are constant", "signals", "a run with motion")
    if not any(name in log.layout for name in ("tau", "tau_link", "current", "voltage")):
        yield _note("no torque, current or voltage is logged: nothing can be said about forces", "signals")
    longest = max((stretch.rows for stretch in census.stretches), default=0)
    if longest <= FEWEST:
        yield _error(f"the longest stretch without a gap has {longest} rows", "rows", f"more than {FEWEST}")


def _limits(log: Log, run: LogRun, census: Census) -> Found:
    """Positions against the arm's limits, or against what a joint can turn."""
    if "q" not in log.layout:
        return
    signal = log.layout["q"]
    bodies = {} if log.arm is None else {body.joint: body for body in log.arm.coordinates}
    for k, joint in enumerate(signal.joints or ()):
        name, unit = log.joints[joint], signal.units[k]
        low, high = census.signals["q"].low[k], census.signals["q"].high[k]
        if not low <= high:
            continue
        bounds = bodies[name].limits.position if name in bodies else (-np.inf, np.inf)
        if low < bounds[0] - BEYOND or high > bounds[1] + BEYOND:
            guess = _likely(log, joint, unit, low, high, bounds)
            span = f"from {low:.4g} to {high:.4g} {unit}"
            what = f"{span}, beyond the joint's limits [{bounds[0]:.4g}, {bounds[1]:.4g}]{guess}"
            yield (_error if guess else _note)(what, f"q {name}")
        # a log of one joint may be of a motor on a bench, which turns as long as it likes
        elif len(log.joints) > 1 and not np.isfinite(bounds).all() and unit == "rad" and high - low > TURNS:
            turns = (high - low) / (2 * pi)
            yield _note(
                f"turns by {turns:.4g} turns: degrees, counts or the motor's side taken for the joint's?", f"q {name}"
            )


def _likely(log: Log, joint: int, unit: str, low: float, high: float, bounds: tuple[float, float]) -> str:
    """The mistake that brings positions beyond their limits, if there is one that explains them."""
    ways = (
        {"degrees taken for radians": pi / 180, "a wrong sign": -1.0}
        if unit == "rad"
        else {"a wrong sign": -1.0, "mm taken for m": 1e-3}
    )
    if log.gears is not None and abs(log.gears[joint, joint]) > 1.5:
        ways["the motor's side taken for the joint's"] = 1 / log.gears[joint, joint]
    span = high - low
    for name, factor in ways.items():
        ends = sorted((low * factor, high * factor))
        if bounds[0] <= ends[0] and ends[1] <= bounds[1] and (span > bounds[1] - bounds[0] or factor == -1.0):
            return f"; {name}?"
    return ""


def _smoothed(log: Log, run: LogRun, census: Census) -> dict[str, np.ndarray]:
    """The excerpt's longest part without gaps, all signals through one zero-phase low-pass; {} where it is too short."""
    begin = census.excerpt_begin
    end = begin + len(census.excerpt.t)
    parts = [(max(s.begin, begin) - begin, min(s.end, end) - begin) for s in census.stretches]
    low, high = max(parts, key=lambda part: part[1] - part[0], default=(0, 0))
    if high - low < 128 or census.excerpt.t[high - 1] <= census.excerpt.t[low]:
        return {}
    try:
        preparation = choose_preparation(log, run.name)
    except LogError:
        return {}
    t = census.excerpt.t[low:high]
    even = t[0] + (t[-1] - t[0]) * np.arange(len(t)) / (len(t) - 1)
    result = {"t": even}
    for name, values in census.excerpt.values.items():
        columns = np.stack([np.interp(even, t, column[low:high]) for column in values.T], axis=1)
        result[name] = sp.sosfiltfilt(preparation.sections, columns, axis=0, padlen=min(len(columns) - 1, 300))
    edge = min(preparation.edge, (high - low) // 8)
    return {name: each[edge : len(each) - edge] for name, each in result.items()}


def _speeds(log: Log, run: LogRun, census: Census) -> Found:
    """Speeds against the derivative of positions: unit, side, sign, order of joints and delay."""
    if "q" not in log.layout or "qd" not in log.layout:
        return
    smooth = _smoothed(log, run, census)
    if not smooth:
        return
    q, qd = log.layout["q"].joints or (), log.layout["qd"].joints or ()
    period = _period(smooth)
    rates = {j: np.gradient(smooth["q"][:, k], period) for k, j in enumerate(q)}
    for k, joint in enumerate(qd):
        if joint not in rates or np.ptp(rates[joint]) == 0:
            continue
        speed, place = smooth["qd"][:, k], f"qd {log.joints[joint]}"
        found = delay_between(rates[joint], speed)
        if found is None:
            continue
        if found.correlation < OFF:
            yield from _mixed_up(log, place, speed, rates, found)
            continue
        yield from _wrong_gain(log, joint, place, found)
        # the derivative is central, so a difference of two counts, which drives report, is half a sample late
        if found.correlation > CERTAIN and abs(found.samples) > max(DELAYED, 4 * found.std):
            late = "behind" if found.samples > 0 else "ahead of"
            what = (
                f"{abs(found.samples):.2f} ± {found.std:.2g} samples ({1e3 * abs(found.samples) * period:.3g} ms) {late} the "
                "derivative of the position"
            )
            yield _note(what, place)


def _mixed_up(log: Log, place: str, speed: np.ndarray, rates: dict[int, np.ndarray], found: Delay) -> Found:
    """A speed that does not follow its position: perhaps it follows another one."""
    others = {}
    for joint, rate in rates.items():
        other = delay_between(rate, speed)
        if other is not None and other.correlation > 0.98:
            others[joint] = other.correlation
    if others:
        joint = max(others, key=lambda each: others[each])
        what = f"does not follow this joint's position (correlation {found.correlation:.2f}) but that of {log.joints[joint]!r}"
        yield _error(f"{what} ({others[joint]:.3f}): columns mixed up?", place)
    elif found.correlation < 0.5:
        what = f"correlation with the derivative of the position {found.correlation:.2f}: noise, another joint's, or at rest"
        yield _note(what, place)


def _wrong_gain(log: Log, joint: int, place: str, found: Delay) -> Found:
    """A speed that is a multiple of the derivative of its position."""
    gain, problem = found.gain, f"{found.gain:.4g} times the derivative of the position"
    if gain < 0 and abs(-gain - 1) < CLOSE:
        yield _error(f"{problem}: one of the two has the wrong sign", place, expected="signs that agree")
        return
    factors = dict(FACTORS)
    if log.gears is not None and abs(log.gears[joint, joint]) > 1.2:
        ratio = float(log.gears[joint, joint])
        factors[abs(ratio)] = f"the speed is the motor's, the position the joint's (gear {ratio:g})"
        factors[1 / abs(ratio)] = f"the position is the motor's, the speed the joint's (gear {ratio:g})"
    if abs(gain - 1) <= SAME:
        return
    for factor, mistake in factors.items():
        if abs(abs(gain) / factor - 1) < CLOSE / 2:
            sign = ", and one of the two has the wrong sign" if gain < 0 else ""
            yield _error(f"{problem}: {mistake}{sign}", place, expected="units and sides that agree")
            return
    what = f"{problem} (correlation {found.correlation:.3f}): a wrong unit, gear ratio, number of counts or rate"
    yield _note(what, place, "1")


def _power(log: Log, run: LogRun, census: Census) -> Found:
    """Work of the torques over the run, and voltages or currents that push against the motion."""
    smooth = _smoothed(log, run, census)
    speeds = _joint_speeds(log, smooth)
    if not speeds:
        return
    if "tau" in smooth:
        yield from _work(log, smooth, speeds)
    for name in ("voltage", "current"):
        for k, j in enumerate(log.layout[name].joints or () if name in smooth else ()):
            if j not in speeds:
                continue
            direction = 1.0 if log.gears is None else float(np.sign(log.gears[j, j]))
            power = smooth[name][:, k] * direction * speeds[j]
            share = float(power.sum() / max(np.abs(power).sum(), 1e-300))
            if share < -AGAINST:
                what = f"pushes against the motion in {(power < 0).mean():.0%} of the rows"
                certain = name == "voltage" and share < -CERTAINLY
                sign = f"another sign of {name}, position or gear"
                yield (_error if certain else _note)(what, f"{name} {log.joints[j]}", sign)


def _joint_speeds(log: Log, smooth: dict[str, np.ndarray]) -> dict[int, np.ndarray]:
    """Speeds by joint, from positions where they are logged."""
    if "q" in smooth:
        period = _period(smooth)
        return {j: np.gradient(smooth["q"][:, k], period) for k, j in enumerate(log.layout["q"].joints or ())}
    if "qd" in smooth:
        return {j: smooth["qd"][:, k] for k, j in enumerate(log.layout["qd"].joints or ())}
    return {}


def _period(smooth: dict[str, np.ndarray]) -> float:
    """Mean time from row to row [s]."""
    return float((smooth["t"][-1] - smooth["t"][0]) / (len(smooth["t"]) - 1))


def _work(log: Log, smooth: dict[str, np.ndarray], speeds: dict[int, np.ndarray]) -> Found:
    """The work that all motors do; over a motion that ends where it began it is what friction takes, and not negative."""
    end, returned = len(smooth["t"]), False
    if "q" in smooth:
        distance = (np.abs(smooth["q"] - smooth["q"][0]) / np.maximum(np.ptp(smooth["q"], axis=0), 1e-12)).max(axis=1)
        back = end // 2 + int(np.argmin(distance[end // 2 :]))
        if distance[back] <= RETURNED:
            end, returned = back + 1, True
    joints = [(k, j) for k, j in enumerate(log.layout["tau"].joints or ()) if j in speeds]
    powers = [(smooth["tau"][:, k] * speeds[j])[:end] for k, j in joints]
    work = sum(float(power.sum()) for power in powers) * _period(smooth)
    flow = sum(float(np.abs(power).sum()) for power in powers) * _period(smooth)
    if not flow or work > -LOSS * flow:
        return
    what = f"all motors together do {work:.4g} J of work in {smooth['t'][end - 1] - smooth['t'][0]:.3g} s"
    if returned:
        what = f"{what}, after which the arm is back where it was: friction would give energy"
        yield _error(what, "tau", "another sign of torque or position")
    else:
        yield _note(f"{what}: the arm is lowered, or the sign of torques or positions is wrong", "tau")


def _torque_delays(log: Log, run: LogRun, census: Census) -> Found:
    """Torques and currents against the motion, by a model of each joint alone: inertia, friction, gravity, offset."""
    smooth = _smoothed(log, run, census)
    if not smooth or "q" not in smooth:
        return
    period, sections = _period(smooth), choose_preparation(log, run.name).sections
    for name in ("tau", "current"):
        for k, j in enumerate(() if name not in smooth else log.layout[name].joints or ()):
            if j not in (log.layout["q"].joints or ()):
                continue
            q = smooth["q"][:, (log.layout["q"].joints or ()).index(j)]
            found = motion_delay(q, smooth[name][:, k], period, sections)
            if found is None or abs(found.samples) < max(0.5, 3 * found.std):
                continue
            late = "behind" if found.samples > 0 else "ahead of"
            what = (
                f"about {abs(found.samples):.1f} ± {found.std:.1g} samples ({1e3 * abs(found.samples) * period:.3g} ms) "
                f"{late} the motion, by a model of this joint alone"
            )
            yield _note(what, f"{name} {log.joints[j]}")


def motion_delay(q: np.ndarray, effort: np.ndarray, period: float, sections: np.ndarray) -> Delay | None:
    """Delay of a torque or current behind the motion, with which a model of the joint alone explains it best.

    effort(k) ≈ a q̈ + b q̇ + c q̇/√(q̇² + v²) + d sin q + e cos q + f, all at k − d, least squares for each of 13 delays and a
    parabola through the smallest residuals. The right side passes the filter that the effort has passed: friction has jumps.

    Args:
        q: (k,) [rad].   effort: (k,), filtered.   period: [s].   sections: the effort's zero-phase filter.
    Returns:
        delay: None where the model explains too little, or no delay is clearly better than none.
    """
    qd = np.gradient(q, period)
    soft = SOFT * np.abs(qd).max()
    most, edge = 6, settling(sections, 1e-2)
    if soft < SLOWEST or len(q) < 2 * edge + 30 * most:
        return None
    lags = np.arange(-most, most + 1)
    model = [np.gradient(qd, period), qd, qd / np.sqrt(qd**2 + soft**2), np.sin(q), np.cos(q), np.ones_like(q)]
    matrix = np.asarray(sp.sosfiltfilt(sections, np.stack(model, axis=1), axis=0, padlen=min(len(q) - 1, edge)))
    matrix /= np.maximum(np.abs(matrix).max(axis=0), 1e-300)
    inside = np.arange(edge + most, len(q) - edge - most)
    target = effort[inside]
    size = float(np.abs(target).max())
    if np.ptp(target) <= LEVEL * size or size < SLOWEST:
        return None
    target = target / size
    rest = []
    for lag in lags:
        rows = matrix[inside - lag]
        solution, *_ = np.linalg.lstsq(rows, target, rcond=None)
        rest.append(float(((target - rows @ solution) ** 2).mean()))
    residual = np.array(rest)
    k = int(np.argmin(residual))
    explained = 1 - residual[k] / target.var()
    if k in (0, len(lags) - 1) or explained < EXPLAINED or residual[k] > BETTER * residual[most]:
        return None
    left, middle, right = residual[k - 1 : k + 2]
    curvature = left - 2 * middle + right
    samples = lags[k] + 0.5 * (left - right) / curvature
    # independent rows are far fewer than rows: motion is smooth
    std = float(np.sqrt(2 * middle / curvature / max(len(target) / 50, 1)))
    return Delay(float(samples), std, 1.0, float(explained))

"""Checks of units, sides and signs of a log: positions against limits, speeds against the derivative of positions."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi

import numpy as np

from armwright.identification.logs.census import Census
from armwright.identification.logs.delay import SignalDelay, delay_between
from armwright.identification.logs.findings import Found, error, note, warning
from armwright.identification.logs.log import Log, LogRun
from armwright.identification.logs.smoothed import Smoothed
from armwright.identification.logs.units import ZERO

SAME, CLOSE = 0.03, 0.10  # gain of speed to derivative: equal, nearly
OFF, CERTAIN = 0.9, 0.99  # correlation above which a gain says something, and a delay
DELAYED = 0.1  # of a sample
TURNS = 8 * pi  # [rad]: few joints turn further
COLDEST, HOTTEST = -60.0, 220.0  # [°C] of motors: insulation of class H stands 180 °C
LARGEST = {"current": 1e3, "voltage": 1.5e3, "tau": 1e5, "tau_link": 1e5}  # [A], [V] of low voltage, [N m]: of no arm
SLOWEST = 1.0  # [s] between rows: from here on an arm or a motor is not seen to move
# times what its limits allow a joint moves where its unit is wrong; less may be limits that are not the arm's
SURELY = 2.0
BEYOND = 0.02  # [rad | m] beyond its limits a joint may be, by overshoot and calibration
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


def limits(log: Log, run: LogRun, census: Census) -> Found:
    """Findings about positions beyond the arm's limits, or beyond what a joint can turn."""
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
            yield (error if guess else warning)(what, f"q {name}")
        # a log of one joint may be of a motor on a bench, which turns as long as it likes
        elif len(log.joints) > 1 and not np.isfinite(bounds).all() and unit == "rad" and high - low > TURNS:
            turns = (high - low) / (2 * pi)
            yield warning(
                f"turns by {turns:.4g} turns: degrees, counts or the motor's side taken for the joint's?", f"q {name}"
            )


def temperatures(log: Log, run: LogRun, census: Census) -> Found:
    """Findings about implausible motor temperatures."""
    for k, joint in enumerate(log.layout["temperature"].joints or () if "temperature" in log.layout else ()):
        low, high = census.signals["temperature"].low[k], census.signals["temperature"].high[k]
        if low <= high and (low < COLDEST or high > HOTTEST):
            kelvin = low - ZERO["K"] > 0 and low + ZERO["K"] >= COLDEST and high + ZERO["K"] <= HOTTEST
            what = f"from {low:.4g} to {high:.4g} °C{': kelvin taken for °C?' if kelvin else ''}"
            expected = f"{COLDEST:g} … {HOTTEST:g} °C"
            yield (error if kelvin else warning)(what, f"temperature {log.joints[joint]}", expected)


def sizes(log: Log, run: LogRun, census: Census) -> Found:
    """Findings about implausible currents, voltages and torques, and about rows too far apart to show a motion."""
    for quantity, most in LARGEST.items():
        if quantity not in log.layout:
            continue
        signal, extremes = log.layout[quantity], census.signals[quantity]
        for k, joint in enumerate(signal.joints or ()):
            size, unit = max(abs(float(extremes.low[k])), abs(float(extremes.high[k]))), signal.units[k]
            if size > most and unit != "N":
                what = f"up to {size:.4g} {unit}, more than the drive of an arm has: is the unit right?"
                yield warning(what, f"{quantity} {log.joints[joint]}", f"at most {most:g} {unit}")
    if census.period > 0.999 * SLOWEST and run.rows > 1:  # 1 kHz in milliseconds is a row every second
        yield warning(
            f"a row every {census.period:.4g} s: is the unit of the time right?", "time", f"below {SLOWEST:g} s"
        )


def _likely(log: Log, joint: int, unit: str, low: float, high: float, bounds: tuple[float, float]) -> str:
    """The likely mistake behind positions beyond their limits, if one explains them."""
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
        beyond = span > (bounds[1] - bounds[0]) * (SURELY if factor > 0 and 1 / factor > SURELY else 1.0)
        if bounds[0] <= ends[0] and ends[1] <= bounds[1] and (beyond or factor == -1.0):
            return f"; {name}?"
    return ""


def speeds(log: Log, smooth: Smoothed) -> Found:
    """Findings about speeds that contradict the derivative of positions: unit, side, sign, order of joints, delay."""
    rates = smooth.rates
    for joint, speed in smooth.columns("qd"):
        if joint not in rates or np.ptp(rates[joint]) == 0:
            continue
        place, found = f"qd {log.joints[joint]}", delay_between(rates[joint], speed)
        if found is None:
            continue
        if found.correlation < OFF:
            yield from _mixed_up(log, place, speed, rates, found)
            continue
        yield from _wrong_gain(log, joint, place, found)
        # the derivative is central, so a difference of two counts, which drives report, is half a sample late
        if found.correlation > CERTAIN and abs(found.samples) > max(DELAYED, 4 * found.std):
            late, ms = "behind" if found.samples > 0 else "ahead of", 1e3 * abs(found.samples) * smooth.period
            samples = f"{abs(found.samples):.2f} ± {found.std:.2g} samples ({ms:.3g} ms)"
            yield note(f"{samples} {late} the derivative of the position", place)


def _mixed_up(log: Log, place: str, speed: np.ndarray, rates: Mapping[int, np.ndarray], found: SignalDelay) -> Found:
    """A speed that does not follow its position: perhaps it follows another one."""
    others = {}
    for joint, rate in rates.items():
        other = delay_between(rate, speed)
        if other is not None and other.correlation > 0.98:
            others[joint] = other.correlation
    if others:
        joint = max(others, key=lambda each: others[each])
        what = f"does not follow this joint's position (correlation {found.correlation:.2f}) but that of {log.joints[joint]!r}"
        yield error(f"{what} ({others[joint]:.3f}): columns mixed up?", place)
    elif found.correlation < 0.5:
        what = f"correlation with the derivative of the position {found.correlation:.2f}: noise, another joint's, or at rest"
        yield warning(what, place)


def _wrong_gain(log: Log, joint: int, place: str, found: SignalDelay) -> Found:
    """A speed that is a multiple of the derivative of its position."""
    gain, problem = found.gain, f"{found.gain:.4g} times the derivative of the position"
    if gain < 0 and abs(-gain - 1) < CLOSE:
        yield error(f"{problem}: one of the two has the wrong sign", place, expected="signs that agree")
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
            yield error(f"{problem}: {mistake}{sign}", place, expected="units and sides that agree")
            return
    what = f"{problem} (correlation {found.correlation:.3f}): a wrong unit, gear ratio, number of counts or rate"
    yield warning(what, place, "1")

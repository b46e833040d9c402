"""Friction models M1 to M6 of servos as restrictions of one law, and the numbers that a fit of each searches for.

Of M6, with F = Fs - Fc the torque that falls over speed:  M5 has no squares, M4 equal loads of motor and external torque, M3 no
fall over speed either, M2 no loads, M1 neither. So every order is M6 with numbers that are 0 or equal. [DuclusaudEtAl2025]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armwright.identification.motor.unknowns import Unknown
from armwright.identification.servo.bench import GRAVITY, PATHS, ServoLoop
from armwright.identification.servo.bench_log import BenchLog

SLIDING = ("viscous", "coulomb")
FALLING = (*SLIDING, "fall", "stribeck_speed", "exponent")
LOADED = (*FALLING, "load_motor", "load_external", "load_motor_still", "load_external_still")
ORDERS = {
    "M1": SLIDING,
    "M2": FALLING,
    "M3": (*SLIDING, "load"),
    "M4": (*FALLING, "load", "load_still"),
    "M5": LOADED,
    "M6": (*LOADED, "square_motor", "square_external"),
}
# whose fits it starts from
BEFORE = {"M1": (), "M2": ("M1",), "M3": ("M1",), "M4": ("M2", "M3"), "M5": ("M4",), "M6": ("M5",)}
# Names that stand for several numbers of the record, by which they are the sum.
PARTS = {
    "coulomb": ("coulomb", "coulomb_back", "still"),
    "fall": ("still",),
    "load": ("load_motor", "load_external"),
    "load_still": ("load_motor_still", "load_external_still"),
}
# What a friction of none is; a Stribeck speed and an exponent must be above 0 even where nothing falls.
NEUTRAL = {"stribeck_speed": 1.0, "exponent": 1.0}
OFFSET, DELAY = "q_offset_rad", "delay_s"  # numbers that no record has
MOST_OFFSET = 0.3  # [rad]
DELAYS = (-0.02, 0.05)  # [s]: below 0 where a log has the time of the position, read after its goal was sent
MOST_LOAD = 0.98  # friction that takes all of the load locks
MOST_SQUARE = 0.5  # of a load as large as the bench's: share of it that the squares take
LEAST_COULOMB = 1e-6  # of the bench's load: the law needs a torque above 0
RANGES = {"kt": 30.0, "R": 30.0, "J": 1e3}  # either way from the bench's scale
RANGES_OF_SPEED, RANGES_OF_EXPONENT = (0.02, 20.0), (0.3, 10.0)


@dataclass(frozen=True)
class Scales:
    """Sizes of the bench's quantities.

    Attributes:
        torque: largest of gravity [N m].   inertia: of the pendulum, median [kg m²].   supply: median voltage [V].
        speed: no-load speed guessed: the largest in the logs [rad/s].
    """

    torque: float
    inertia: float
    supply: float
    speed: float

    @classmethod
    def of(cls, logs: Sequence[BenchLog]) -> Scales:
        """Of logs with a known mass of the rod."""
        torque = max((each.mass + (each.arm_mass or 0.0) / 2) * GRAVITY * each.length for each in logs)
        inertia = float(np.median([(each.mass + (each.arm_mass or 0.0) / 3) * each.length**2 for each in logs]))
        steps = [_largest_speed(each) for each in logs]
        return cls(torque, inertia, float(np.median([np.median(each.supply) for each in logs])), max(steps))


def _largest_speed(log: BenchLog) -> float:
    """Of the position over 50 ms, which the encoder's counts hardly change [rad/s]."""
    later = np.minimum(np.searchsorted(log.t, log.t + 0.05), len(log.t) - 1)
    span = log.t[later] - log.t
    moved = np.abs(log.position[later] - log.position)
    return float(np.max(np.where(span > 0.02, moved / np.maximum(span, 1e-9), 0.0), initial=1e-3))


@dataclass(frozen=True, eq=False)
class Order:
    """A friction model as unknowns of a fit.

    Attributes:
        name: "M1" … "M6".   unknowns: what is searched for.
        matrix: (numbers, unknowns) 0 or 1: the record's numbers, in the order of `columns`, are sums of unknowns' values.
        fixed: (numbers,) their values beside that.   columns: names of `PATHS`, `OFFSET` and `DELAY`.
    """

    name: str
    unknowns: tuple[Unknown, ...]
    matrix: np.ndarray
    fixed: np.ndarray
    columns: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(each.name for each in self.unknowns)

    @property
    def low(self) -> np.ndarray:
        """(k,) lowest coordinates."""
        return np.array([each.bounds[0] for each in self.unknowns])

    @property
    def high(self) -> np.ndarray:
        """(k,) highest coordinates."""
        return np.array([each.bounds[1] for each in self.unknowns])


def order_of(name: str, loop: ServoLoop, scales: Scales, extra: Sequence[str] = ()) -> Order:
    """The unknowns of a friction model on a bench.

    Args:
        name: "M1" … "M6".   loop: of the servo.   scales: of the bench.
        extra: further unknowns: "gain", "goal_speed", "offset", "delay".
    """
    needless = {"R": loop.output == "current", "goal_speed": loop.goal_speed_rad_per_s is None}
    searched = [each for each in ("kt", "R", "J") if not needless.get(each)]
    searched += [*ORDERS[name], *({"offset": OFFSET, "delay": DELAY}.get(each, each) for each in extra)]
    columns = [*(each for each in PATHS if not needless.get(each)), OFFSET, DELAY]
    unknowns = tuple(_unknown(each, loop, scales) for each in searched)
    matrix, fixed = np.zeros((len(columns), len(unknowns))), np.zeros(len(columns))
    for k, each in enumerate(searched):
        for part in PARTS.get(each, (each,)):
            matrix[columns.index(part), k] = 1.0
    known = {**NEUTRAL, "gain": loop.p_scale_per_rad, "goal_speed": loop.goal_speed_rad_per_s}
    for row, column in enumerate(columns):
        if not matrix[row].any():
            fixed[row] = known.get(column, 0.0)
    return Order(name, unknowns, matrix, fixed, tuple(columns))


def _unknown(name: str, loop: ServoLoop, scales: Scales) -> Unknown:
    """Guess, range and scale of an unknown by the bench's sizes."""
    torque, speed, slow = scales.torque, scales.speed, min(scales.speed, 5.0)
    kt = scales.supply / (2.0 * speed) if loop.output == "duty" else 2.0 * torque / loop.output_limit
    positive = {"kt": kt, "R": kt * scales.supply / (2.0 * torque), "J": 0.3 * scales.inertia}
    if name in positive:
        value = positive[name]
        return Unknown(name, value, value / RANGES[name], value * RANGES[name], value, logarithmic=True, label=name)
    if name == "stribeck_speed":
        low, high = (times * slow for times in RANGES_OF_SPEED)
        return Unknown(name, 0.3 * slow, low, high, 0.3 * slow, logarithmic=True, label=name)
    if name == "exponent":
        return Unknown(name, 1.5, *RANGES_OF_EXPONENT, 1.5, logarithmic=True, label=name)
    if name in ("gain", "goal_speed"):
        value = loop.p_scale_per_rad if name == "gain" else loop.goal_speed_rad_per_s or 1.0
        return Unknown(name, value, value / 10.0, value * 10.0, value, logarithmic=True, label=name)
    if name == OFFSET:
        return Unknown(name, 0.0, -MOST_OFFSET, MOST_OFFSET, 0.1, unit="rad", nuisance=True, label=name)
    if name == DELAY:
        return Unknown(name, 0.0, *DELAYS, 5e-3, unit="s", nuisance=True, label=name)
    if name.startswith("load"):
        return Unknown(name, 0.0, 0.0, MOST_LOAD, 0.1, label=name)
    if name.startswith("square"):
        return Unknown(name, 0.0, 0.0, MOST_SQUARE / torque, 0.1 / torque, label=name)
    size = 0.1 * torque / (speed if name == "viscous" else 1.0)
    least = LEAST_COULOMB * torque if name == "coulomb" else 0.0
    return Unknown(name, 0.3 * size, least, 1e2 * size, size, label=name)

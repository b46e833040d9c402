"""Measurements of drives for a fit: stretches of a log's runs, with inputs and compared signals."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from armwright.entry import expect_names
from armwright.errors import LogError, check_known
from armwright.fitting.stretch import LogStretch
from armwright.identification.logs.log import Log
from armwright.identification.logs.quantisation import quantisation_step
from armwright.identification.logs.torques import COMMANDS, LoggedCommand
from armwright.identification.motor.response import DriveInputs

LOGGED = {"qd_mean": "qd"}  # signal of the log with which one of `Response` is compared, where it has another name
SHORTEST = 20  # rows of a stretch that is fitted
SAME = 0.02  # of a speed's standard deviation: how far it may be from the difference of positions to be that


@dataclass(frozen=True, eq=False)
class Driven(LogStretch):
    """A stretch of motors that are driven.

    Attributes:
        run: its name.   t: (rows,) [s].   inputs: what drives it.   values: signal → (rows, n) measured.
        weights: (rows, signals · n) 1 where a value is compared, else 0; 1/√m in m rows that hold the same count.
    """

    t: np.ndarray
    inputs: DriveInputs
    values: dict[str, np.ndarray]
    weights: np.ndarray

    @property
    def speeds(self) -> np.ndarray:
        """(rows, n) measured speeds; without them (rows - 1, n) differences of positions, 0 of a locked rotor."""
        for name in ("qd", "qd_mean"):
            if name in self.values:
                return self.values[name]
        if "q" not in self.values:
            return np.zeros_like(self.inputs.command)
        return np.diff(self.values["q"], axis=0) / self.inputs.period[:-1, None]

    def speed(self, joint: int) -> np.ndarray:
        """(rows,) speed of a joint: measured, or differences of its positions, the first 0."""
        speed = self.speeds[:, joint]
        return np.concatenate([np.zeros(len(self.t) - len(speed)), speed])


def largest_command(stretches: Sequence[Driven]) -> float:
    """Largest command of any joint."""
    return float(max(np.abs(each.inputs.command).max() for each in stretches))


def largest_speed(stretches: Sequence[Driven]) -> float:
    """Largest speed of any joint."""
    return float(max(np.abs(each.speeds).max() for each in stretches))


SPEEDS = ("auto", "difference", "instant")


@dataclass(frozen=True)
class MotorReading:
    """Part of a log of motors that is compared.

    Args:
        runs: names; None: those to fit.   signals: "q", "qd", "current", "tau"; None: all that are logged.
        speed: "difference" of the positions over a sample, "instant", or "auto": a difference where it is quantised.
        static: a log of steady states, a row each, as additional data.
    Example:
        >>> reading = aw.identification.MotorReading(signals=["q", "current"])
        >>> reading.speed
        'auto'
    """

    runs: Sequence[str] | None = None
    signals: Sequence[str] | None = None
    speed: Literal["auto", "difference", "instant"] = "auto"
    static: Log | str | os.PathLike[str] | None = None

    def __post_init__(self) -> None:
        expect_names(self.runs, "runs", LogError)
        expect_names(self.signals, "signals", LogError)
        check_known(LogError, self.speed, SPEEDS, place="speed")


@dataclass(frozen=True, eq=False)
class Measured:
    """Data of a fit.

    Attributes:
        joints: names.   command: what drives the motors.   signals: names that `Response` knows, in its order.
        steps: signal → (n,) quantisation step, 0 without.   stretches: of the runs.   remarks: what was found and left out.
    """

    joints: tuple[str, ...]
    command: LoggedCommand
    signals: tuple[str, ...]
    steps: dict[str, np.ndarray]
    stretches: tuple[Driven, ...]
    remarks: tuple[str, ...]

    @property
    def period(self) -> float:
        """Usual time from row to row [s]."""
        return float(np.median(np.concatenate([each.inputs.period for each in self.stretches])))


def measured(
    log: Log, runs: Sequence[str], joints: Sequence[str], reading: MotorReading, *, locked: bool = False
) -> Measured:
    """Stretches of some runs.

    Args:
        log: of the drives.   runs: names.   joints: names, in the order of the arm.   reading: signals, and the kind of speed.
        locked: the rotors were held, and nothing but currents is compared.
    Raises:
        LogError: no voltage, current or torque, nothing that moves, or no stretch that is long enough.
    """
    places = [log.joints.index(name) for name in joints]
    datasets = {run: log.dataset(run) for run in runs}
    columns: dict[str, np.ndarray] = {
        str(name): np.concatenate([data[name].values[:, places] for data in datasets.values()])
        for name in next(iter(datasets.values())).data_vars
        if all(np.isfinite(data[name].values[:, places]).any(axis=0).all() for data in datasets.values())
    }
    driver, moving, names = _logged(log, list(columns), locked)
    for name in (driver, *(["current"] if locked else moving)):
        if not np.ptp(np.nan_to_num(columns[name]), axis=0).any():
            expected = "a motor that is driven and moves"
            raise LogError("never changes", place=f"signal {name}", expected=expected, file=log.path)
    steps = {name: _steps(columns[name]) for name in names}
    remarks = []
    if moving == ["q", "qd"] and all(_is_difference(data, places) for data in datasets.values()):
        names.remove("qd")
        remarks.append("the speed is the difference of the positions, and adds no information: positions are compared")
    difference = reading.speed == "difference" or (
        reading.speed == "auto" and "qd" in names and bool(steps["qd"].all())
    )
    if reading.signals is not None:
        for name in reading.signals:
            if name not in names:
                what = "not logged, or the input itself"
                raise LogError(what, place="signals", value=name, choices=names, file=log.path)
        names = [name for name in names if name in reading.signals]
    if difference and "qd" in names:
        remarks.append("the speed is quantised: it is predicted as the difference of positions over the sample")
        names[names.index("qd")] = "qd_mean"
    steps = {name: steps[LOGGED.get(name, name)] for name in names}
    stretches = [
        stretch for run, data in datasets.items() for stretch in _stretches(log, run, data, driver, names, places)
    ]
    if not stretches:
        raise LogError(f"no stretch of {SHORTEST} rows without gap", file=log.path, expected="a longer log")
    return Measured(tuple(joints), COMMANDS[driver], tuple(names), steps, tuple(stretches), tuple(remarks))


def _logged(log: Log, given: Sequence[str], locked: bool) -> tuple[str, list[str], list[str]]:
    """Signal that drives the motors, those that tell how they move, and all that may be compared, of those that are given.

    Raises:
        LogError: nothing drives, or nothing is left to compare.
    """
    driver = next((name for name in COMMANDS if name in given), None)
    if driver is None:
        expected = "a voltage, a current or a torque of every joint that is fitted"
        raise LogError("no signal drives the motors", place="signals", expected=expected, file=log.path)
    sensed = [name for name in ("current", "tau") if name in given and driver == "voltage"]
    if locked:
        if "current" not in sensed:
            expected = "voltage and current: nothing else changes while the rotor is held"
            raise LogError("a locked rotor", place="signals", expected=expected, file=log.path)
        return driver, [], ["current"]
    moving = [name for name in ("q", "qd") if name in given]
    if not moving:
        raise LogError("no motion is logged", place="signals", expected="position or speed", file=log.path)
    return driver, moving, [*moving, *sensed]


def _steps(values: np.ndarray) -> np.ndarray:
    """(n,) quantisation steps of columns (rows, n); 0 without."""
    return np.array([quantisation_step(column[np.isfinite(column)]) or 0.0 for column in values.T])


def _is_difference(data, places: Sequence[int]) -> bool:
    """True if the speeds are differences of the positions."""
    period = np.diff(data.time.values)[:, None]
    speed, own = np.diff(data.q.values[:, places], axis=0) / period, data.qd.values[1:, places]
    return bool((np.nanstd(speed - own, axis=0) <= SAME * np.nanstd(own, axis=0)).all())


def _stretches(
    log: Log, run: str, data: Any, driver: str, names: Sequence[str], places: Sequence[int]
) -> Iterator[Driven]:
    """Parts of a run without gap, with weights of what is compared."""
    for part in log.run(run).stretches:
        rows = slice(part.begin, part.end)
        t = data.time.values[rows]
        if len(t) < SHORTEST:
            continue
        command = data[driver].values[rows][:, places]
        values = {name: data[LOGGED.get(name, name)].values[rows][:, places] for name in names}
        finite = np.isfinite(np.concatenate([*values.values(), command], axis=1)).all(axis=1)
        values = {name: np.nan_to_num(each) for name, each in values.items()}
        weights = {name: np.repeat(finite.astype(float)[:, None], len(places), axis=1) for name in names}
        if "qd_mean" in names:
            weights["qd_mean"][0] = 0.0  # its position before is not known
        if "q" in names:
            weights["q"] /= np.sqrt(np.column_stack([rows_of_count(q) for q in values["q"].T]))
        inputs = DriveInputs(np.append(np.diff(t), t[-1] - t[-2]), np.nan_to_num(command))
        yield Driven(run, t, inputs, values, np.concatenate(list(weights.values()), axis=1))


def rows_of_count(counts: np.ndarray) -> np.ndarray:
    """(rows,) number of successive rows with the same encoder count: they share one rounding error and count as one row."""
    group = np.cumsum(np.diff(counts, prepend=counts[:1]) != 0.0)
    return np.bincount(group)[group]


LEVEL_TICKS = 100  # of a level that is held until the motor is steady: it may be 30 times as fast as elsewhere
LEVEL_TIME = 8.0  # time constants that it is held


def steady(log: Log, joints: Sequence[str], data: Measured, time: float) -> Driven:
    """A log of steady states as a stretch: every row's command is applied until the motor is steady, and then compared.

    Args:
        log: a row for each steady state, in any time.   joints: names.   data: the other runs.   time: constant of the motor [s].
    Raises:
        LogError: it lacks what drives, or the speed.
    """
    places = [log.joints.index(name) for name in joints]
    rows = log.dataset()
    driver = next(name for name, command in COMMANDS.items() if command == data.command)
    for name in (driver, "qd"):
        if name not in rows:
            raise LogError("is not logged", place=f"signal {name}", expected="the input and the speed", file=log.path)
    command, speed = rows[driver].values[:, places], rows["qd"].values[:, places]
    finite = np.isfinite(np.concatenate([command, speed], axis=1)).all(axis=1)
    command, speed = command[finite], speed[finite]
    ticks = len(command) * LEVEL_TICKS
    period = np.full(ticks, LEVEL_TIME * time / LEVEL_TICKS)
    values, weights = ({name: np.zeros((ticks, len(places))) for name in data.signals} for _ in range(2))
    compared = {"qd", "qd_mean"} & set(data.signals)
    for name in compared:
        weights[name][LEVEL_TICKS - 1 :: LEVEL_TICKS] = 1.0
        values[name][LEVEL_TICKS - 1 :: LEVEL_TICKS] = speed
    if not compared or not len(speed):
        raise LogError("the other log has no speed to compare", place="static", file=log.path)
    t = np.cumsum(period) - period
    inputs = DriveInputs(period, np.repeat(command, LEVEL_TICKS, axis=0))
    return Driven("static", t, inputs, values, np.concatenate(list(weights.values()), axis=1))

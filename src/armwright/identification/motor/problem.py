"""The least-squares problem of a fit: unknowns with bounds and sizes, their places in each stretch, and signal weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from armwright.description.paths import path_name, quantities, reading_at
from armwright.description.robot import RobotDescription
from armwright.entry import expect_names
from armwright.errors import ModelError
from armwright.identification.motor.drive_record import paths_of, value_at
from armwright.identification.motor.guess import Guess
from armwright.identification.motor.measured import Driven, Measured, largest_command, largest_speed, rows_of_count
from armwright.identification.motor.output_error import DriveProblem, UnknownPlaces
from armwright.identification.motor.response import Response, response_of
from armwright.identification.motor.unknowns import RANGE, Unknown, values_of
from armwright.model.model import Model, build_model
from armwright.model.vary import Varied

# of the motor's time constant: the longest substep, 1e-3 of a count wrong in position at a reversal
SHARE_OF_TIME = 0.05
MOST_SUBSTEPS = 16
LOGARITHMIC = ("R", "L", "Kt", "Ke", "J", "stribeck_speed")  # above 0 by their nature, of unknown order of magnitude
LOGARITHMIC_TABLES = (".elasticity.", ".thermal.winding_", ".thermal.housing_")
SIZE = 0.1  # of the torque of the largest command: friction of that size matters
UNITS = {"voltage": "V", "current": "A", "torque": "N m"}  # of a command


@dataclass(frozen=True)
class MotorSearch:
    """Search for the numbers of motors.

    Args:
        per_run: of what is free, what every run has a value of its own of.
        pwm: of the bridge; None: as the record has it; "compare": both are fitted, and the one is kept whose error is smaller,
            coast only if by 1 % or more.   most_delay: longest delay of the command [samples].
        priors: whether the standard deviations that the robot's record states count as measurements of its numbers.
        starts: number of first guesses, 4 at least.   seed: of their draws.
    Raises:
        ModelError: names the field.
    Example:
        >>> search = aw.identification.MotorSearch(starts=2)
        >>> search.starts
        2
    """

    per_run: Sequence[str] = ()
    pwm: Literal["brake", "coast", "compare"] | None = None
    most_delay: int = 10
    priors: bool = False
    starts: int = 16
    seed: int = 0

    def __post_init__(self) -> None:
        expect_names(self.per_run, "per_run", ModelError)
        for place, least, most in (("starts", 1, 1000), ("most_delay", 0, 1000), ("seed", 0, 2**32 - 1)):
            value = getattr(self, place)
            if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or not least <= value <= most:
                raise ModelError(place=place, value=value, expected=f"a whole number from {least} to {most}")
        if self.pwm not in PWM:
            raise ModelError(place="pwm", value=self.pwm, choices=tuple(filter(None, PWM)))


PWM = (None, "brake", "coast", "compare")


def problem_of(
    record: RobotDescription, data: Measured, stretches: Sequence[Driven], names: Mapping[str, tuple[str, ...]],
    guesses: Sequence[Guess], free: Sequence[str] | None, delay: float | None, search: MotorSearch,
) -> DriveProblem:  # fmt: skip
    """The least-squares problem.

    Args:
        record: with a number at each path.   data: measurements.   stretches: of these, and of steady states.
        names: paths by `joint:name` of what is fitted.   guesses: of the joints.   free: the names that were asked for.
        delay: fixed [s]; None: it is fitted.   search: what is searched for.
    Raises:
        ModelError: a fixed delay that is longer than the longest.
    """
    arm = build_model(record)
    varied = Varied(arm, [path for group in names.values() for path in group])
    lags = 0 if delay == 0.0 else search.most_delay
    fixed_delay = 0.0 if delay is None else delay / data.period
    if fixed_delay > lags + 1:
        expected = f"at most {(lags + 1) * data.period:g} s, or a larger most_delay of the search"
        raise ModelError("longer than the longest delay", place="fixed delay", value=delay, expected=expected)
    time = min(each.time for each in guesses)
    substeps = int(np.clip(np.ceil(data.period / (SHARE_OF_TIME * time)), 1, MOST_SUBSTEPS))
    response = response_of(varied, data.signals, lags, substeps)
    unknowns = _numbers(record, stretches, names, search)
    if delay is None and lags > 0 and (free is None or "delay" in free):
        begin = float(np.median([each.delay for each in guesses])) + 0.5
        delayed = Unknown("delay", begin, 0.0, float(lags + 1), 1.0, nuisance=True, unit="samples", label="delay")
        unknowns += _by_run(delayed, "delay", stretches, search)
    if free is not None and "offset" in free:
        unknowns += _offsets(data, stretches, search)
    at = {(each.name if each.nuisance else each.label, each.run): k for k, each in enumerate(unknowns)}

    def number(name: str, run: str) -> int:
        return at.get((name, run), at.get((name, ""), -1))

    speed, places = largest_speed(stretches), []
    for k, stretch in enumerate(stretches):
        start, fixed_start = starts_of(stretch, k, response, arm, unknowns, speed, data)
        own = [number(label, stretch.run) for label, group in names.items() for _ in group]
        offsets = [number(f"{joint}: offset", stretch.run) for joint in data.joints]
        lag = -1 if stretch.run == "static" else number("delay", stretch.run)
        places.append(UnknownPlaces(np.array(own, dtype=int), np.array(offsets, dtype=int), lag, start, fixed_start))
    prior = _prior(record, unknowns) if search.priors else None
    sigma = _first_sigma(data)
    return DriveProblem(
        response, tuple(unknowns), tuple(stretches), tuple(places), sigma, varied.nominal, fixed_delay, prior
    )


def _by_run(unknown: Unknown, name: str, stretches: Sequence[Driven], search: MotorSearch) -> list[Unknown]:
    """An unknown of all runs together, or one of each run."""
    runs = dict.fromkeys(each.run for each in stretches) if name in search.per_run else [""]
    return [replace(unknown, run=run) for run in runs]


def _numbers(
    record: RobotDescription, stretches: Sequence[Driven], names: Mapping[str, tuple[str, ...]], search: MotorSearch
) -> list[Unknown]:
    """The record's numbers that are fitted."""
    largest, speed = largest_command(stretches), largest_speed(stretches)
    return [
        each
        for label, group in names.items()
        for each in _by_run(_unknown(record, label, group, largest, speed), label.split(":", 1)[1], stretches, search)
    ]


def _offsets(data: Measured, stretches: Sequence[Driven], search: MotorSearch) -> list[Unknown]:
    """Offsets of the joints' commands."""
    largest = largest_command(stretches)
    one = Unknown("", 0.0, -largest, largest, 0.01 * largest, nuisance=True, unit=UNITS[data.command], label="offset")
    joints = [replace(one, name=f"{joint}: offset") for joint in data.joints]
    return [run for each in joints for run in _by_run(each, "offset", stretches, search)]


def _prior(record: RobotDescription, unknowns: Sequence[Unknown]) -> np.ndarray:
    """(2, k) middles and standard deviations of the coordinates by the record, infinite where it states none.

    Raises:
        ModelError: it states none of what is fitted.
    """
    prior = np.array([[each.to_coordinate(each.guess), np.inf] for each in unknowns]).T
    known = {path: each for path, each, _ in quantities(record)}
    for k, each in enumerate(unknowns):
        std = known[each.paths[0]].std if each.paths else None
        if std:
            prior[1, k] = float(np.max(std)) / (each.guess if each.logarithmic else each.scale)
    if not np.isfinite(prior[1]).any():
        names = ", ".join(each.name for each in unknowns if each.paths)
        raise ModelError(
            "the record states no standard deviation of what is fitted", place="priors", expected=f"std of {names}"
        )
    return prior


def _unknown(record: RobotDescription, label: str, paths: tuple[str, ...], largest: float, speed: float) -> Unknown:
    """A number of the record to fit: from its present value on, within what the record allows."""
    joint, name = label.split(":", 1)
    value = value_at(record, paths[0])
    assert value is not None
    low, high = reading_at(record, paths[0]).bounds
    unknown_size = name in LOGARITHMIC or any(part in paths[0] for part in LOGARITHMIC_TABLES)
    if low == 0.0 and value > 0.0 and unknown_size and not np.isfinite(high):
        return Unknown(paths[0], value, value / RANGE, value * RANGE, value, paths, logarithmic=True, label=label)
    torque = largest_torque(record, joint, largest)
    scale = SIZE * (torque / max(speed, 1e-9) if name == "viscous" else torque)
    if name == "efficiency":
        low, high, scale = 0.05, 1.0, 0.1
    if name == "dead_zone":
        high, scale = largest, SIZE * largest
    scale = max(scale, 0.3 * abs(value))
    low, high = max(low, value - RANGE * scale), min(high, value + RANGE * scale)
    return Unknown(paths[0], value, low, high, scale, paths, label=label)


def largest_torque(
    record: RobotDescription, joint: str, command: float, values: Mapping[str, float] | None = None
) -> float:
    """Torque at the joint of the largest command at rest [N m | N], a scale for friction."""
    known = values or {}
    paths = paths_of(record, joint, "Kt") + paths_of(record, joint, "R")
    constants = [known.get(path, value_at(record, path)) for path in paths]
    ratio = abs(value_at(record, f"{path_name(joint)}.motor.gear_ratio") or 1.0)
    kind = next(each for each in record.joints if each.name == joint)
    driven_by = getattr(kind, "command", None) or record.command
    if driven_by == "torque" or constants[0] is None:
        return command
    return ratio * constants[0] * command / ((constants[1] or 1.0) if driven_by == "voltage" else 1.0)


def sizes(record: RobotDescription, data: Measured, problem: DriveProblem, z: np.ndarray) -> np.ndarray:
    """(k,) by how much larger the size of every unknown is, with all others as they are at z, than its scale."""
    values, _ = values_of(problem.unknowns, z)
    known = {path: float(v) for each, v in zip(problem.unknowns, values, strict=True) for path in each.paths}
    command, speed = largest_command(problem.stretches), largest_speed(problem.stretches)
    sizes = np.ones(len(z))
    for k, each in enumerate(problem.unknowns):
        joint, _, name = each.label.partition(":")
        if each.nuisance or each.logarithmic or joint not in data.joints or name in ("L", "efficiency", "dead_zone"):
            continue
        torque = SIZE * largest_torque(record, joint, command, known)
        size = torque / max(speed, 1e-9) if name == "viscous" else torque
        sizes[k] = max(size, abs(float(values[k]))) / each.scale
    return sizes


def starts_of(
    stretch: Driven, number: int, response: Response, arm: Model, unknowns: list[Unknown], speed: float, data: Measured
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the unknowns of a stretch's initial state, -1 where it is fixed, and its values; the unknowns are appended."""
    n, start = response.n, np.full(response.size, -1)
    values = response.initial(arm)
    if stretch.run == "static":
        return start, values
    speeds, q = stretch.speeds, stretch.values.get("q")
    many = f" {number + 1}" if sum(each.run == stretch.run for each in data.stretches) > 1 else ""

    def add(place: int, what: str, guess: float, size: float, unit: str) -> None:
        start[place], values[place] = len(unknowns), guess
        ends, run = (guess - 100 * size, guess + 100 * size), stretch.run + many
        unknowns.append(Unknown(what, guess, *ends, size, run=run, nuisance=True, unit=unit, label="start"))

    for k, joint in enumerate(data.joints):
        if q is not None:
            add(k, f"{joint}: start position", q[0, k], max(float(np.ptp(q[:, k])) * 0.01, 1e-9), "rad")
        if not speeds.any():
            continue
        add(n + k, f"{joint}: start speed", float(speeds[: min(3, len(speeds)), k].mean()), 0.1 * speed + 1e-9, "rad/s")
        most = None if q is None else _speed_at_rest(q[:, k], data.period)
        if most is not None:
            most = max(most, 1e-9 * speed)
            unknowns[-1] = replace(unknowns[-1], guess=0.0, low=-most, high=most, scale=most)
            values[n + k] = 0.0
    if "current" in response.layout:
        place = response.layout.place("current")
        values[place], current = 0.0, stretch.values.get("current")
        if current is not None:
            for k, at in enumerate(range(place.start, place.stop)):
                size = max(float(np.ptp(current[:, k])) * 0.1, 1e-9)
                add(at, f"{data.joints[k]}: start current", float(current[0, k]), size, "A")
    return start, values


def _speed_at_rest(position: np.ndarray, period: float) -> float | None:
    """Largest speed at the start of a log in which the count stays the same at first: a count in that time; None if it moves.

    Dry friction lets the position depend on the square of such a speed alone, and a search without bound goes astray there.
    """
    rows, steps = rows_of_count(position)[0], np.abs(np.diff(position))
    return float(steps[steps > 0.0].min() / ((rows - 1) * period)) if rows > 2 and steps.any() else None


def _first_sigma(data: Measured) -> np.ndarray:
    """Standard deviations (signals · n,) to begin with: noise of the second differences, at least that of quantisation."""
    rows, n = [], len(data.joints)
    for s, name in enumerate(data.signals):
        for k in range(n):
            column = np.concatenate([each.values[name][each.weights[:, s * n + k] > 0, k] for each in data.stretches])
            size = float(np.std(column)) if len(column) else 1.0
            noise = float(np.sqrt(np.mean(np.diff(column, 2) ** 2) / 6.0)) if len(column) > 3 else size
            rows.append(max(noise, float(data.steps[name][k]) / np.sqrt(12.0), 1e-3 * size, 1e-12))
    return np.array(rows)

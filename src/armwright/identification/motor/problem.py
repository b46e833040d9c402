"""The least-squares problem of a fit: unknowns with bounds and sizes, their places in each stretch, and signal weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from armwright.description.paths import path_name, quantities, reading_at
from armwright.description.robot import RobotDescription
from armwright.errors import ModelError
from armwright.identification.motor.drive_record import paths_of, value_at
from armwright.identification.motor.guess import Guess
from armwright.identification.motor.measured import Driven, Measured, rows_of_count
from armwright.identification.motor.output_error import Places, Problem
from armwright.identification.motor.response import Response, response_of
from armwright.identification.motor.unknowns import RANGE, Unknown, positive, values_of
from armwright.model.model import Model, build_model
from armwright.model.vary import Varied

SHARE_OF_TIME = (
    0.05  # of the motor's time constant: the longest substep, 1e-3 of a count wrong in position at a reversal
)
MOST_SUBSTEPS = 16
LOGARITHMIC = ("R", "L", "Kt", "Ke", "J", "stribeck_speed")  # above 0 by their nature, of unknown order of magnitude
LOGARITHMIC_TABLES = (".elasticity.", ".thermal.winding_", ".thermal.housing_")
SIZE = 0.1  # of the torque of the largest command: friction of that size matters
UNITS = {"voltage": "V", "current": "A", "torque": "N m"}  # of a command


def problem_of(
    record: RobotDescription, data: Measured, stretches: Sequence[Driven], names: Mapping[str, tuple[str, ...]],
    guesses: Sequence[Guess], per_run: Sequence[str], free: Sequence[str] | None, delay: float | None, most_delay: int,
    priors: bool = False,
) -> tuple[Problem, list[str]]:  # fmt: skip
    """The least-squares problem, and of every unknown its `joint:name`."""
    arm, n = build_model(record), len(data.joints)
    paths = [path for group in names.values() for path in group]
    varied = Varied(arm, paths)
    lags = 0 if delay == 0.0 else most_delay
    time = min(each.time for each in guesses)
    substeps = int(np.clip(np.ceil(data.period / (SHARE_OF_TIME * time)), 1, MOST_SUBSTEPS))
    response = response_of(varied, data.signals, lags, substeps)
    unknowns: list[Unknown] = []
    labels: list[str] = []
    runs = list(dict.fromkeys(each.run for each in stretches))
    at: dict[tuple[str, str], int] = {}

    def add(unknown: Unknown, label: str, key: str, run: str = "") -> None:
        at[key, run] = len(unknowns)
        unknowns.append(unknown)
        labels.append(label)

    speed = float(max(np.abs(speeds_of(s)).max() for s in stretches))
    largest = float(max(np.abs(s.inputs.command).max() for s in stretches))
    for label, group in names.items():
        joint, name = label.split(":", 1)
        own = name in per_run
        for run in runs if own else [""]:
            add(_unknown(record, label, group, largest, speed, joint, run), label, label, run)
    fits_delay = delay is None and lags > 0 and (free is None or "delay" in free)
    if fits_delay:
        begin = float(np.median([each.delay for each in guesses])) + 0.5
        for run in runs if "delay" in per_run else [""]:
            unknown = Unknown("delay", begin, 0.0, float(lags + 1), 1.0, run=run, nuisance=True, unit="samples")
            add(unknown, "delay", "delay", run)
    if free is not None and "offset" in free:
        for k, joint in enumerate(data.joints):
            for run in runs if "offset" in per_run else [""]:
                about = {"run": run, "nuisance": True, "unit": UNITS[data.command]}
                add(
                    Unknown(f"{joint}: offset", 0.0, -largest, largest, 0.01 * largest, **about),
                    "offset",
                    f"offset{k}",
                    run,
                )
    places = []
    for number, stretch in enumerate(stretches):
        start, fixed_start = starts_of(stretch, number, response, arm, unknowns, labels, speed, data)
        own = [at.get((label, stretch.run), at.get((label, ""), -1)) for label, group in names.items() for _ in group]
        offsets = [at.get((f"offset{k}", stretch.run), at.get((f"offset{k}", ""), -1)) for k in range(n)]
        lag = at.get(("delay", stretch.run), at.get(("delay", ""), -1))
        if stretch.run == "static":
            lag = -1
        places.append(Places(np.array(own, dtype=int), np.array(offsets, dtype=int), lag, start, fixed_start))
    sigma = _first_sigma(data.stretches, data)
    fixed_delay = 0.0 if delay is None else delay / data.period
    if fixed_delay > lags + 1:
        expected = f"at most {(lags + 1) * data.period:g} s"
        raise ModelError("longer than the longest delay", place="delay", value=delay, expected=expected)
    prior = _prior(record, unknowns) if priors else None
    problem = Problem(
        response, tuple(unknowns), tuple(stretches), tuple(places), sigma, varied.nominal, fixed_delay, prior
    )
    return problem, labels


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


def speeds_of(stretch: Driven) -> np.ndarray:
    """(rows, n) measured speeds, or differences of positions."""
    for name in ("qd", "qd_mean"):
        if name in stretch.values:
            return stretch.values[name]
    if "q" not in stretch.values:  # of a locked rotor
        return np.zeros_like(stretch.inputs.command)
    return np.diff(stretch.values["q"], axis=0) / stretch.inputs.period[:-1, None]


def _unknown(
    record: RobotDescription, label: str, paths: tuple[str, ...], largest: float, speed: float, joint: str, run: str
) -> Unknown:
    """A number of the record to fit: from its present value on, within what the record allows."""
    name = label.split(":", 1)[1]
    value = value_at(record, paths[0])
    assert value is not None
    low, high = reading_at(record, paths[0]).bounds
    if (
        low == 0.0
        and value > 0.0
        and (name in LOGARITHMIC or any(part in paths[0] for part in LOGARITHMIC_TABLES))
        and not np.isfinite(high)
    ):
        return replace(positive(paths[0], value, paths, run), run=run)
    torque = largest_torque(record, joint, largest)
    scale = SIZE * (torque / max(speed, 1e-9) if name == "viscous" else torque)
    if name == "efficiency":
        low, high, scale = 0.05, 1.0, 0.1
    if name == "dead_zone":
        high, scale = largest, SIZE * largest
    scale = max(scale, 0.3 * abs(value))
    low, high = max(low, value - RANGE * scale), min(high, value + RANGE * scale)
    return Unknown(paths[0], value, low, high, scale, paths, run)


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


def sizes(
    record: RobotDescription, data: Measured, problem: Problem, labels: Sequence[str], z: np.ndarray
) -> np.ndarray:
    """(k,) by how much larger the size of every unknown is, with all others as they are at z, than its scale."""
    values, _ = values_of(problem.unknowns, z)
    known = {path: float(v) for each, v in zip(problem.unknowns, values, strict=True) for path in each.paths}
    command = float(max(np.abs(s.inputs.command).max() for s in problem.stretches))
    speed = float(max(np.abs(speeds_of(s)).max() for s in problem.stretches))
    sizes = np.ones(len(z))
    for k, each in enumerate(problem.unknowns):
        joint, _, name = labels[k].partition(":")
        if each.nuisance or each.logarithmic or joint not in data.joints or name in ("efficiency", "dead_zone"):
            continue
        torque = SIZE * largest_torque(record, joint, command, known)
        size = torque / max(speed, 1e-9) if name == "viscous" else torque
        sizes[k] = max(size, abs(float(values[k]))) / each.scale
    return sizes


def starts_of(
    stretch: Driven,
    number: int,
    response: Response,
    arm: Model,
    unknowns: list[Unknown],
    labels: list[str],
    speed: float,
    data: Measured,
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the unknowns of a stretch's initial state, -1 where it is fixed, and its values."""
    n, start = response.n, np.full(response.size, -1)
    values = response.initial(arm)
    if stretch.run == "static":
        return start, values
    speeds = speeds_of(stretch)
    many = f" {number + 1}" if sum(each.run == stretch.run for each in data.stretches) > 1 else ""

    def add(place: int, what: str, guess: float, size: float, unit: str) -> None:
        start[place] = len(unknowns)
        ends, run = (guess - 100 * size, guess + 100 * size), stretch.run + many
        unknowns.append(Unknown(what, guess, *ends, size, run=run, nuisance=True, unit=unit))
        labels.append("start")

    for k, joint in enumerate(data.joints):
        if "q" in stretch.values:
            values[k] = stretch.values["q"][0, k]
            size = max(float(np.ptp(stretch.values["q"][:, k])) * 0.01, 1e-9)
            add(k, f"{joint}: start position", values[k], size, "rad")
        if not speeds.any():
            continue
        values[n + k] = float(speeds[: min(3, len(speeds)), k].mean())
        add(n + k, f"{joint}: start speed", values[n + k], 0.1 * speed + 1e-9, "rad/s")
        most = _speed_at_rest(stretch.values["q"][:, k], data.period) if "q" in stretch.values else None
        if most is not None:
            most = max(most, 1e-9 * speed)
            unknowns[-1] = replace(unknowns[-1], guess=0.0, low=-most, high=most, scale=most)
            values[n + k] = 0.0
    if "current" in response.layout:
        place = response.layout.place("current")
        for k, at in enumerate(range(place.start, place.stop)):
            first = float(stretch.values["current"][0, k]) if "current" in stretch.values else 0.0
            values[at] = first
            if "current" in stretch.values:
                size = max(float(np.ptp(stretch.values["current"][:, k])) * 0.1, 1e-9)
                add(at, f"{data.joints[k]}: start current", first, size, "A")
    return start, values


def _speed_at_rest(position: np.ndarray, period: float) -> float | None:
    """Largest speed at the start of a log in which the count stays the same at first: a count in that time; None if it moves.

    Dry friction lets the position depend on the square of such a speed alone, and a search without bound goes astray there.
    """
    rows, steps = rows_of_count(position)[0], np.abs(np.diff(position))
    return float(steps[steps > 0.0].min() / ((rows - 1) * period)) if rows > 2 and steps.any() else None


def _first_sigma(stretches: Sequence[Driven], data: Measured) -> np.ndarray:
    """Standard deviations (signals · n,) to begin with: noise of the second differences, at least that of quantisation."""
    rows = []
    for name in data.signals:
        for k in range(len(data.joints)):
            used = [
                s.values[name][s.weights[:, data.signals.index(name) * len(data.joints) + k] > 0, k] for s in stretches
            ]
            column = np.concatenate(used) if used else np.zeros(0)
            size = float(np.std(column)) if len(column) else 1.0
            noise = float(np.sqrt(np.mean(np.diff(column, 2) ** 2) / 6.0)) if len(column) > 3 else size
            rows.append(max(noise, float(data.steps[name][k]) / np.sqrt(12.0), 1e-3 * size, 1e-12))
    return np.array(rows)

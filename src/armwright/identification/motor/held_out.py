"""Held-out runs: their free simulation with the fit's own delay and initial states, and the written record judged on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from armwright.description.database import read_description
from armwright.description.robot import RobotDescription
from armwright.errors import ArmwrightError, LogError
from armwright.identification.logs.log import Log
from armwright.identification.motor.bench import decoupled_record
from armwright.identification.motor.fitting import Fitted
from armwright.identification.motor.measured import LOGGED, Measured, MotorReading, largest_speed, measured
from armwright.identification.motor.output_error import DriveProblem, UnknownPlaces, refined
from armwright.identification.motor.predictions import MARK, Measures, predictions_of
from armwright.identification.motor.problem import starts_of
from armwright.identification.motor.report import MotorFit
from armwright.identification.motor.unknowns import Unknown, values_of
from armwright.identification.validation.comparison import NO_HOLD_OUT, NO_VERDICT, compare_records, judged_by
from armwright.model.model import Model, build_model


def held_out(
    log: Log, record: RobotDescription, data: Measured, done: Fitted, locked: bool
) -> tuple[dict[str, Any], Measures, list[str]]:
    """Predictions by run, measures by run and signal, and remarks, for the held-out runs.

    Numbers that every run has of its own stand at their means. Initial state, and an offset if one was fitted, are the run's.

    Args:
        log: with runs for fitting and others.   record: that was simulated.   data: what was fitted.   done: the fit.
        locked: the rotors were held.
    """
    runs = [name for name in log.hold_out if name not in {each.run for each in data.stretches}]
    if not runs:
        return {}, {}, []
    names = [LOGGED.get(name, name) for name in data.signals]
    reading = MotorReading(signals=names, speed="difference" if "qd_mean" in data.signals else "instant")
    try:
        fresh = measured(log, runs, data.joints, reading, locked=locked)
    except LogError as error:
        return {}, {}, [f"not simulated: {', '.join(runs)}, held out: {error.problems[0].what or error}"]
    if (fresh.signals, fresh.command) != (data.signals, data.command):
        what = f"{', '.join(fresh.signals)} driven by {fresh.command}"
        return {}, {}, [f"not simulated: {', '.join(runs)}, held out, which have {what}"]
    problem, z = _fresh(record, fresh, done)
    z = refined(problem, z) if len(z) else z
    predictions, measures = predictions_of(problem, z, fresh, MARK)
    return predictions, measures, []


def _fresh(record: RobotDescription, data: Measured, done: Fitted) -> tuple[DriveProblem, np.ndarray]:
    """The problem of new stretches in which the numbers of a fit are fixed, and where its search begins."""
    old, n = done.problem, len(data.joints)
    values, _ = values_of(old.unknowns, done.z)
    nominal, delays = old.nominal.copy(), []
    columns: dict[int, list[float]] = {}
    for at in old.places:
        for column, k in enumerate(at.parameters):
            if k >= 0:
                columns.setdefault(column, []).append(float(values[k]))
        delays.append(float(values[at.delay]) if at.delay >= 0 else old.delay)
    for column, each in columns.items():
        nominal[column] = np.mean(each)
    offset_of = {int(k): joint for at in old.places for joint, k in enumerate(at.offsets) if k >= 0}  # unknown → joint
    unknowns: list[Unknown] = []
    speed = largest_speed(data.stretches)
    arm, places = build_model(record), []
    for number, stretch in enumerate(data.stretches):
        start, fixed = starts_of(stretch, number, old.response, arm, unknowns, speed, data)
        offsets = np.full(n, -1)
        for k, joint in sorted(offset_of.items()):
            offsets[joint] = len(unknowns)
            unknowns.append(replace(old.unknowns[k], guess=float(values[k]), run=stretch.run))
        none = np.full(len(nominal), -1)
        places.append(UnknownPlaces(none, offsets, -1, start, fixed))
    moving = [d for d, at in zip(delays, old.places, strict=True) if at.start.max(initial=-1) >= 0] or delays
    problem = DriveProblem(
        old.response, tuple(unknowns), data.stretches, tuple(places), old.sigma, nominal, float(np.mean(moving))
    )
    return problem, np.array([each.to_coordinate(each.guess) for each in unknowns])


def judged(
    fit: MotorFit, log: Log, runs: Sequence[str], base: RobotDescription | None, loads: Mapping[str, float] | None, locked: bool
) -> MotorFit:  # fmt: skip
    """The fit with its record's measures on the runs held out, as `validate` has them; a worse record is "not identified".

    Args:
        fit: as it would be written.   log: of the runs.   runs: names of those that were fitted.
        base: the record that came in; None: a motor on a bench.   loads: of joints that moved by themselves; None: the arm did.
        locked: the rotors were held, so that no motion can be compared.
    """
    fresh = [name for name in log.hold_out if name not in runs]
    if not fresh:
        return with_remarks(fit, [NO_HOLD_OUT])
    if locked:
        return with_remarks(fit, [f"{NO_VERDICT}: the rotor was held"])

    def model_of(record: RobotDescription) -> Model:
        return build_model(record if loads is None else decoupled_record(record, list(loads), loads))

    try:
        with TemporaryDirectory() as folder:
            written = model_of(read_description(fit.write(Path(folder) / "motor.toml")))
        before, reason = None, "no record came in"
        if base is not None:
            try:
                before, reason = model_of(base), ""
            except ArmwrightError as error:
                reason = f"the record that came in does not predict them, {error}"
        comparison = compare_records(written, before, log, fresh, reason=reason)
    except ArmwrightError as error:
        return with_remarks(fit, [f"{NO_VERDICT}: {error}"])
    return replace(fit, estimate=judged_by(fit.estimate, comparison), hold_out=comparison)


def with_remarks(fit: MotorFit, remarks: Sequence[str], doubts: Sequence[str] = ()) -> MotorFit:
    """The fit with further remarks; with doubts it is "not identified"."""
    estimate = replace(
        fit.estimate,
        remarks=(*fit.estimate.remarks, *remarks, *doubts),
        verdict="not identified" if doubts else fit.estimate.verdict,
    )
    return replace(fit, estimate=estimate)

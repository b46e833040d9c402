"""White-box identification of drives from a log, and the fitted record."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from armwright.description.paths import path_name
from armwright.description.robot import RobotDescription
from armwright.entry import as_log, expect, expect_names
from armwright.errors import LogError, ModelError
from armwright.features import Support
from armwright.identification.logs.log import Log
from armwright.identification.motor.candidates import Candidate, chosen
from armwright.identification.motor.channels import check_channels, feedback_remark
from armwright.identification.motor.conclusion import concluded
from armwright.identification.motor.drive_record import value_at, with_numbers
from armwright.identification.motor.fitting import Fitted, covariance, fitted, without
from armwright.identification.motor.guess import guess
from armwright.identification.motor.held_out import judged, with_remarks
from armwright.identification.motor.measured import MotorReading, measured, steady
from armwright.identification.motor.output_error import DriveProblem
from armwright.identification.motor.predictions import MARK
from armwright.identification.motor.problem import MotorSearch, problem_of
from armwright.identification.motor.report import MotorFit
from armwright.identification.motor.starting import (
    given_numbers,
    guesses_that_stay,
    names_to_fit,
    robot_of,
    starting_record,
)
from armwright.model.model import Model
from armwright.progress import Shown, automatic
from armwright.scalar import real_number

SUPPORT = Support(
    "identify motor",
    without_effect={"brakes": "they are released"},
    refused={"servos": "a log of voltages, and the record without its firmware"},
)

ROWS_PER_UNKNOWN = 5  # measurements
LEAST_GAIN = 0.01  # of the error that a bridge that coasts must take away
POSITIVE = ("R", "L", "Kt", "Ke", "J")
ALL_TO_FIT, USUAL = MotorReading(), MotorSearch()


def identify_motor(
    log: Log | str | os.PathLike[str],
    arm: Model | RobotDescription | str | os.PathLike[str] | None = None,
    *,
    joint: str | None = None,
    load: float | Mapping[str, float] | None = None,
    locked: bool = False,
    free: Sequence[str] | None = None,
    fixed: Mapping[str, float] | None = None,
    reading: MotorReading = ALL_TO_FIT,
    search: MotorSearch = USUAL,
    progress: Shown = None,
) -> MotorFit:
    """Parameters of motors by output error: free simulation of the record's drives, fitted to a log.

    Args:
        log: voltage, current or torque, and position or speed of the joints; a current beside a voltage is compared too.
        arm: an arm, its description, its name or the path of its file; None: the log's, or one motor on a bench.
        joint: of a log of several, for a motor on a bench; or of a robot of several, with `load` or `locked`.
        load: inertia about its axis [kg m² | kg] that a joint turned behind its gear while it was logged, by joint or one for
            all; 0: motors taken off their arm. The fit goes into those joints of the robot. None: the arm moves as one.
        locked: the rotor was held: the current alone is compared, which determines R and L.
        free: what is fitted: "R", "L", "Kt", "Ke", "J", "viscous", "coulomb", "coulomb_positive", "coulomb_negative", "stribeck",
            "friction_offset", "efficiency", "dead_zone" (of the stage), "delay", "offset" (of the command), or keys of the
            joint's tables such as "elasticity.backlash_rad"; None: all that the record has, and the delay.
        fixed: values, in the record's units, of what is known, by the same names; "delay", of the command, in s.
        reading: what of the log is compared, and how.   search: for the numbers.
        progress: True or None: a bar where it is seen; False: none; a function is called with rounds done and of all.
    Returns:
        fit: estimate, record and predictions.
    Raises:
        LogError: the log lacks what a fit needs.   ModelError: no such joint or parameter, an arm that does not match the log.
        DescriptionError: the robot is invalid.
    Example:
        >>> log = "examples/logs/dc_motor/dc_motor.log.toml"
        >>> fit = aw.identification.identify_motor(log)
        >>> print(fit.estimate.verdict)
        identified
    """
    expect(reading, MotorReading, "reading", "an aw.identification.MotorReading", LogError)
    expect(search, MotorSearch, "search", "an aw.identification.MotorSearch", ModelError)
    log = as_log(log)
    static = None if reading.static is None else as_log(reading.static, "static")
    known = dict(fixed or {})
    _check(free, known, search.per_run)
    asked = [log.run(name).name for name in reading.runs] if reading.runs is not None else list(log.fit)
    if search.priors and arm is None and log.arm is None:
        raise ModelError("goes with a robot, whose record states deviations", place="priors", value=True)
    base, source, joints, loads = robot_of(log, arm, joint, load, locked)
    servos = [] if base is None else [joint.name for joint in base.moving_joints if joint.firmware is not None]
    if servos:
        what, expected = "identify motor takes no servos' firmware", SUPPORT.refused["servos"]
        raise ModelError(what, place="joints.firmware", value=", ".join(servos), expected=expected)
    data = measured(log, asked, joints, reading, locked=locked)
    ratios, delay = [_ratio(base, log, name) for name in joints], known.get("delay")
    guesses = []
    for k, ratio in enumerate(ratios):
        guesses.append(guess(data, k, 0 if delay is not None else search.most_delay, float(np.sign(ratio or 1.0))))
        check_channels(data, k, guesses[k], ratio, len(joints) == 1 or loads is not None, log.path)
    feedback = feedback_remark(data, 0) if len(joints) == 1 else []
    data = replace(data, remarks=(*data.remarks, *feedback, *map(str, log.warnings)))

    def fit_of(mode: Literal["brake", "coast"] | None) -> MotorFit:
        record = starting_record(base, loads, data, guesses, known, mode, locked, ratios[0])
        stretches = list(data.stretches)
        if static is not None:
            stretches.append(steady(static, joints, data, max(each.time for each in guesses)))
        names, record = names_to_fit(record, free, set(known), guesses, data, locked)

        def problems(
            record: RobotDescription, names: Mapping[str, tuple[str, ...]], free: Sequence[str] | None
        ) -> DriveProblem:
            return problem_of(record, data, stretches, names, guesses, free, delay, search)

        problem = problems(record, names, free)
        _check_rows(problem, log)
        done = fitted(record, data, problem, search, free, tell)
        if free is None and not locked and len(joints) == 1:
            record, done = chosen(Candidate(record, names, ("delay",), done), data, problems, set(known), tell)
        fit = concluded(log, record, data, done, free, bench=base is None, locked=locked, first=guesses[0])
        if base is None:
            if free is not None and not locked:
                fitted_paths = [path for paths in names.values() for path in paths]
                stay = guesses_that_stay(record, data.joints[0], data.command, fitted_paths, known)
                fit = with_remarks(fit, [], _of_guesses(record, stay, done, lambda moved: problems(moved, names, free)))
            return fit
        given = given_numbers(base, joints, known, mode)
        robot = with_numbers(base, given) if given else base
        return replace(fit, robot=robot, source=None if given else source)

    with automatic(progress, "fitting") as tell:
        mode = search.pwm
        fit = _better_mode(fit_of("brake"), fit_of("coast")) if mode == "compare" else fit_of(mode)
        return judged(fit, log, asked, base, loads, locked)


def _of_guesses(
    record: RobotDescription, stay: Mapping[str, Sequence[str]], done: Fitted,
    problem_with: Callable[[RobotDescription], DriveProblem],
) -> list[str]:  # fmt: skip
    """A sentence on first guesses that stayed, where twice their size moves a fitted number by more than its deviation.

    Args:
        record: with the guesses.   stay: their paths, by name.   problem_with: the fit's problem, of another record.
    """
    inner, z = without(done.problem, done.held, done.z), done.z[done.kept][None]
    residuals, (jacobian,) = inner.evaluate(z)
    std = np.sqrt(np.diag(covariance(inner, residuals[0], jacobian)))
    found = []
    for name, paths in stay.items():
        value = value_at(record, paths[0])
        assert value is not None
        moved = without(problem_with(with_numbers(record, dict.fromkeys(paths, 2.0 * value))), done.held, done.z)
        shift = np.linalg.lstsq(jacobian, residuals[0] - moved.evaluate(z)[0][0], rcond=1e-10)[0]
        if not (np.abs(shift) <= std).all():
            found.append(f"{name} = {value:.4g}")
    what = f"neither fitted nor known, but first guesses on which the other numbers depend: {', '.join(found)}"
    return [f"{what}; name them in --free or --fix (free=…, fixed=…)"] if found else []


def _ratio(base: RobotDescription | None, log: Log, joint: str) -> float | None:
    """Gear ratio of a motor by the robot's record, on a bench by the log's file; None if unknown."""
    if base is not None:
        return value_at(base, f"{path_name(joint)}.motor.gear_ratio")
    place = log.joints.index(joint)
    return None if log.gears is None else float(log.gears[place, place])


def _better_mode(brake: MotorFit, coast: MotorFit) -> MotorFit:
    """Of two fits the one with the smaller error, and a sentence about both; the simpler one where they hardly differ."""
    errors = [_error(each) for each in (brake, coast)]
    better = coast if errors[1] < (1.0 - LEAST_GAIN) * errors[0] else brake
    said = "opens while it is off (coast)" if better is coast else "shorts the motor while it is off (brake)"
    if min(errors) > (1.0 - LEAST_GAIN) * max(errors):
        said = "cannot be identified from this log; brake is kept"
    what = f"the bridge {said}: the error is {errors[0]:.2%} of what varies with brake, {errors[1]:.2%} with coast"
    return replace(better, estimate=replace(better.estimate, remarks=(*better.estimate.remarks, what)))


def _error(fit: MotorFit) -> float:
    """Geometric mean of 1 - fit of all signals that were fitted."""
    shares = [1.0 - each["fit_percent"] / 100.0 for name, each in fit.estimate.fit.items() if MARK not in name]
    return float(np.exp(np.mean(np.log(np.maximum(shares, 1e-12)))))


def _check_rows(problem: DriveProblem, log: Log) -> None:
    """Refuses more unknowns than measurements can carry.

    Raises:
        LogError: says how many there are.
    """
    count = sum(int((each.weights > 0).sum()) for each in problem.stretches)
    if count < ROWS_PER_UNKNOWN * len(problem.unknowns):
        what = f"{count} measurements for {len(problem.unknowns)} unknowns"
        expected = f"{ROWS_PER_UNKNOWN} for each, by a longer log or fewer names in free"
        raise LogError(what, place="rows", expected=expected, file=log.path)


def _check(free: Any, fixed: Mapping[str, Any], per_run: Sequence[str]) -> None:
    expect_names(free, "free", ModelError)
    if free is not None and not [name for name in free if name]:
        raise ModelError(place="free", value=list(free), expected="one name or more, or None: all that the record has")
    for name, value in fixed.items():
        number = real_number(value)
        if number is None or not np.isfinite(number) or (name in POSITIVE and number <= 0.0):
            expected = "a number above 0" if name in POSITIVE else "a finite number"
            raise ModelError(place=f"fixed {name}", value=value, expected=f"{expected}, in the record's unit")
    if fixed.get("delay", 0.0) < 0.0:
        raise ModelError(place="fixed delay", value=fixed["delay"], expected="0 or more, in s")
    twice = {*(free or ()), *per_run} & set(fixed)
    if twice:
        raise ModelError("free or per_run, and fixed", place="fixed", value=sorted(twice)[0], expected="one of the two")

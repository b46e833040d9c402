"""White-box identification of drives from a log: what is fitted, from where it starts, and the record that it goes into."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from armwright.description.database import read_description
from armwright.description.record_of import record_of
from armwright.description.robot import RobotDescription
from armwright.errors import ModelError
from armwright.identification.logs.log import Log, read_log
from armwright.identification.motor.drive_record import bench_record, complete, paths_of, value_at, with_numbers
from armwright.identification.motor.fitting import fitted
from armwright.identification.motor.guess import Guess, guess
from armwright.identification.motor.measured import Measured, measured, steady
from armwright.identification.motor.problem import problem_of
from armwright.identification.motor.report import MotorFit, result
from armwright.model.model import Model
from armwright.scalar import real_number

MOST_DELAY = 10  # samples that are searched
POSITIVE = ("R", "L", "Kt", "Ke", "J")


def identify_motor(
    log: Log | str | os.PathLike[str],
    robot: Model | RobotDescription | str | os.PathLike[str] | None = None,
    *,
    joint: str | None = None,
    free: Sequence[str] | None = None,
    fixed: Mapping[str, float] | None = None,
    per_run: Sequence[str] = (),
    runs: Sequence[str] | None = None,
    signals: Sequence[str] | None = None,
    speed: Literal["auto", "difference", "instant"] = "auto",
    static: Log | str | os.PathLike[str] | None = None,
    pwm: Literal["brake", "coast"] | None = None,
    delay: float | None = None,
    most_delay: int = MOST_DELAY,
    starts: int = 16,
    seed: int = 0,
    progress: Callable[[int, int], object] | None = None,
) -> MotorFit:
    """Parameters of motors by output error: the free simulation of the record's own drives that comes nearest to a log.

    Args:
        log: voltage, current or torque, and position or speed of the joints; a current beside a voltage is compared too.
        robot: an arm, its description, its name or the path of its file; None: the log's, or one motor on a bench.
        joint: of a log of several, for a motor on a bench.
        free: what is fitted: "R", "L", "Kt", "Ke", "J", "viscous", "coulomb", "coulomb_positive", "coulomb_negative", "stribeck",
            "friction_offset", "efficiency", "delay", "offset" (of the command), or keys of the joint's tables such as
            "elasticity.backlash_rad"; None: all that the record has, and the delay.
        fixed: values, in the record's units, of what is known, by the same names; "delay" in s.
        per_run: of `free`, what every run has a value of its own of.   runs: names; None: those to fit.
        signals: those that are compared, "q", "qd", "current", "tau"; None: all.
        speed: "difference" of the positions over a sample, "instant", or "auto": a difference where it is quantised.
        static: a log of steady states, a row each, as additional data.   pwm: of the bridge; None: as the record has it.
        delay: fixed delay of the command [s]; None: it is fitted.   most_delay: longest delay [samples].
        starts: number of first guesses.   seed: of their draws.   progress: called with rounds done and of all.
    Returns:
        fit: estimate, record and predictions.
    Raises:
        LogError: the log lacks what a fit needs.   ModelError: no such joint or parameter, an arm that does not match the log.
        DescriptionError: the robot cannot be believed.
    """
    log = log if isinstance(log, Log) else read_log(log)
    static = static if static is None or isinstance(static, Log) else read_log(static)
    _check(free, fixed, per_run, starts, most_delay)
    asked = [log.run(name).name for name in runs] if runs is not None else list(log.fit)
    base, source, joints = _robot(log, robot, joint)
    data = measured(log, asked, joints, speed, signals)
    guesses = [guess(data, k, 0 if delay is not None else most_delay) for k in range(len(joints))]
    record = _started(base, data, guesses, joints, fixed or {}, pwm)
    stretches = list(data.stretches)
    if static is not None:
        stretches.append(steady(static, joints, data, max(each.time for each in guesses)))
    names, record = _names(record, joints, free, set(fixed or {}), guesses, data)
    problem, labels = problem_of(record, data, stretches, names, guesses, per_run, free, delay, most_delay)
    done = fitted(record, data, problem, labels, starts, seed, free, progress)
    fit = result(log, record, data, done, free, bench=base is None)
    return replace(fit, source=source if record == base else None)


def _check(free: Any, fixed: Any, per_run: Any, starts: int, most_delay: int) -> None:
    for place, value in (("free", free), ("per_run", per_run)):
        if isinstance(value, str):
            raise ModelError(place=place, value=value, expected="a list of names")
    for place, value, least in (("starts", starts, 1), ("most_delay", most_delay, 0)):
        if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or not least <= value <= 1000:
            raise ModelError(place=place, value=value, expected=f"a whole number from {least} to 1000")
    if free is not None and not [name for name in free if name]:
        raise ModelError(place="free", value=list(free), expected="one name or more, or None: all that the record has")
    for name, value in (fixed or {}).items():
        number = real_number(value)
        if number is None or not np.isfinite(number) or (name in POSITIVE and number <= 0.0):
            expected = "a number above 0" if name in POSITIVE else "a finite number"
            raise ModelError(place=f"fixed {name}", value=value, expected=f"{expected}, in the record's unit")
    twice = set(free or ()) & set(fixed or {})
    if twice:
        raise ModelError("free and fixed", place="fixed", value=sorted(twice)[0], expected="one of the two")


def _robot(log: Log, robot: Any, joint: str | None) -> tuple[RobotDescription | None, Any, tuple[str, ...]]:
    """The record, what it was read from, and the joints that are fitted."""
    if robot is None and log.arm is not None:
        robot = log.arm
    if robot is None:
        if joint is not None and joint not in log.joints:
            raise ModelError("no joint of the log", place="joint", value=joint, choices=log.joints)
        if joint is None and len(log.joints) > 1:
            expected = "joint=…, one motor by itself, or robot=…, the arm that they move"
            raise ModelError(f"the log has {len(log.joints)} joints", place="robot", expected=expected, file=log.path)
        return None, None, (next(iter(log.joints)) if joint is None else joint,)
    record = read_description(robot) if isinstance(robot, (str, os.PathLike)) else record_of(robot)
    names = tuple(each.name for each in record.joints if each.type != "fixed" and each.mimic is None)
    for name in names:
        if name not in log.joints:
            raise ModelError("the log has no such joint", place=f"joint {name!r}", choices=log.joints, file=log.path)
    if joint is not None and names != (joint,):
        expected = f"all of {', '.join(names)}: the arm moves as one; or no robot, for a motor by itself"
        raise ModelError("one joint of several", place="joint", value=joint, expected=expected)
    return record, robot, names


def _started(
    base: RobotDescription | None, data: Measured, guesses: Sequence[Guess], joints: Sequence[str],
    fixed: Mapping[str, float], pwm: str | None,
) -> RobotDescription:  # fmt: skip
    """The record with given numbers, and with guesses where it is a motor on a bench."""
    record = bench_record(joints[0], 1.0, data.command) if base is None else base
    given: dict[str, Any] = {}
    for name, value in fixed.items():
        if name != "delay":
            try:
                given |= {path: float(value) for joint in joints for path in paths_of(record, joint, name)}
            except ModelError as error:
                choices = error.problems[0].choices
                raise ModelError("no parameter of a drive", place="fixed", value=name, choices=choices) from None
    if pwm is not None:
        given |= {f"{joint}.motor.pwm": pwm for joint in joints}
    if base is None:
        given = _bench_guess(joints[0], data.command, guesses[0], given) | given
    record = with_numbers(record, given, data.command) if given or data.command != record.command else record
    return record


def _bench_guess(joint: str, command: str, first: Guess, given: Mapping[str, float]) -> dict[str, float]:
    """Numbers of a motor with this response; of those that it does not say, 1 in their unit."""
    motor, friction = f"{joint}.motor", f"{joint}.friction"
    resistance = given.get(f"{motor}.resistance_ohm", first.resistance or 1.0)
    if command == "voltage":
        constant = given.get(f"{motor}.torque_constant_n_m_per_a", first.emf or 1.0 / first.gain)
        inertia = first.time * constant * constant / resistance
        coulomb, viscous = constant * first.band / resistance, 0.0
    else:
        constant = given.get(f"{motor}.torque_constant_n_m_per_a", 1.0) if command == "current" else 1.0
        viscous = constant / first.gain
        inertia, coulomb = first.time * viscous, constant * first.band
    return {
        f"{motor}.resistance_ohm": resistance,
        f"{motor}.torque_constant_n_m_per_a": constant,
        f"{motor}.rotor_inertia_kg_m2": inertia,
        f"{friction}.viscous_n_m_s_per_rad": viscous,
        f"{friction}.coulomb_positive_n_m": coulomb,
        f"{friction}.coulomb_negative_n_m": coulomb,
    }


def _names(
    record: RobotDescription, joints: Sequence[str], free: Sequence[str] | None, fixed: set[str],
    guesses: Sequence[Guess], data: Measured,
) -> tuple[dict[str, tuple[str, ...]], RobotDescription]:  # fmt: skip
    """Paths by `joint:name` of what is fitted, and the record with a number at each of them."""
    known = {path for joint in joints for name in fixed if name != "delay" for path in paths_of(record, joint, name)}
    if free is None:
        names = complete(record, joints)
        if data.command != "voltage":
            names = {name: paths for name, paths in names.items() if name.split(":")[1] not in ("R", "L", "Ke")}
        if data.command == "torque":
            names = {name: paths for name, paths in names.items() if name.split(":")[1] != "Kt"}
        return {name: paths for name, paths in names.items() if not known & set(paths)}, record
    names = {}
    missing: dict[str, float] = {}
    wanted = [
        part for name in free for part in (("stribeck_torque", "stribeck_speed") if name == "stribeck" else (name,))
    ]
    for joint, first in zip(joints, guesses, strict=True):
        for name in wanted:
            if name in ("delay", "offset"):
                continue
            names[f"{joint}:{name}"] = paths = paths_of(record, joint, name)
            for path in paths:
                if value_at(record, path) is None:
                    missing[path] = _first_value(record, joint, name, first, data)
    return names, with_numbers(record, missing) if missing else record


def _first_value(record: RobotDescription, joint: str, name: str, first: Guess, data: Measured) -> float:
    """A number to begin with, of what the record does not have."""
    torque = value_at(record, f"{joint}.motor.torque_constant_n_m_per_a") or 1.0
    resistance = value_at(record, f"{joint}.motor.resistance_ohm") or 1.0
    coulomb = value_at(record, paths_of(record, joint, "coulomb_positive")[0])
    size = torque * max(first.band, 0.01) / (resistance if data.command == "voltage" else 1.0)
    found = {
        "L": resistance * data.period,
        "Ke": torque,
        "viscous": 0.0,
        "coulomb": size,
        "coulomb_positive": size,
        "coulomb_negative": size,
        "stribeck_torque": 1.2 * (coulomb or size),
        "stribeck_speed": 0.1
        * first.gain
        * float(np.abs(np.concatenate([s.inputs.command for s in data.stretches])).max()),
        "friction_offset": 0.0,
        "efficiency": 0.9,
    }
    if name not in found:
        path = paths_of(record, joint, name)[0]
        raise ModelError(
            "is not in the record, and has no first guess", place="free", value=name, expected=f"{path} in the record"
        )
    return found[name]

"""Start record of a fit of drives: the log's robot or a bench, with given numbers and first guesses."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from armwright.description.database import read_description
from armwright.description.paths import path_name
from armwright.description.record_of import record_of
from armwright.description.robot import RobotDescription
from armwright.errors import ModelError, check_known
from armwright.identification.logs.log import Log
from armwright.identification.motor.bench import LOCKED, bench_record, decoupled_record
from armwright.identification.motor.drive_record import complete, paths_of, value_at, with_numbers
from armwright.identification.motor.guess import Guess
from armwright.identification.motor.measured import Measured, largest_command
from armwright.scalar import real_number

Loads = Mapping[str, float]
OF_LOCKED = ("R", "L")  # what the current of a locked rotor follows
AMPLIFIED = ("R", "L", "Ke", "dead_zone")  # numbers that a motor does not feel behind a loop of its current
NEEDLESS = {"voltage": (), "current": AMPLIFIED, "torque": (*AMPLIFIED, "Kt")}  # by the command


def robot_of(
    log: Log, robot: Any, joint: str | None, load: float | Loads | None, locked: bool
) -> tuple[RobotDescription | None, Any, tuple[str, ...], Loads | None]:
    """The record, its source, the fitted joints, and their loads if they move separately.

    Raises:
        ModelError: joints that the log or the arm does not have, or one of several that move as one.
    """
    if robot is None and log.arm is not None:
        robot = log.arm
    if robot is None:
        if joint is not None and joint not in log.joints:
            raise ModelError("no joint of the log", place="joint", value=joint, choices=log.joints)
        if joint is None and len(log.joints) > 1:
            expected = "joint=…, one motor by itself, or arm=…, the arm that they move"
            raise ModelError(f"the log has {len(log.joints)} joints", place="robot", expected=expected, file=log.path)
        if load is not None:
            what = "goes with a robot: the inertia of a motor of which nothing is known holds its load"
            raise ModelError(what, place="load", value=load)
        return None, None, (next(iter(log.joints)) if joint is None else joint,), None
    record = read_description(robot) if isinstance(robot, (str, os.PathLike)) else record_of(robot)
    moving = tuple(each.name for each in record.moving_joints if each.mimic is None)
    if joint is not None and joint not in moving:
        raise ModelError("no joint of the robot", place="joint", value=joint, choices=moving)
    alone = load is not None or locked
    names = moving if joint is None else (joint,)
    if joint is None and alone:
        names = tuple(name for name in moving if name in log.joints)
    for name in names:
        if name not in log.joints:
            raise ModelError("the log has no such joint", place=f"joint {name!r}", choices=log.joints, file=log.path)
    if not names:
        raise ModelError("the log has none of the robot's joints", place="joints", value=moving, choices=log.joints)
    if names != moving and not alone:
        what = f"one of the {len(moving)} joints of {record.name}, which move as one"
        expected = "load=…, the inertia that it turned when it was logged (0: a motor taken off), or locked=True"
        raise ModelError(what, place="joint", value=joint, expected=f"{expected}; or no joint: the whole arm")
    return record, robot, names, _loads(names, load, locked) if alone else None


def _loads(joints: Sequence[str], load: float | Loads | None, locked: bool) -> Loads:
    """Inertia that each joint turns, behind its gear."""
    if locked:
        if load is not None:
            raise ModelError("a locked rotor turns nothing", place="load", value=load, expected="load or locked")
        return dict.fromkeys(joints, LOCKED)
    given = load if isinstance(load, Mapping) else dict.fromkeys(joints, load)
    for name in given:
        check_known(ModelError, name, joints, "no joint that is fitted", place="load")
    found = {}
    for name in joints:
        number = real_number(given.get(name))
        if number is None or not 0.0 <= number < np.inf:
            expected = "the inertia that it turned [kg m² | kg], 0 or more"
            raise ModelError(place=f"load of {name!r}", value=given.get(name), expected=expected)
        found[name] = float(number)
    return found


def given_numbers(
    record: RobotDescription, joints: Sequence[str], fixed: Mapping[str, float], pwm: str | None
) -> dict[str, Any]:
    """Known numbers, by path.

    Raises:
        ModelError: no parameter of a drive.
    """
    given: dict[str, Any] = {}
    for name, value in fixed.items():
        if name != "delay":
            try:
                given |= {path: float(value) for joint in joints for path in paths_of(record, joint, name)}
            except ModelError as error:
                choices = error.problems[0].choices
                raise ModelError("no parameter of a drive", place="fixed", value=name, choices=choices) from None
    if pwm is not None:
        given |= {f"{path_name(joint)}.motor.pwm": pwm for joint in joints}
    return given


def starting_record(
    base: RobotDescription | None, loads: Loads | None, data: Measured, guesses: Sequence[Guess],
    fixed: Mapping[str, float], pwm: str | None, locked: bool, ratio: float | None,
) -> RobotDescription:  # fmt: skip
    """The simulated record, with given numbers and with guesses for missing ones.

    Without a base record the gear is the log's, `ratio`, or else none: the numbers are then those behind the gear.
    """
    joints = data.joints
    if base is None:
        record = bench_record(joints[0], data.command, locked, ratio or 1.0)
    else:
        record = base if loads is None else decoupled_record(base, joints, loads)
    given = given_numbers(record, joints, fixed, pwm)
    if base is None:
        given = _bench_guess(record, joints[0], data.command, guesses[0], given) | given
    elif loads is not None:
        for joint, first in zip(joints, guesses, strict=True):
            guessed = _bench_guess(record, joint, data.command, first, given)
            given = {path: v for path, v in guessed.items() if value_at(record, path) is None} | given
    return with_numbers(record, given, data.command) if given or data.command != record.command else record


def _bench_guess(
    record: RobotDescription, joint: str, command: str, first: Guess, given: Mapping[str, float]
) -> dict[str, float]:
    """Numbers of a motor with this response; of those that it does not say, 1 in their unit."""
    motor, friction = f"{path_name(joint)}.motor", f"{path_name(joint)}.friction"
    ratio = abs(value_at(record, f"{motor}.gear_ratio") or 1.0)
    resistance = given.get(f"{motor}.resistance_ohm", first.resistance or 1.0)
    if command == "voltage":
        constant = given.get(f"{motor}.torque_constant_n_m_per_a", (first.emf or 1.0 / first.gain) / ratio)
        inertia = first.time * constant * constant / resistance
        coulomb, viscous = ratio * constant * first.band / resistance, 0.0
    else:
        constant = given.get(f"{motor}.torque_constant_n_m_per_a", 1.0) if command == "current" else 1.0
        viscous = ratio * constant / first.gain
        inertia, coulomb = first.time * viscous / ratio**2, ratio * constant * first.band
    return {
        f"{motor}.resistance_ohm": resistance,
        f"{motor}.torque_constant_n_m_per_a": constant,
        f"{motor}.rotor_inertia_kg_m2": inertia,
        f"{friction}.viscous_n_m_s_per_rad": viscous,
        f"{friction}.coulomb_positive_n_m": coulomb,
        f"{friction}.coulomb_negative_n_m": coulomb,
    }


def guesses_that_stay(
    record: RobotDescription, joint: str, command: str, fitted: Collection[str], known: Collection[str]
) -> dict[str, Sequence[str]]:
    """Paths, by their names, of a bench's numbers that are neither fitted nor known.

    Args:
        command: quantity that drives the motor.   fitted: paths.   known: names that were given.
    """
    stay = {}
    for name in ("R", "Kt", "J", "viscous", "coulomb"):
        paths = paths_of(record, joint, name)
        given = {path for each in known if each != "delay" for path in paths_of(record, joint, each)}
        value = value_at(record, paths[0])
        if name not in NEEDLESS[command] and value and not {*fitted, *given} & {*paths}:  # 0: a term that is left out
            stay[name] = paths
    return stay


def names_to_fit(
    record: RobotDescription, free: Sequence[str] | None, fixed: set[str], guesses: Sequence[Guess], data: Measured,
    locked: bool,
) -> tuple[dict[str, tuple[str, ...]], RobotDescription]:  # fmt: skip
    """Paths by `joint:name` of the fitted numbers, and the record with a number at each of them.

    Raises:
        ModelError: a name that no drive has, or that has neither a number nor a first guess.
    """
    joints = data.joints
    known = {path for joint in joints for name in fixed if name != "delay" for path in paths_of(record, joint, name)}
    if locked and free is None:
        free = [name for name in OF_LOCKED if name not in fixed]
    if free is None:
        names = {
            name: paths
            for name, paths in complete(record, joints).items()
            if name.split(":")[1] not in NEEDLESS[data.command] and not known & set(paths)
        }
        return names, record
    names = {}
    missing: dict[str, float] = {}
    both = {"stribeck": ("stribeck_torque", "stribeck_speed")}
    wanted = [part for name in free for part in both.get(name, (name,)) if part not in ("delay", "offset")]
    for joint, first in zip(joints, guesses, strict=True):
        for name in wanted:
            names[f"{joint}:{name}"] = paths = paths_of(record, joint, name)
            for path in paths:
                if value_at(record, path) is None:
                    missing[path] = _first_value(record, joint, name, first, data)
    return names, with_numbers(record, missing) if missing else record


def _first_value(record: RobotDescription, joint: str, name: str, first: Guess, data: Measured) -> float:
    """A number to begin with, of what the record does not have."""
    torque = value_at(record, f"{path_name(joint)}.motor.torque_constant_n_m_per_a") or 1.0
    resistance = value_at(record, f"{path_name(joint)}.motor.resistance_ohm") or 1.0
    coulomb = value_at(record, paths_of(record, joint, "coulomb_positive")[0])
    size = torque * max(first.band, 0.01) / (resistance if data.command == "voltage" else 1.0)
    found = {
        "L": resistance * data.period,
        "Ke": torque,
        "viscous": 0.0,
        **dict.fromkeys(("coulomb", "coulomb_positive", "coulomb_negative"), size),
        "stribeck_torque": 1.2 * (coulomb or size),
        "stribeck_speed": 0.1 * first.gain * largest_command(data.stretches),
        "friction_offset": 0.0,
        "efficiency": 0.9,
        "dead_zone": 0.5 * first.band,
    }
    if name not in found:
        path = paths_of(record, joint, name)[0]
        raise ModelError(
            "is not in the record, and has no first guess", place="free", value=name, expected=f"{path} in the record"
        )
    return found[name]

"""`NAME.drive.toml` beside a robot file: what the other format cannot say of motors, gears, friction and place.

```toml
source = "datasheet"                 # for all that names no source of its own
command = "current"

[sources.datasheet]
kind = "datasheet"
text = "…"

[joints.shoulder]                    # the joint's name in the other file
motor = { gear_ratio = 100, rotor_inertia_kg_m2 = 1e-5, torque_constant_n_m_per_a = 0.05 }
friction = { viscous_n_m_s_per_rad = 2.0 }
limits = { current_a = 8.0 }

[joints.wrist]
servo = "sts3215-7.4v"               # from the library of servos; tables beside it change single numbers

[defaults.motor]                     # what all other joints have that do not say otherwise; and defaults.friction
gear_ratio = 100
```
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from pydantic import Field, PrivateAttr

from armwright.description.drive import Command, LinearFriction, Motor, RotaryFriction
from armwright.description.paths import path_name
from armwright.description.robot import JOINTS, PARTS as PARTS_OF
from armwright.description.servos import with_servos
from armwright.description.toml_file import read_text, toml_tables
from armwright.errors import DescriptionError, Problem
from armwright.joint_kinds import KINDS
from armwright.quantity import Positive, Record, Source, Vector3, optional
from armwright.reading import real_path
from armwright.toml_text import TomlText
from armwright.validation import validated

ENDING = ".drive.toml"
PARTS = ("elasticity", "stops", "brake", "firmware", "spring")  # of a joint that a URDF does not know
PLACEHOLDER = 1.0  # the reduction that tools write where nobody gave one


class JointDrive(Record):
    """Drive of one joint."""

    source: str | None = None
    command: Command | None = optional("Kind of command that its drive takes; absent: the file's.")
    bus_period_s: Positive | None = optional("Time between two commands on the drive's bus.")
    motor: dict[str, Any] | None = optional("Motor and gear, as in a robot file.")
    friction: dict[str, Any] | None = optional("Takes the place of the other file's.")
    limits: dict[str, Any] | None = optional("Key by key in the place of the other file's.")
    elasticity: dict[str, Any] | None = optional("As in a robot file, and so the following.")
    stops: dict[str, Any] | None = optional("What the joint runs into.")
    brake: dict[str, Any] | None = optional("What holds it.")
    firmware: dict[str, Any] | None = optional("The loop of a servo.")
    spring: dict[str, Any] | None = optional("What bears some of its load.")


class DriveFile(Record):
    """Drives of a robot, for formats that cannot hold them."""

    source: str | None = optional("Source of every number below that names none of its own.")
    sources: dict[str, Source] = Field(default_factory=dict, description="[sources.KEY]: where numbers come from.")
    command: Command | None = optional("What drives the joints that do not say it themselves.")
    supply: dict[str, Any] | None = optional("As in a robot file.")
    gravity_m_s2: Vector3 | None = optional("In base axes.")
    tip: str | None = Field(default=None, min_length=1, description="The link that kinematics and wrench are about.")
    joints: dict[str, JointDrive] = Field(default_factory=dict, description="[joints.NAME].")
    defaults: dict[str, Any] | None = optional("As in a robot file: for all joints that move by a drive of their own.")
    cylinders: tuple[dict[str, Any], ...] = Field(
        default=(), description="As in a robot file; anchors in the other file's link frames."
    )
    _served: frozenset[str] = PrivateAttr(frozenset())  # joints with a servo, which take no defaults


def drive_file_beside(robot_file: Path) -> Path | None:
    """The default path of a robot file's drive file; None if it does not exist."""
    beside = robot_file.with_name(robot_file.stem + ENDING)
    return beside if os.path.isfile(beside) else None


def find_drive_file(robot_file: Path, drive: str | os.PathLike[str] | None) -> Path | None:
    """The given drive file, or the one beside the robot file; None without any.

    Raises:
        DescriptionError: the one beside is a link to another folder, which nobody named.
    """
    beside = drive_file_beside(robot_file)
    if drive is not None or beside is None:
        return beside if drive is None else Path(drive)
    # Both may be links into one other folder, as in the install folders of colcon.
    if real_path(beside).parent not in (real_path(robot_file.parent), real_path(robot_file).parent):
        raise DescriptionError("is a link that leads out of its folder", expected="drive = FILE names it", file=beside)
    return beside


def read_drive_file(path: Path) -> DriveFile:
    """The drives in a TOML file.

    Raises:
        DescriptionError: no such file, no TOML, an unknown key.
    """
    with toml_tables(path, DescriptionError) as tables:
        found = validated(DriveFile, with_servos(tables, path), file=path)
        joints = tables.get("joints")
        found._served = frozenset(name for name, table in joints.items() if "servo" in table) if joints else frozenset()
        return found


def add_drives(path: Path, drives: DriveFile, robot: dict[str, Any], reductions: dict[str, float]) -> None:
    """Puts a drive file's numbers into a robot read from another format.

    Args:
        path: of the drive file, for errors.   drives: what it says.
        robot: the robot's record, changed here; no key of its sources is one of the drive file's.
        reductions: gear ratios that the other file knows, by joint.
    Raises:
        DescriptionError: a joint that the robot has not or that does not move, a gear ratio that is missing or another
            than the other file's, a number without a source.
    """
    moving = {joint["name"]: joint for joint in robot["joints"] if joint["type"] in JOINTS}
    wrong: list[Problem] = []
    for name, drive in _with_defaults(path, drives, moving).items():
        try:
            if name not in moving:
                place = f"joints.{path_name(name)}"
                raise DescriptionError("does not move or is not there", place=place, choices=moving, file=path)
            source, ratio = drive.source or drives.source, reductions.get(name)
            _add_drive(path, f"joints.{path_name(name)}", moving[name], drive, source, ratio, robot["source"])
        except DescriptionError as error:
            wrong += error.problems
    if wrong:
        text = TomlText(read_text(path), path)
        raise DescriptionError.of(*map(text.with_line, wrong))
    if drives.cylinders:
        robot["cylinders"] = [_table(path, "cylinders", cylinder, drives.source) for cylinder in drives.cylinders]
    if drives.supply is not None:
        robot["supply"] = _table(path, "supply", drives.supply, drives.source)
    robot["sources"] |= drives.sources
    for key in ("command", "tip"):
        if getattr(drives, key) is not None:
            robot[key] = getattr(drives, key)
    if drives.gravity_m_s2 is not None:
        if (drives.gravity_m_s2.source or drives.source) is None:
            raise _no_source(path, "gravity_m_s2")
        robot["gravity_m_s2"] = _sourced({"g": drives.gravity_m_s2}, drives.source)["g"]


def _with_defaults(path: Path, drives: DriveFile, moving: dict[str, dict[str, Any]]) -> dict[str, JointDrive]:
    """Drives by joint, with the file's defaults in those that move and have a drive, but no servo, of their own."""
    if drives.defaults is None:
        return drives.joints
    from armwright.description.defaults import Defaults, filled_in

    validated(Defaults, drives.defaults, place="defaults", file=path)
    found = dict(drives.joints)
    for name, joint in moving.items():
        if "mimic" in joint or name in drives._served:
            continue
        own = drives.joints.get(name, JointDrive())
        tables = {key: getattr(own, key) for key in ("source", *drives.defaults) if getattr(own, key) is not None}
        filled = filled_in({"name": name, "type": joint["type"], **tables}, drives.defaults, drives.source, path)
        found[name] = own.replace(**{part: filled[part] for part in drives.defaults if part in filled})
    return found


def _add_drive(
    path: Path,
    place: str,
    joint: dict[str, Any],
    drive: JointDrive,
    source: str | None,
    reduction: float | None,
    imported: str,
) -> None:
    """Puts the drive of one joint into its record; `imported` is the source of the other file's numbers."""
    linear = KINDS[joint["type"]].units.linear
    if drive.command is not None:
        joint["command"] = drive.command
    if drive.bus_period_s is not None:
        joint |= _sourced({"bus_period_s": drive.bus_period_s}, source)
    if drive.motor is not None:
        motor = _with_reduction(path, place, drive.motor, reduction, imported)
        motor = _with_armature(motor, joint.get("motor"), imported)
        joint["motor"] = _part(path, f"{place}.motor", Motor, motor, source)
    if drive.friction is not None:
        on_motor = drive.friction.get("side") == "motor"
        kind = LinearFriction if linear and not on_motor else RotaryFriction
        joint["friction"] = _part(path, f"{place}.friction", kind, drive.friction, source)
    if drive.limits is not None:
        limits = _part(path, f"{place}.limits", PARTS_OF["limits"][linear], drive.limits, source)
        joint["limits"] = {**joint.get("limits", {}), **_sourced(limits, source)}
    for part in PARTS:
        if getattr(drive, part) is not None:
            joint[part] = _table(path, f"{place}.{part}", getattr(drive, part), source)


def _with_reduction(
    path: Path, place: str, motor: dict[str, Any], reduction: float | None, source: str
) -> dict[str, Any]:
    """The motor with the gear ratio that only the other file gives; two that disagree are refused."""
    if reduction is None or reduction == PLACEHOLDER:
        return motor
    if "gear_ratio" not in motor:
        return {**motor, "gear_ratio": {"value": reduction, "source": source}}
    ratio = motor["gear_ratio"]
    ratio = ratio.get("value") if isinstance(ratio, dict) else ratio
    if ratio != reduction:
        expected = f"{reduction:g}, as in the transmission or actuator"
        raise DescriptionError(place=f"{place}.motor.gear_ratio", value=ratio, expected=expected, file=path)
    return motor


def _with_armature(motor: dict[str, Any], known: dict[str, Any] | None, source: str) -> dict[str, Any]:
    """The motor with the rotor inertia J = armature / n² that only the other file gives, as its armature."""
    if known is None or not known["rotor_inertia_kg_m2"] or "rotor_inertia_kg_m2" in motor:
        return motor
    ratio = motor.get("gear_ratio", known["gear_ratio"])
    ratio = ratio.get("value") if isinstance(ratio, dict) else ratio
    if not isinstance(ratio, (int, float)) or ratio == 0:
        return motor  # refused for that
    inertia = known["rotor_inertia_kg_m2"] * (known["gear_ratio"] / ratio) ** 2
    imported = {"gear_ratio": ratio, "rotor_inertia_kg_m2": inertia}
    return {**{key: {"value": value, "source": source} for key, value in imported.items()}, **motor}


def free_key(key: str, drives: DriveFile | None) -> str:
    """A key of [sources] that a drive file does not use: this one, or this with a number."""
    taken = {} if drives is None else drives.sources
    return next(name for name in (key, *(f"{key}_{k}" for k in range(2, len(taken) + 3))) if name not in taken)


def _part(path: Path, place: str, kind: type[Record], data: dict[str, Any], source: str | None) -> Any:
    """A table as a record that bears its source."""
    record = validated(kind, data, place=place, file=path)
    if getattr(record, "source", None) is None:
        if source is None:
            raise _no_source(path, place)
        return record.replace(source=source)
    return record


def _table(path: Path, place: str, table: dict[str, Any], source: str | None) -> dict[str, Any]:
    """A table that bears its source; its keys are checked with the robot's."""
    if table.get("source", source) is None:
        raise _no_source(path, place)
    return {"source": source, **table}


def _no_source(path: Path, place: str) -> DescriptionError:
    return DescriptionError(
        "has no source", place=place, expected="source = ... in it or for the whole file", file=path
    )


def _sourced(limits: Any, source: str | None) -> dict[str, Any]:
    """The quantities of a record, each with its own source: they go into a table of another one."""
    fields = limits if isinstance(limits, dict) else {name: getattr(limits, name) for name in limits.model_fields_set}
    source = fields.get("source") or source
    return {
        name: quantity if quantity.source is not None else quantity.replace(source=source)
        for name, quantity in fields.items()
        if name != "source" and quantity is not None
    }

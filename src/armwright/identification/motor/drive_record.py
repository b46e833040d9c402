"""Fitted numbers of the drives: short names, paths in the record, and the record with new values."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from armwright.description.database import parse
from armwright.description.paths import path_name, quantities, split_path
from armwright.description.robot import RobotDescription
from armwright.description.writer import to_toml
from armwright.errors import ModelError
from armwright.identification.motor.bench import BENCH
from armwright.joint_kinds import ROTARY

MOTOR_KEYS = {
    "R": "resistance_ohm",
    "L": "inductance_h",
    "Kt": "torque_constant_n_m_per_a",
    "Ke": "back_emf_constant_v_s_per_rad",
    "J": "rotor_inertia_kg_m2",
    "efficiency": "gear_efficiency",
    "dead_zone": "dead_zone_v",
}
FRICTION_STEMS = {
    "viscous": (("viscous", "damping"),),
    "coulomb": (("coulomb_positive", "torque"), ("coulomb_negative", "torque")),
    "coulomb_positive": (("coulomb_positive", "torque"),),
    "coulomb_negative": (("coulomb_negative", "torque"),),
    "stribeck_torque": (("stribeck_torque", "torque"),),
    "stribeck_speed": (("stribeck_speed", "speed"),),
    "friction_offset": (("offset", "torque"),),
}
SHORT = (*MOTOR_KEYS, *FRICTION_STEMS, "stribeck", "delay", "offset")
HOLD_FIRST = (
    *("L", "R", "viscous", "Ke", "stribeck_speed", "stribeck_torque", "friction_offset", "dead_zone", "efficiency"),
    *("Kt", "J"),
)


def paths_of(record: RobotDescription, joint: str, name: str) -> tuple[str, ...]:
    """Paths of the numbers for a short name or a key of the joint's tables.

    Raises:
        ModelError: no such name.
    """
    if name.startswith(f"{path_name(joint)}."):
        return (name,)
    if name in MOTOR_KEYS:
        return (f"{path_name(joint)}.motor.{MOTOR_KEYS[name]}",)
    each = _joint(record, joint)
    friction = getattr(each, "friction", None)
    units = ROTARY if getattr(friction, "side", "joint") == "motor" else each.kind.units
    if name in FRICTION_STEMS:
        return tuple(f"{path_name(joint)}.friction.{units.key(stem, kind)}" for stem, kind in FRICTION_STEMS[name])  # type: ignore[arg-type]
    if "." in name:
        return (f"{path_name(joint)}.{name}",)
    raise ModelError("no parameter of a drive", place="free", value=name, choices=SHORT)


def value_at(record: RobotDescription, path: str) -> float | None:
    """Number at a path; None if the record has none."""
    values = (each.value for place, each, _ in quantities(record) if place == path)
    return next((float(value) for value in values if not isinstance(value, tuple)), None)


def _joint(record: RobotDescription, name: str) -> Any:
    return next(joint for joint in record.joints if joint.name == name)


def with_numbers(record: RobotDescription, values: Mapping[str, Any], command: str | None = None) -> RobotDescription:
    """The record with other numbers at some paths of joints, absent ones included; their source is `BENCH`.

    Raises:
        DescriptionError: numbers that no record may have.
    """
    document = tomllib.loads(to_toml(record))
    for path, value in values.items():
        first, rest = split_path(path)
        *inner, last = rest.split(".")
        table = next((each for each in document["joints"] if each["name"] == first), None)
        if table is None:
            raise ModelError(
                "no joint", place="name", value=path, choices=[each["name"] for each in document["joints"]]
            )
        for part in inner:
            table = table.setdefault(part, {})
        table[last] = value if isinstance(value, str) else {"value": value, "source": BENCH}
    if command is not None:
        document["command"] = command
        for joint in document["joints"]:
            joint.pop("command", None)
    about = {"kind": "estimate", "text": "given to armwright identify motor, or its first guess"}
    document.setdefault("sources", {}).setdefault(BENCH, about)
    return parse(document, record.name)


def complete(record: RobotDescription, joints: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Short names of all numbers of the joints' drives, each with its paths: the default unknowns of a fit."""
    found: dict[str, tuple[str, ...]] = {}
    for joint in joints:
        for name in (*MOTOR_KEYS, *FRICTION_STEMS):
            if name in ("coulomb_positive", "coulomb_negative"):
                continue
            paths = paths_of(record, joint, name)
            values = [value_at(record, path) for path in paths]
            if None in values or (name == "J" and values[0] == 0.0):
                continue
            if name == "coulomb" and values[0] != values[1]:
                found[f"{joint}:coulomb_positive"], found[f"{joint}:coulomb_negative"] = paths[:1], paths[1:]
                continue
            found[f"{joint}:{name}"] = paths
    return found

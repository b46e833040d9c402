"""Joints of a URDF: frames, axes, friction, limits. https://wiki.ros.org/urdf/XML/joint says what each attribute means."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armwright.description.urdf.reading import DYNAMICS_ELSEWHERE, LIMITS_ELSEWHERE, UrdfReading
from armwright.description.xml_tree import Element
from armwright.errors import check_known
from armwright.joint_kinds import KINDS, JointUnits
from armwright.spatial import Placement, roll_pitch_yaw, rotation_rpy

TYPES = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "fixed": "fixed"}
LARGEST = 1e9  # SI; no length, mass, tensor or limit of a robot is beyond, and the arithmetic stays far from overflow
OR_OTHERWISE = 'or mimic = "independent" or "fixed"'
NONE = ("inf", "+inf", "-inf", "infinity", "-infinity")  # how some files say that there is no limit


def joint_record(reading: UrdfReading, joint: Element) -> dict[str, Any]:
    """A joint as the record has it.

    Raises:
        DescriptionError: an unknown or unoffered type, no axis, contradicting limits; with file and line.
    """
    name = joint.word("name")
    what = f"joint {name!r}"
    joint.only_attributes("name", "type", "dont_collapse")
    reading.check_children(joint)
    kind = joint.word("type", what)
    if kind in ("floating", "planar"):
        why = "not offered: an arm's base is fixed, and its joints turn or slide"
        raise joint.error(why, place=f"{what} type", value=kind)
    check_known(joint.error, kind, TYPES, place=f"{what} type")
    ends = {}
    for side in ("parent", "child"):
        end = joint.needed(side, what)
        end.only_attributes("link")
        ends[side] = end.word("link", f"{what} <{side}>")
    frame = reading.attempt(pose, joint.one("origin"))
    record: dict[str, Any] = {"name": name, "type": TYPES[kind], **ends, "frame": frame}
    if not KINDS[TYPES[kind]].moves:
        for tag in ("axis", "limit", "dynamics", "mimic"):
            if joint.one(tag) is not None:
                reading.ignored[f"fixed joint/{tag}"] += 1
        return record
    record["axis"] = reading.attempt(_axis, reading, joint, what)
    limits = reading.attempt(_limits, reading, joint, KINDS[TYPES[kind]].units)
    friction = reading.attempt(_friction, reading, joint, KINDS[TYPES[kind]].units)
    return {**record, "limits": limits, **({"friction": friction} if friction else {})}


def pose(origin: Element | None) -> dict[str, Any]:
    """`<origin>` as a frame: absent parts are 0, as the format says."""
    if origin is None:
        return {"xyz_m": [0.0, 0.0, 0.0], "rpy_rad": [0.0, 0.0, 0.0]}
    origin.only_attributes("xyz", "rpy")
    xyz = origin.numbers("xyz", 3, (0.0, 0.0, 0.0))
    return {"xyz_m": bounded(origin, xyz), "rpy_rad": bounded(origin, origin.numbers("rpy", 3, (0.0, 0.0, 0.0)))}


def bounded(element: Element, values: list[float]) -> list[float]:
    """Numbers that can be a robot's.

    Raises:
        DescriptionError: one of them is beyond all sizes.
    """
    for value in values:
        if abs(value) > LARGEST:
            raise element.error(value=value, expected="a number of a robot, in SI units")
    return values


def _axis(reading: UrdfReading, joint: Element, what: str) -> list[float]:
    axis = joint.one("axis")
    if axis is None:
        raise joint.error("missing", place=f"{what} <axis>", expected='one, such as <axis xyz="0 0 1"/>')
    axis.only_attributes("xyz")
    direction = axis.numbers("xyz", 3)
    length = float(np.linalg.norm(bounded(axis, direction)))
    if not length > 0:
        raise axis.error(place=f"{what} <axis xyz>", value=direction, expected="a direction")
    if abs(length - 1) > 1e-2:
        reading.remark("joint", joint.word("name"), "its axis is not of length 1; read as a direction")
    return direction


def _limits(reading: UrdfReading, joint: Element, units: JointUnits) -> dict[str, Any]:
    """Position, speed and effort. Other exporters write 0 for what they do not know, ours LARGEST; no joint has such limits."""
    name, limit, bounded_range = joint.word("name"), joint.one("limit"), joint.word("type") != "continuous"
    if limit is None:
        if bounded_range:
            reading.remark("joint", name, "no <limit>, which the format asks for: no limit is known")
        return {}
    for attribute in limit.attributes:
        if attribute in LIMITS_ELSEWHERE:
            reading.ignored[f"limit {attribute}"] += 1
    limit.only_attributes("lower", "upper", "effort", "velocity", *LIMITS_ELSEWHERE)
    limits: dict[str, Any] = {}
    lower, upper = (_limit(limit, side) for side in ("lower", "upper"))
    if bounded_range:
        if lower is not None and upper is not None and lower <= -LARGEST and upper >= LARGEST:
            reading.remark("joint", name, f"position limits of {LARGEST:g} or more either way: read as unknown")
        elif lower is not None and upper is not None and lower < upper:
            limits[units.key("position", "position")] = [lower, upper]
        elif lower is not None and upper is not None and lower > upper:
            raise limit.error(place=f"joint {name!r} lower", value=lower, expected=f"a number below upper = {upper:g}")
        else:
            what = "its position limits leave no room (lower = upper) or are infinite: read as unknown"
            reading.remark("joint", name, what)
    for attribute, key in (("velocity", units.key("velocity", "speed")), ("effort", units.key("torque", "torque"))):
        value = _limit(limit, attribute)
        if value is not None and value < 0:
            raise limit.error(
                place=f"joint {name!r} <limit {attribute}>", value=value, expected="a number of 0 or more"
            )
        if value and value < LARGEST:
            limits[key] = value
        elif attribute in limit.attributes and reading.drive_of(name) is None:
            reading.remark("joint", name, f"{attribute} limit 0, {LARGEST:g} or more: read as unknown")
    return limits


def _limit(limit: Element, attribute: str) -> float | None:
    if limit.attributes.get(attribute, "").strip().lower() in NONE:
        return None
    return limit.number(attribute, 0.0)


def _friction(reading: UrdfReading, joint: Element, units: JointUnits) -> dict[str, Any]:
    """Damping is viscous friction, `friction` Coulomb's either way; a URDF has no smoothing speed, so that it sticks."""
    dynamics, name = joint.one("dynamics"), joint.word("name")
    if dynamics is None:
        return {}
    dynamics.only_attributes("damping", "friction", *DYNAMICS_ELSEWHERE)
    unused = [attribute for attribute in DYNAMICS_ELSEWHERE if dynamics.number(attribute, 0.0) != 0]
    if unused:
        reading.remark("joint", name, f"<dynamics {' '.join(unused)}> is another simulator's and not used")
    damping, coulomb = (bounded(dynamics, [dynamics.number(key, 0.0)])[0] for key in ("damping", "friction"))
    for key, value in (("damping", damping), ("friction", coulomb)):
        if value < 0:
            raise dynamics.error(place=f"joint {name!r} {key}", value=value, expected="a number of 0 or more")
    record: dict[str, Any] = {units.key("viscous", "damping"): damping} if damping else {}
    if coulomb:
        record |= {units.key(f"coulomb_{side}", "torque"): coulomb for side in ("positive", "negative")}
        if reading.smoothing is not None:
            record[units.key("smoothing", "speed")] = {"value": reading.smoothing, "source": reading.smoothing_source}
    return record


def with_mimic(reading: UrdfReading, joint: Element, record: dict[str, Any]) -> dict[str, Any]:
    """A mimic joint by the caller's choice: following its master, independent, or locked at its position for master position 0.

    Raises:
        DescriptionError: it follows by a multiplier of 0.
    """
    mimic = joint.one("mimic")
    if mimic is None or not KINDS[record["type"]].moves or None in (record["frame"], record["axis"]):
        return record
    mimic.only_attributes("joint", "multiplier", "offset")
    master, name = mimic.word("joint"), record["name"]
    kind = KINDS[record["type"]]
    multiplier, offset = mimic.number("multiplier", 1.0), bounded(mimic, [mimic.number("offset", 0.0)])[0]
    if reading.mimic == "independent":
        reading.remark("joint", name, "mimics another joint in the file, and is read as an independent joint")
        return record
    if reading.mimic == "fixed":
        reading.remark(
            "joint", name, "mimics another joint in the file, and is fixed where it stands while that is at 0"
        )
        frame = record["frame"]
        at = Placement(rotation_rpy(*frame["rpy_rad"]), np.array(frame["xyz_m"])) @ kind().placement(
            np.array(record["axis"]), offset
        )
        return {
            **{key: record[key] for key in ("name", "parent", "child")},
            "type": "fixed",
            "frame": {"xyz_m": at.position.tolist(), "rpy_rad": list(roll_pitch_yaw(at.rotation))},
        }
    if multiplier == 0.0:
        raise mimic.error(
            place=f"joint {name!r} <mimic multiplier>", value=0.0, expected=f"another number, {OR_OTHERWISE}"
        )
    where = kind.units.key("offset", "position")
    return {**record, "mimic": {"joint": master, "multiplier": multiplier, where: offset}}


def check_masters(joints: Sequence[Element], records: Sequence[dict[str, Any]]) -> None:
    """Refuses joints that follow what does not move or is not there.

    Raises:
        DescriptionError: names the joint, with file and line.
    """
    moving = [record["name"] for record in records if KINDS[record["type"]].moves]
    for joint, record in zip(joints, records, strict=True):
        mimic = joint.one("mimic")
        if mimic is not None and "mimic" in record and record["mimic"]["joint"] not in moving:
            master, others = record["mimic"]["joint"], [name for name in moving if name != record["name"]]
            what, place = "does not move or is not there", f"joint {record['name']!r} <mimic joint>"
            expected = f"a joint that moves, {OR_OTHERWISE}"
            raise mimic.error(what, place=place, value=master, expected=expected, choices=others)

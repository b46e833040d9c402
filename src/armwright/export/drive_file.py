"""Drive file beside a URDF: motors, friction, limits and gravity, for which URDF has no place."""

from __future__ import annotations

from typing import Any

import tomlkit

from armwright.description.drive_file import JointDrive
from armwright.description.robot import RobotDescription
from armwright.export.joints import ExportedJoint, joint_frames, moved_tip
from armwright.export.springs import cylinder_ends
from armwright.model.variants.edits import tip_of
from armwright.quantity import Quantity, Record

CARRIED = [name for name in JointDrive.model_fields if name != "source"]


def drive_file(robot: RobotDescription) -> str:
    """The text of NAME.drive.toml, read by `read_urdf` together with NAME.urdf."""
    joints: dict[str, Any] = {}
    for joint in robot.moving_joints:
        source = joint.source or robot.source
        values = {name: getattr(joint, name) for name in CARRIED}
        joints[joint.name] = {
            name: _plain(value, source)
            for name, value in values.items()
            if value is not None and not (isinstance(value, Record) and not value.model_fields_set)
        }
    frames = joint_frames(robot)
    tip = moved_tip(robot, frames) or tip_of(robot)
    document = {
        "source": robot.source,
        "command": robot.command,
        "gravity_m_s2": _plain(robot.gravity_m_s2, None),
        "tip": tip,
        "supply": _plain(robot.supply, robot.source),
        "sources": {key: source.model_dump(exclude_none=True) for key, source in robot.sources.items()},
        "joints": joints,
        "cylinders": [_cylinder(robot, frames, each) for each in robot.cylinders] or None,
    }
    return tomlkit.dumps({key: value for key, value in document.items() if value is not None})


def _cylinder(robot: RobotDescription, frames: list[ExportedJoint], cylinder: Any) -> dict[str, Any]:
    """The cylinder's table, its anchors in the URDF's link frames: as the record has them where the frame is the same."""
    table = _plain(cylinder, robot.source)
    for key, (_, point) in zip(("anchor_a_m", "anchor_b_m"), cylinder_ends(robot, frames, cylinder), strict=True):
        anchor = getattr(cylinder, key)
        if tuple(point) != anchor.value:
            table[key] = _plain(anchor.model_copy(update={"value": tuple(point.tolist())}), None)
    return table


def _plain(value: Any, source: str | None) -> Any:
    """Records as tables with their source; a number without std, source or date as a plain number."""
    if isinstance(value, Quantity):
        number = list(value.value) if isinstance(value.value, tuple) else value.value
        about = {key: getattr(value, key) for key in ("std", "source", "date") if getattr(value, key) is not None}
        if isinstance(about.get("std"), tuple):
            about["std"] = list(about["std"])
        return {"value": number, **about} if about else number
    if isinstance(value, Record):
        fields = {key: getattr(value, key) for key in type(value).model_fields if key in value.model_fields_set}
        table = {key: _plain(inner, None) for key, inner in fields.items() if inner is not None}
        return table if "source" in table or source is None else {"source": source, **table}
    if isinstance(value, dict):
        return {key: _plain(inner, None) for key, inner in value.items()}
    return [_plain(inner, None) for inner in value] if isinstance(value, (tuple, list)) else value

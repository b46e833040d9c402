"""An arm for ROS 2: a URDF with `ros2_control` tags, and the YAML files of its joint limits and controllers.

| file                | for                                                                                       |
|---------------------|-------------------------------------------------------------------------------------------|
| `NAME.urdf`         | robot_state_publisher, controller_manager                                                 |
| `NAME.drive.toml`   | Armwright, which reads with it the same arm again: motors, friction, gravity              |
| `joint_limits.yaml` | parameters of ros2_control's and MoveIt's joint limits                                    |
| `controllers.yaml`  | controller_manager: a joint_state_broadcaster and a joint_trajectory_controller           |
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from armwright.description.drive_file import ENDING
from armwright.description.record_of import Arm, record_of
from armwright.description.robot import MovingJoint, RobotDescription
from armwright.errors import ModelError
from armwright.export.c import files_to_write
from armwright.export.joints import Limit, plain_limits
from armwright.export.urdf import write_urdf
from armwright.features import Support
from armwright.output import file_stem
from armwright.results.result import Result

SUPPORT = Support("export ros2", refused={"screw joints": "has no helical joint"})

HARDWARE = "mock_components/GenericSystem"  # of ros2_control: state follows command; in place of the real arm's driver
COMMANDS = ("position", "velocity", "effort")
WORDS = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")  # names that YAML 1.1 reads as values
UPDATE_RATE = 100  # [Hz] of controller_manager where nothing else is set


@dataclass(frozen=True)
class Ros2Export(Result):
    """Result of `export_ros2`.

    Attributes:
        paths: of the files.   lost: what the URDF itself cannot hold, one sentence each.
    """

    paths: tuple[Path, ...]
    lost: tuple[str, ...]


def export_ros2(
    arm: Arm | RobotDescription,
    directory: str | os.PathLike[str],
    *,
    command: str = "position",
    rate: int = UPDATE_RATE,
    hardware: str = HARDWARE,
) -> Ros2Export:
    """Writes an arm for ROS 2: URDF with ros2_control tags, drive file, joint limits and controllers.

    All values are in SI units, as ROS has them; a limit that the record does not state is left out and marked `has_…: false`.

    Args:
        arm: the arm or its description.   directory: created if it does not exist; files of those names in it are replaced.
        command: that the joint_trajectory_controller gives: "position", "velocity" or "effort".
        rate: of updates of the controller manager, in Hz.
        hardware: plugin of the hardware component: the name of the arm's driver.
    Returns:
        exported: the files, and what the URDF cannot hold.
    Raises:
        ModelError: an unknown command, a rate or a name that cannot be.   OutputError: a file cannot be written.
    """
    if command not in COMMANDS:
        raise ModelError(place="command", value=command, choices=COMMANDS)
    if isinstance(rate, bool) or not isinstance(rate, int) or rate < 1:
        raise ModelError(place="rate", value=rate, expected="a whole number of 1 Hz or more")
    if not isinstance(hardware, str) or not hardware.strip():
        raise ModelError(place="hardware", value=hardware, expected=f"the name of a plugin, such as {HARDWARE}")
    robot = record_of(arm)
    moving = robot.moving_joints
    if not moving:
        raise ModelError(f"{robot.name} has none that moves", place="joints", expected="an arm")
    driven = [joint for joint in moving if joint.mimic is None]
    texts = {
        "joint_limits.yaml": _yaml({"joint_limits": {joint.name: _limits(joint) for joint in moving}}),
        "controllers.yaml": _yaml(_controllers([joint.name for joint in driven], command, rate)),
    }
    with files_to_write(Path(directory), texts) as folder:
        urdf = folder / f"{file_stem(robot.name)}.urdf"
        lost = write_urdf(robot, urdf, elements=[_ros2_control(robot, moving, hardware)])
    names = (urdf.name, urdf.stem + ENDING, *texts)
    return Ros2Export(tuple(Path(directory) / name for name in names), tuple(lost))


def _ros2_control(robot: RobotDescription, joints: Sequence[MovingJoint], hardware: str) -> ElementTree.Element:
    """The element <ros2_control>: command interfaces with their limits, state interfaces; a mimic joint has states only."""
    element = ElementTree.Element("ros2_control", name=robot.name, type="system")
    ElementTree.SubElement(ElementTree.SubElement(element, "hardware"), "plugin").text = hardware
    for joint in joints:
        child = ElementTree.SubElement(element, "joint", name=joint.name)
        position, velocity, effort = plain_limits(joint)
        both = {"position": None if position is None else np.array(position).tolist()}
        for name, limit in (("velocity", velocity), ("effort", effort)):
            both[name] = None if limit is None else [-float(limit), float(limit)]
        for name in COMMANDS if joint.mimic is None else ():
            interface = ElementTree.SubElement(child, "command_interface", name=name)
            for key, value in zip(("min", "max"), both[name] or (), strict=False):
                ElementTree.SubElement(interface, "param", name=key).text = repr(value)
        for name in COMMANDS:
            interface = ElementTree.SubElement(child, "state_interface", name=name)
            if name == "position" and joint.mimic is None:
                low, high = both[name] or (0.0, 0.0)
                start = 0.0 if low <= 0.0 <= high else 0.5 * (low + high)  # 0 where the joint can be there
                ElementTree.SubElement(interface, "param", name="initial_value").text = repr(start)
    return element


def _limits(joint: MovingJoint) -> dict[str, Any]:
    """Limits of a joint under the names of ros2_control's parameters."""
    position, velocity, effort = plain_limits(joint)
    low, high = (None, None) if position is None else np.array(position).tolist()
    return {
        "has_position_limits": position is not None,
        **({} if position is None else {"min_position": low, "max_position": high}),
        **_limit("velocity", velocity),
        **_limit("acceleration", joint.limit("acceleration")),
        "has_jerk_limits": False,
        **_limit("effort", effort),
    }


def _limit(name: str, limit: Limit) -> dict[str, Any]:
    return {f"has_{name}_limits": False} if limit is None else {
        f"has_{name}_limits": True, f"max_{name}": float(limit)
    }  # fmt: skip


def _controllers(joints: list[str], command: str, rate: int) -> dict[str, Any]:
    """Parameters of the controller manager and its controllers."""
    return {
        "controller_manager": {
            "ros__parameters": {
                "update_rate": rate,
                "joint_state_broadcaster": {"type": "joint_state_broadcaster/JointStateBroadcaster"},
                "arm_controller": {"type": "joint_trajectory_controller/JointTrajectoryController"},
            }
        },
        "arm_controller": {
            "ros__parameters": {
                "joints": joints,
                "command_interfaces": [command],
                "state_interfaces": ["position", "velocity"],
            }
        },
    }


def _yaml(value: Any, indent: int = 0) -> str:
    """Nested tables as YAML; names, texts and lists are written as JSON, which YAML contains."""
    lines = []
    for key, inner in value.items():
        name = key if key.isidentifier() and key.lower() not in WORDS else json.dumps(key, ensure_ascii=False)
        if isinstance(inner, dict):
            lines.append(f"{'  ' * indent}{name}:\n{_yaml(inner, indent + 1)}")
        else:
            lines.append(f"{'  ' * indent}{name}: {_number(inner)}\n")
    return "".join(lines)


def _number(value: Any) -> str:
    """A scalar or list as JSON; YAML 1.1 takes `1e-05` for a text, so exponents get a point."""
    text = json.dumps(value, ensure_ascii=False)
    return text.replace("e", ".0e") if isinstance(value, float) and "e" in text and "." not in text else text

"""An arm for ROS 2: a URDF with `ros2_control` tags, and the YAML files of its joint limits and controllers.

| file                | for                                                                                       |
|---------------------|-------------------------------------------------------------------------------------------|
| `NAME.urdf`         | robot_state_publisher, controller_manager                                                 |
| `NAME.drive.toml`   | Armwright, which reads with it the same arm again: motors, friction, gravity              |
| `joint_limits.yaml` | parameters of ros2_control's and MoveIt's joint limits                                    |
| `controllers.yaml`  | controller_manager: a joint_state_broadcaster and a joint_trajectory_controller           |

Of a scenario they are a package with its controller: `ros2_controller`.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np

from armwright.description.drive_file import ENDING
from armwright.description.record_of import Arm, record_of
from armwright.description.robot import MovingJoint, RobotDescription
from armwright.errors import ModelError, check_known
from armwright.export.c import files_to_write, folder_to_write
from armwright.export.controller.recording import record
from armwright.export.controller.sil import SoftwareInTheLoop
from armwright.export.controller.stages import ControllerStages
from armwright.export.controller.write import (
    COMPARED,
    NO_COMPILER,
    SUPPORT as CONTROLLER,
    controller_code,
    with_selftest,
)
from armwright.export.joints import Limit, plain_limits
from armwright.export.ros2_controller.package import (
    command_interfaces,
    controller_parameters,
    controller_table,
    package_name,
    package_texts,
    state_interfaces,
)
from armwright.export.urdf import write_urdf
from armwright.features import Support
from armwright.output import file_stem
from armwright.results.result import Result
from armwright.simulation.scenario import Scenario

SUPPORT = Support("export ros2", refused={"screw joints": "has no helical joint"})

HARDWARE = "mock_components/GenericSystem"  # of ros2_control: state follows command; in place of the real arm's driver
COMMANDS = ("position", "velocity", "effort")
WORDS = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")  # names that YAML 1.1 reads as values
TRIED = (
    "the plugin was tried against headers with the signatures of ros2_control, not under ROS 2: begin with a simulation"
)
Range = tuple[float, float] | None
UPDATE_RATE = 100  # [Hz] of controller_manager where nothing else is set


@dataclass(frozen=True, eq=False)
class Ros2Export(Result):
    """Result of `export_ros2`.

    Attributes:
        paths: of the files.   lost: what the URDF itself cannot hold, one sentence each.
        comparison: of the controller's C with the simulation; None without a controller or a C compiler.
        notes: for the user.
    """

    paths: tuple[Path, ...]
    lost: tuple[str, ...]
    comparison: SoftwareInTheLoop | None = None
    notes: tuple[str, ...] = ()


def export_ros2(
    source: Arm | RobotDescription | Scenario,
    directory: str | os.PathLike[str],
    *,
    command: Literal["position", "velocity", "effort"] | None = None,
    rate: int | None = None,
    hardware: str = HARDWARE,
    name: str | None = None,
    gains: Sequence[str] = (),
) -> Ros2Export:
    """Writes an arm for ROS 2, or a scenario's controller as a package with a plugin of ros2_control.

    Of an arm: URDF with ros2_control tags, drive file, joint limits and controllers. Of a scenario these in a package
    (`package.xml`, `CMakeLists.txt`), with the controller as C99, a chainable controller of ros2_control around it (ROS 2
    Jazzy and Kilted), and its parameters. All values are in SI units, as ROS has them; a limit that the record does not
    state is left out and marked `has_…: false`.

    Args:
        source: the arm, its description, or a scenario with a controller.
        directory: created if it does not exist; files of those names in it are replaced.
        command: that the joint_trajectory_controller gives: "position", "velocity" or "effort"; default: position; none for
            a scenario, whose drives decide.
        rate: of updates of the controller manager, in Hz; default: 100; none for a scenario, whose period decides.
        hardware: plugin of the hardware component: the name of the arm's driver.
        name: of a scenario's package and controller; default: the arm's and "controller".
        gains: fields of the controller that become parameters, as for `export_controller`.
    Returns:
        exported: the files, and what the URDF cannot hold.
    Raises:
        ModelError: an unknown command, a rate or a name that cannot be, an option that does not go with the source.
        ScenarioError: a scenario without a controller that can be traced, with another reference than a motion of the
            joints, with a period that is no whole rate in Hz.
        OutputError: a file cannot be written.
    Example:
        >>> made = aw.export.export_ros2(aw.load("two-link"), "ros2")
        >>> [path.name for path in made.paths]
        ['two-link.urdf', 'two-link.drive.toml', 'joint_limits.yaml', 'controllers.yaml']
    """
    if not isinstance(hardware, str) or not hardware.strip():
        raise ModelError(place="hardware", value=hardware, expected=f"the name of a plugin, such as {HARDWARE}")
    if isinstance(source, Scenario):
        for place, value in (("command", command), ("rate", rate)):
            if value is not None:
                raise ModelError("goes with an arm", place=place, value=value, expected="none: the scenario decides")
        return _package(source, Path(directory), hardware, name, gains)
    for place, value in (("name", name), ("gains", gains)):
        if value:
            raise ModelError("goes with a scenario", place=place, value=value, expected="none")
    return _description(
        source, Path(directory), command or COMMANDS[0], UPDATE_RATE if rate is None else rate, hardware
    )


def _description(source: Arm | RobotDescription, folder: Path, command: str, rate: int, hardware: str) -> Ros2Export:
    """An arm's files."""
    check_known(ModelError, command, COMMANDS, place="command")
    if isinstance(rate, bool) or not isinstance(rate, int) or rate < 1:
        raise ModelError(place="rate", value=rate, expected="a whole number of 1 Hz or more")
    robot, moving = _moving(source)
    driven = [joint.name for joint in moving if joint.mimic is None]
    texts = {"joint_limits.yaml": _limits_text(moving), "controllers.yaml": _yaml(_controllers(driven, command, rate))}
    commands = {joint.name: _ranges(joint) for joint in moving if joint.mimic is None}
    with files_to_write(folder, texts):
        element = _ros2_control(robot, moving, hardware, commands, COMMANDS)
        urdf = folder / f"{file_stem(robot.name)}.urdf"
        lost = write_urdf(robot, urdf, elements=[element])
    names = (urdf.name, urdf.stem + ENDING, *texts)
    return Ros2Export(tuple(folder / each for each in names), tuple(lost))


def _package(scenario: Scenario, folder: Path, hardware: str, name: str | None, gains: Sequence[str]) -> Ros2Export:
    """A scenario's package."""
    fields = (gains,) if isinstance(gains, str) else tuple(gains)
    own = package_name(name or f"{scenario.arm.name} controller")
    stages = ControllerStages.of(scenario, own, fields)
    robot, moving = _moving(stages.arm)
    urdf = f"{file_stem(robot.name)}.urdf"
    files = package_texts(stages, urdf, hardware)
    code, comparison = with_selftest(stages, record(stages, min(scenario.ticks, COMPARED)), controller_code(stages))
    files |= {f"{'test' if file.endswith('_selftest.c') else 'src'}/{file}": text for file, text in code.items()}
    files |= {
        "config/joint_limits.yaml": _limits_text(moving),
        "config/controllers.yaml": _yaml(controller_table(stages)),
    }
    kinds, ranges = command_interfaces(stages), {joint.name: _ranges(joint) for joint in moving}
    for body in stages.arm.coordinates:
        limit = (
            float(getattr(body.limits, body.drive.command))
            if body.drive.command in ("current", "voltage")
            else math.inf
        )
        ranges[body.joint][body.drive.command] = (-limit, limit) if math.isfinite(limit) else None
    commands = {joint: {kind: ranges[joint][kind]} for joint, kind in kinds.items()}
    states = (*COMMANDS, *(each for each in state_interfaces(stages).values() if each not in COMMANDS))
    with ExitStack() as stack:
        stack.enter_context(folder_to_write(folder))
        for place in sorted({Path(file).parent for file in files}):
            texts = {Path(file).name: text for file, text in files.items() if Path(file).parent == place}
            stack.enter_context(files_to_write(folder / place, texts))
        stack.enter_context(folder_to_write(folder / "urdf"))
        element = _ros2_control(robot, moving, hardware, commands, states)
        lost = write_urdf(robot, folder / "urdf" / urdf, elements=[element])
    names = (*files, f"urdf/{urdf}", f"urdf/{Path(urdf).stem}{ENDING}")
    notes = [*CONTROLLER.notes(stages.arm), TRIED, *([] if comparison is not None else [NO_COMPILER])]
    return Ros2Export(tuple(folder / each for each in names), tuple(lost), comparison, tuple(notes))


def _moving(source: Arm | RobotDescription) -> tuple[RobotDescription, list[MovingJoint]]:
    """The description and its joints that move.

    Raises:
        ModelError: it has none.
    """
    robot = record_of(source)
    moving = list(robot.moving_joints)
    if not moving:
        raise ModelError(f"{robot.name} has none that moves", place="joints", expected="an arm")
    return robot, moving


def _ros2_control(
    robot: RobotDescription,
    joints: Sequence[MovingJoint],
    hardware: str,
    commands: Mapping[str, Mapping[str, Range]],
    states: Sequence[str],
) -> ElementTree.Element:
    """The element <ros2_control>: command interfaces with their limits, state interfaces; a mimic joint has states only."""
    element = ElementTree.Element("ros2_control", name=robot.name, type="system")
    ElementTree.SubElement(ElementTree.SubElement(element, "hardware"), "plugin").text = hardware
    for joint in joints:
        child = ElementTree.SubElement(element, "joint", name=joint.name)
        for name, pair in commands.get(joint.name, {}).items():
            interface = ElementTree.SubElement(child, "command_interface", name=name)
            for key, value in zip(("min", "max"), pair or (), strict=False):
                ElementTree.SubElement(interface, "param", name=key).text = repr(value)
        for name in states:
            interface = ElementTree.SubElement(child, "state_interface", name=name)
            if name == "position" and joint.mimic is None:
                low, high = _ranges(joint)[name] or (0.0, 0.0)
                start = 0.0 if low <= 0.0 <= high else 0.5 * (low + high)  # 0 where the joint can be there
                ElementTree.SubElement(interface, "param", name="initial_value").text = repr(start)
    return element


def _ranges(joint: MovingJoint) -> dict[str, Range]:
    """Smallest and largest command of each kind in `COMMANDS`; None where the record states no limit."""
    position, velocity, effort = plain_limits(joint)
    low_high = None if position is None else np.array(position).tolist()
    both = {
        name: None if limit is None else (-float(limit), float(limit))
        for name, limit in (("velocity", velocity), ("effort", effort))
    }
    return {"position": low_high and (low_high[0], low_high[1]), **both}


def _limits_text(moving: Sequence[MovingJoint]) -> str:
    return _yaml({"joint_limits": {joint.name: _limits(joint) for joint in moving}})


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
    return controller_parameters(rate, {}, {"joints": joints, "command_interfaces": [command]})


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
    """A scalar or list as JSON; YAML 1.1 takes `1e-05` for a text, so exponents get a point, and writes infinity as `.inf`."""
    if isinstance(value, list):
        return f"[{', '.join(map(_number, value))}]"
    if isinstance(value, float) and math.isinf(value):
        return ".inf" if value > 0.0 else "-.inf"
    text = json.dumps(value, ensure_ascii=False)
    return text.replace("e", ".0e") if isinstance(value, float) and "e" in text and "." not in text else text

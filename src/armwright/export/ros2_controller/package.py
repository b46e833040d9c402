"""Texts of a ROS 2 package with the controller of a scenario: plugin, its description, build files and parameters.

The package, the controller and its plugin have one name, that of the C files: `NAME/Controller` is the plugin's type.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from string import Template
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from armwright.errors import ScenarioError
from armwright.export.c_header import plain
from armwright.export.controller.parameters import INFINITE, NOT_NEGATIVE, Member, gain_members, members
from armwright.export.controller.stages import ControllerStages, inputs_read
from armwright.kernels.c_syntax import identifier
from armwright.signals import Layout

SOURCES = Path(__file__).parent / "sources"
#: Interfaces of ros2_control by what a drive is commanded; ros2_control has no names for the last two.
COMMANDS = {"position": "position", "torque": "effort", "current": "current", "voltage": "voltage"}
STATES = {"q": "position", "qd": "velocity", "current": "current"}
REFERENCES = {"q": "position", "qd": "velocity", "qdd": "acceleration"}
OWN = ("initial_command", "count")  # members of the struct that are no parameters in ROS


class _Text(Template):
    """A text with `@name` and `@{name}` to fill in; `@@` is an @."""

    delimiter = "@"


def package_name(text: str) -> str:
    """A name as ROS packages have it: lower case, digits and single underscores, a letter first (REP 144)."""
    return re.sub(r"_+", "_", identifier(text).lower())


def command_interfaces(stages: ControllerStages) -> dict[str, str]:
    """The kind of each joint's command interface, by the joint's name."""
    return {body.joint: COMMANDS[body.drive.command] for body in stages.arm.coordinates}


def state_interfaces(stages: ControllerStages) -> dict[str, str]:
    """Kinds of the state interfaces that the controller reads, by signal; positions always.

    Raises:
        ScenarioError: the controller reads a signal that is no state of a joint.
    """
    y = Layout((*stages.measured, *stages.applied))
    read = _signals_read(y, {*inputs_read(stages.law, "y"), *inputs_read(stages.begin, "y")})
    if others := read - STATES.keys() - {"applied"}:
        raise ScenarioError(
            f"reads {', '.join(sorted(others))}",
            place="loop.sensors",
            expected="states of joints, as ros2_control has them",
        )
    return {signal: kind for signal, kind in STATES.items() if signal == "q" or signal in read}


def reference_interfaces(stages: ControllerStages) -> dict[str, str]:
    """Kinds of the references, by signal: positions, and speeds and accelerations up to what the controller reads.

    Raises:
        ScenarioError: the controller follows something else than a motion of the joints.
    """
    others = [signal.name for signal in stages.reference if signal.name not in REFERENCES]
    if others or "q" not in stages.reference:
        what = f"has {', '.join(others or ['no positions'])}"
        raise ScenarioError(what, place="loop.reference", expected="positions, speeds and accelerations of the joints")
    read = _signals_read(stages.reference, set(inputs_read(stages.law, "r")))
    order = list(REFERENCES)
    last = max((order.index(signal) for signal in read), default=0)
    return {signal: REFERENCES[signal] for signal in order[: last + 1]}


def update_rate(stages: ControllerStages) -> int:
    """Updates a second.

    Raises:
        ScenarioError: no whole number.
    """
    rate = round(1.0 / stages.period)
    if rate < 1 or abs(rate * stages.period - 1.0) > 1e-9:
        expected = "1/N s with a whole N: rates of ros2_control are whole Hz"
        raise ScenarioError(place="loop.period", value=stages.period, expected=expected)
    return rate


def package_texts(stages: ControllerStages, urdf: str, hardware: str) -> dict[str, str]:
    """The package's files around the C files, by path: plugin, its description, build files and README.md.

    Args:
        stages: the controller's.   urdf: name of the URDF's file.   hardware: plugin of the hardware component.
    Raises:
        ScenarioError: a controller that cannot be one of ros2_control: its period, its reference or its sensors.
    """
    name, law, arm = stages.name, plain(stages.loop.controller.name), plain(stages.arm.name)
    commands, states, references = command_interfaces(stages), state_interfaces(stages), reference_interfaces(stages)
    delay, rate = stages.delay_ticks, update_rate(stages)
    about = f"The controller {law} of {arm}, {rate} steps a second."
    words = {
        "name": name, "macro": name.upper(), "law": law, "arm": arm, "rate": rate, "joints": stages.arm.n, "delay": delay,
        "names": _strings(commands), "commands": _strings(commands.values()),
        "states": _strings(states.values()), "state_count": len(states),
        "references": _strings(references.values()), "reference_count": len(references),
        "fields": "\n".join(_field(name, key, row) for key, row in _parameters(stages).items()),
        "targets": ", ".join(f"measurement_.{signal}" for signal in states),
        "reference_targets": ", ".join(f"reference_.{signal}" for signal in references),
        "command_table": ", ".join(f"`{joint}/{kind}`" for joint, kind in commands.items()),
        "state_table": f"`JOINT/…` with {', '.join(states.values())}",
        "reference_table": f"`{name}/JOINT/…` with {', '.join(references.values())}",
        "delay_text": "the step before" if delay == 0 else f"{delay + 1} steps before",
        "urdf": urdf, "hardware": hardware,
    }  # fmt: skip
    in_xml = words | {"about": escape(about)}
    return {
        "package.xml": _filled("package.xml", in_xml),
        "CMakeLists.txt": _filled("CMakeLists.txt", words),
        "README.md": _filled("README.md", words),
        f"{name}_plugin.xml": _filled("plugin.xml", in_xml),
        f"src/{name}_plugin.cpp": _filled("plugin.cpp", words),
    }


def controller_table(stages: ControllerStages) -> dict[str, Any]:
    """Parameters of the controller manager, the controller, and the joint_trajectory_controller in front of it."""
    name, joints, rate = stages.name, list(command_interfaces(stages)), update_rate(stages)
    parameters: dict[str, Any] = {"joints": joints, "take_over_ticks": 0}
    for key, row in _parameters(stages).items():
        table, _, field = key.partition(".")
        parameters.setdefault(table, {})[field] = np.ravel(row.values).astype(float).tolist()
    commanded = {"joints": joints, "command_joints": [f"{name}/{joint}" for joint in joints]}
    commanded["command_interfaces"] = list(reference_interfaces(stages).values())
    return controller_parameters(rate, {name: (f"{name}/Controller", parameters)}, commanded)


def controller_parameters(
    rate: int, own: Mapping[str, tuple[str, dict[str, Any]]], commanded: Mapping[str, Any]
) -> dict[str, Any]:
    """Parameters of the controller manager and its controllers.

    Args:
        rate: of updates in Hz.   own: type and parameters of further controllers, by name.
        commanded: parameters of the joint_trajectory_controller: its joints, and what it commands.
    """
    types = {"joint_state_broadcaster": "joint_state_broadcaster/JointStateBroadcaster"}
    types |= {name: kind for name, (kind, _) in own.items()}
    types["arm_controller"] = "joint_trajectory_controller/JointTrajectoryController"
    manager = {"update_rate": rate, **{name: {"type": kind} for name, kind in types.items()}}
    tables = {"controller_manager": manager, **{name: parameters for name, (_, parameters) in own.items()}}
    tables["arm_controller"] = {**commanded, "state_interfaces": ["position", "velocity"]}
    return {name: {"ros__parameters": table} for name, table in tables.items()}


def _signals_read(layout: Layout, entries: set[int]) -> set[str]:
    """Names of the signals of which some entries are read."""
    return {signal.name for signal in layout if entries & set(_range(layout, signal.name))}


def _range(layout: Layout, signal: str) -> range:
    place = layout.place(signal)
    return range(place.start, place.stop)


def _parameters(stages: ControllerStages) -> dict[str, Member]:
    """Members of the struct of parameters by their names in ROS."""
    gains = {row.name for row in gain_members(stages)}
    rows = [row for row in members(stages) if row.name not in OWN]
    return {f"{'gains' if row.name in gains else 'limits'}.{row.name}": row for row in rows}


def _field(name: str, key: str, row: Member) -> str:
    """A line of the plugin's table of parameters."""
    rules = [("false", "true")[bool(flag)] for flag in (row.rule & INFINITE, not row.rule & NOT_NEGATIVE)]
    return f'  {{"{key}", offsetof({name}_parameters, {row.name}), {row.values.size}, {", ".join(rules)}}},'


def _strings(words: Any) -> str:
    return "{" + ", ".join(json.dumps(word, ensure_ascii=False) for word in words) + "}"


def _filled(file: str, words: Mapping[str, Any]) -> str:
    return _Text((SOURCES / file).read_text(encoding="utf-8")).substitute(words)

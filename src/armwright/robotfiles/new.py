"""A robot file to fill in: geometry and masses of another file, or none, and "TODO" for every key that the drives need."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from armwright.description import RobotDescription, read_description
from armwright.description.drive import COMMAND_NEEDS
from armwright.description.todo import TODO, todo_problems
from armwright.description.urdf.reader import UNUSED
from armwright.description.writer import for_folder, to_toml
from armwright.errors import DescriptionError, OutputError, check_known
from armwright.joint_kinds import KINDS, JointUnits
from armwright.output import check_destination, whole_file
from armwright.toml_text import TomlText

MOST_JOINTS = 100
EFFICIENCY = "gear_efficiency = 0.75  # if the gear's datasheet has it"
OPTIONAL = {  # lines to uncomment, by table and command
    "motor": {"voltage": (EFFICIENCY,), "current": (EFFICIENCY,)},
    "limits": {"voltage": ("current_a = 5.0  # the smaller of motor's and amplifier's",)},
}
TIP = f"""
[[frames]]
name = "tip"
link = "link{{k}}"
xyz_m = "{TODO}"
rpy_rad = [0, 0, 0]
"""
DATASHEET = f"""
[sources.datasheet]
kind = "datasheet"
text = "{TODO}"
"""
COMMANDED = {"voltage": ("voltage_v",), "current": ("current_a",), "torque": ()}  # limits that a command needs
INERTIA = ", ".join(f'{entry} = "{TODO}"' for entry in ("xx", "xy", "xz", "yy", "yz", "zz"))
JOINT = f"""
[[joints]]
name = "joint{{k}}"
type = "revolute"
parent = "{{parent}}"
child = "link{{k}}"
frame = {{{{ xyz_m = "{TODO}", rpy_rad = [0, 0, 0] }}}}
axis = "{TODO}"

[[links]]
name = "link{{k}}"
mass_kg = "{TODO}"
com_m = "{TODO}"
inertia_kg_m2 = {{{{ {INERTIA} }}}}
"""


def new_robot(
    path: str | os.PathLike[str],
    source: str | os.PathLike[str] | None = None,
    *,
    joints: int | None = None,
    command: str = "current",
    **reading: Any,
) -> tuple[str, ...]:
    """Writes a robot file to fill in; missing values are "TODO", each with a comment that says what is wanted.

    Args:
        path: of the TOML file, which must not exist.   source: a URDF, an MJCF or a TOML database, or a built-in name, whose
            geometry, masses and limits it has.   joints: number of revolute joints without a source.
        command: "voltage", "current" or "torque": the command that its drives take, which decides what they need.
        reading: what a URDF or an MJCF leaves open, as for `load`.
    Returns:
        notes: what was left out or doubtful in the source.
    Raises:
        DescriptionError: an invalid source, neither source nor joints.   OutputError: a file that is there.
    Example:
        >>> notes = aw.robotfiles.new_robot("own.toml", joints=2)
        >>> list(notes)  # nothing is doubtful without a source
        []
    """
    target = check_destination(path, (".toml",), read=(source,))
    if target.exists():
        raise OutputError(
            "is there already", file=target, expected="a new file; `armwright check` says what is to be done in it"
        )
    check_known(DescriptionError, command, COMMANDED, place="command")
    if (source is None) == (joints is None):
        what = "not beside a robot file" if source is not None else "missing"
        raise DescriptionError(what, place="joints", expected="a robot file to start from, or a number of joints")
    if source is None:
        if isinstance(joints, bool) or not isinstance(joints, int) or not 1 <= joints <= MOST_JOINTS:
            raise DescriptionError(place="joints", value=joints, expected=f"a whole number from 1 to {MOST_JOINTS}")
        text, notes, ratios = _empty(target.stem, joints), (), {}
    else:
        robot = read_description(source, **reading)
        text, notes = _written_for(robot, target.parent)
        ratios = {
            name: f'{{ value = {ratio!r}, source = "{robot.source}" }}' for name, ratio in robot.gear_ratios.items()
        }
    with whole_file(target) as temporary:
        temporary.write_text(_with_comments(_with_drives(text, command, ratios)), encoding="utf-8", newline="\n")
    return notes


def _empty(name: str, joints: int) -> str:
    """An arm of n joints of which nothing is known."""
    name = re.sub(r'[\s"\[\]\\]', "_", name)
    head = f'name = "{name}"\nsource = "datasheet"\ntip = "tip"\n'
    parents = ("base", *(f"link{k}" for k in range(1, joints)))
    bodies = (JOINT.format(k=k, parent=parent) for k, parent in enumerate(parents, 1))
    return "".join((head, *bodies, TIP.format(k=joints)))


def _written_for(robot: RobotDescription, folder: Path) -> tuple[str, tuple[str, ...]]:
    """The text of a description for another folder, and its remarks."""
    plain, lost = for_folder(robot.model_copy(update={"remarks": (), "built_from": None}), folder)
    doubts = (each for each in robot.remarks if UNUSED not in each)  # here the motor has its gear ratio
    return to_toml(plain, folder), (*doubts, *(f"left out: {each}" for each in lost))


def _with_drives(text: str, command: str, ratios: Mapping[str, str]) -> str:
    """The canonical text of a robot with TODO for all that its drives need and that is not there.

    Args:
        ratios: texts of gear ratios that are known, by joint.
    """
    blocks = re.split(r"\n(?=\[)", text.rstrip("\n") + "\n")
    about = (
        f'# Fill in each "{TODO}"; the comment beside it says what is wanted, and where a datasheet has it.\n'
        "# `armwright check` lists the lines that are left. What is equal in all joints may stand once, in tables\n"
        "# [defaults.motor] and [defaults.friction]; remove those keys from the joints then.\n"
    )
    head = about + "".join(line for line in blocks[0].splitlines(keepends=True) if not line.startswith("command = "))
    others = " or ".join(f'"{other}"' for other in COMMANDED if other != command)
    done = [head.rstrip("\n") + f'\ncommand = "{command}"  # of all joints; {others} may stand in a joint\n']
    if not any(block.startswith("[sources.datasheet]") for block in blocks):
        done.append(DATASHEET.lstrip("\n"))
    k = 1
    while k < len(blocks):
        block, k = blocks[k], k + 1
        if not block.startswith("[[joints]]"):
            done.append(block)
            continue
        tables = {"": "".join(line for line in block.splitlines(keepends=True) if not line.startswith("command = "))}
        while k < len(blocks) and blocks[k].startswith("[joints."):
            tables[blocks[k].partition("]")[0].removeprefix("[joints.")] = blocks[k]
            k += 1
        done += _joint(tables, command, ratios.get(tomllib.loads(block)["joints"][0]["name"]))
    return "\n".join(done)


def _joint(tables: dict[str, str], command: str, ratio: str | None) -> Iterator[str]:
    """The tables of a joint, those of its drive filled up; `ratio` is the text of its gear ratio, if known."""
    own = tables.pop("")
    yield own
    kind = next(kind for name, kind in KINDS.items() if f'type = "{name}"' in own)
    if kind.moves and "\nmimic = " not in own:
        for name, keys in _needed(kind.units, command).items():
            given = tables.get(name)
            lines = (given or f'[joints.{name}]\nsource = "datasheet"\n').rstrip("\n") + "\n"
            quoted = f'"{TODO}"' if given is None else f'{{ value = "{TODO}", source = "datasheet" }}'
            missing = [key for key in keys if f"\n{key} = " not in lines]
            is_known = name == "friction" and given is not None
            besides = [
                each for each in OPTIONAL.get(name, {}).get(command, ()) if f"\n{each.split()[0]} = " not in lines
            ]
            values = {"gear_ratio": ratio or quoted}
            tables[name] = lines + "".join(f"{key} = {values.get(key, quoted)}\n" for key in missing if not is_known)
            tables[name] += "".join(f"# {each}\n" for each in besides)
    yield from tables.values()


def _with_comments(text: str) -> str:
    """The text with a comment behind each TODO: what is wanted, its unit, and where a datasheet has it."""
    document, wanted = TomlText(text, ""), {}
    for problem in todo_problems(document.tables):
        wanted.setdefault(int(document.with_line(problem).line), problem)
    lines = text.split("\n")
    for line, problem in wanted.items():
        lines[line - 1] += f"  # {problem.expected}"
    return "\n".join(lines)


def _needed(units: JointUnits, command: str) -> dict[str, tuple[str, ...]]:
    """Keys of the drive of a joint, by table."""
    key = units.key
    dry = (key(f"coulomb_{side}", "torque") for side in ("positive", "negative"))
    limits = (key("position", "position"), key("velocity", "speed"), key("torque", "torque"))
    return {
        "motor": ("gear_ratio", "rotor_inertia_kg_m2", *reversed(COMMAND_NEEDS[command])),
        "friction": (key("viscous", "damping"), *dry),
        "limits": (*limits, *COMMANDED[command]),
    }

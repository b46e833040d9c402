"""The Manipulator Database: one TOML file a robot. [SwartzReport] calls its own by that name."""

from __future__ import annotations

import inspect
import os
from importlib import resources
from pathlib import Path
from typing import Any

from armwright.description.consistency import robot_problems
from armwright.description.readable import readable_robot
from armwright.description.robot import MASSLESS, RobotDescription
from armwright.description.todo import todo_problems
from armwright.description.toml_file import toml_tables
from armwright.errors import UNKNOWN_KEY, DescriptionError, check_known
from armwright.validation import validated

XML_ENDINGS = (".urdf", ".xml", ".mjcf", ".xacro")

OTHER_FILES = {"segments": ("motion", "plan"), "duration_s": ("scenario", "simulate"), "": ("log", "log")}  # by a key
LONGEST = 2000  # letters of a path
NAME_OR_PATH = "the name of a built-in arm, or the path of a TOML, URDF or MJCF file"


def builtin_names() -> list[str]:
    """Names of the arms that come with Armwright.

    Returns:
        names: what `load` takes, in alphabetical order.
    Example:
        >>> "ur5e" in aw.builtin_names()
        True
    """
    folder = resources.files("armwright.robots")
    names = (entry.name for entry in folder.iterdir() if entry.name.endswith(".toml"))
    return sorted(name.removesuffix(".toml") for name in names if name.count(".") == 1)  # cmu-dd.parts.toml is no arm


def read_description(
    name_or_path: str | os.PathLike[str], *, tip: str | None = None, **reading: Any
) -> RobotDescription:
    """The description of a built-in arm (by name), of a TOML database, a URDF or an MJCF (by path).

    A built-in name is that arm, whatever else in the working directory is called so; `./panda` is the file.

    Args:
        name_or_path: what to read.   tip: name of the frame or link that kinematics and wrench are about, in place of the file's.
        reading: options of `read_urdf` or `read_mjcf`, where it is such a file; of a TOML database `kinematics_only`.
    Raises:
        DescriptionError: no such robot, no such file, or an invalid file; one line that names file,
            place, value and what was expected.
    """
    robot = _read(name_or_path, reading)
    if tip is not None:
        names = [robot.base, *(each.name for each in (*robot.links, *robot.frames))]
        check_known(DescriptionError, tip, names, "no frame or link", place="tip", file=name_or_path)
        return robot.model_copy(update={"tip": tip})
    end = robot.end_of_chain if robot.tip is None and Path(name_or_path).suffix.lower() in XML_ENDINGS else None
    if end is None:
        return robot
    remark = f"no tip is named: it is {end!r}, the last link of the chain; tip = … names another frame or link"
    return robot.model_copy(update={"remarks": (*robot.remarks, remark)})


def _read(name_or_path: str | os.PathLike[str], reading: dict[str, Any]) -> RobotDescription:
    """The description as the file has it."""
    text = os.fspath(name_or_path) if isinstance(name_or_path, (str, os.PathLike)) else None
    if not isinstance(text, str):
        raise DescriptionError(place="robot", value=name_or_path, expected=NAME_OR_PATH)
    path, names = Path(text), builtin_names()
    if len(text) > LONGEST:
        raise DescriptionError(f"{len(text)} letters", place="robot", value=text, expected=NAME_OR_PATH)
    if text in names and (isinstance(name_or_path, str) or not os.path.exists(path)):
        _check_options(text, reading, ())
        with resources.as_file(resources.files("armwright.robots") / f"{text}.toml") as builtin:
            return read_toml(builtin)
    if path.suffix.lower() in XML_ENDINGS:
        return _read_xml_robot(path, reading)
    if text and (path.suffix == ".toml" or os.path.exists(path)):
        _check_options(text, reading, ("kinematics_only",))
        return read_toml(path, **reading)
    raise DescriptionError("not a built-in arm and not a file", place="robot", value=text, choices=names)


def _read_xml_robot(path: Path, reading: dict[str, Any]) -> RobotDescription:
    """A URDF or an MJCF, by what its first element is."""
    from armwright.description.xml_tree import read_xml

    root = read_xml(path)
    if root.tag == "mujoco":
        from armwright.description.mjcf import read_mjcf as read
    elif root.tag == "robot":
        from armwright.description.urdf import read_urdf as read
    else:
        raise root.error(expected="a URDF (<robot>) or an MJCF (<mujoco>)")
    _check_options(str(path), reading, tuple(inspect.signature(read).parameters)[1:])
    return read(path, **reading)


def _check_options(file: str, options: dict[str, Any], known: tuple[str, ...]) -> None:
    for option in options:
        if option not in known:
            raise DescriptionError("unknown option", place=option, choices=known, file=file)


def read_toml(path: Path, kinematics_only: bool = False) -> RobotDescription:
    """The description in a TOML database.

    Args:
        path: of the file.   kinematics_only: links that state no mass property are massless, with a remark; motors may lack
            the rotor's inertia, and the file a command.
    """
    with toml_tables(path, DescriptionError) as tables:
        if "robot" in tables and "joints" not in tables:
            kind, command = next(each for key, each in OTHER_FILES.items() if key in tables or not key)
            expected = f"a robot file; `armwright {command} {path}` takes a {kind}"
            raise DescriptionError(f"is a {kind}", place="robot", value=tables["robot"], expected=expected)
        tables = _with_servos(_with_defaults(tables, path), path)
        if kinematics_only:
            _without_masses(tables)
            _without_drives(tables)
        return parse(tables, str(path), folder=path.parent)


def _with_defaults(document: dict[str, Any], place: Any) -> dict[str, Any]:
    """The document with its default tables in its joints; their records are made only where a file has some."""
    if "defaults" not in document:
        return document
    from armwright.description.defaults import with_defaults

    return with_defaults(document, place)


def _with_servos(document: dict[str, Any], place: Any) -> dict[str, Any]:
    """The document with the library's tables for `servo = "NAME"` in joints; the library is read only where one is named."""
    joints = document.get("joints")
    if isinstance(joints, list) and any(isinstance(joint, dict) and "servo" in joint for joint in joints):
        from armwright.description.servos import with_servos

        return with_servos(document, place)
    return document


def _without_masses(document: dict[str, Any]) -> None:
    """Gives links that state no mass property, or have no table, none at all: 0, with a remark."""
    joints, links = document.get("joints"), document.setdefault("links", [])
    if not isinstance(joints, list) or not isinstance(links, list):
        return  # refused for that
    tables = [link for link in links if isinstance(link, dict)]
    known = {link.get("name") for link in tables}
    children = [joint.get("child") for joint in joints if isinstance(joint, dict)]
    missing = [{"name": name} for name in children if isinstance(name, str) and name not in known]
    links += missing
    bare = [link for link in (*tables, *missing) if not MASSLESS.keys() & link.keys()]
    for link in bare:
        link.update(MASSLESS)
    if bare:
        names = ", ".join(repr(link.get("name")) for link in bare)
        text = f"links {names}: no mass properties are known: kinematics only, dynamics are refused"
        document["remarks"] = [*document.get("remarks", ()), text]
        document["without_masses"] = [link.get("name") for link in bare]


def _without_drives(document: dict[str, Any]) -> None:
    """Gives motors that state no rotor's inertia none, and a file without a command torques, with remarks."""
    joints, remarks = document.get("joints"), []
    tables = [joint for joint in joints if isinstance(joint, dict)] if isinstance(joints, list) else []
    if "command" not in document and any("command" not in joint for joint in tables):
        document["command"] = "torque"
        remarks.append("no command is stated: kinematics only, joints take torques")
    motors = {joint.get("name"): joint["motor"] for joint in tables if isinstance(joint.get("motor"), dict)}
    bare = [name for name, motor in motors.items() if "rotor_inertia_kg_m2" not in motor]
    for name in bare:
        motors[name]["rotor_inertia_kg_m2"] = {"value": 0.0, "source": "definition"}
    if bare:
        names = ", ".join(map(repr, bare))
        remarks.append(f"motors of {names}: no rotor inertia is known: kinematics only")
    if remarks:
        document["remarks"] = [*document.get("remarks", ()), *remarks]


def parse(data: dict[str, Any], place: str, folder: Path | None = None) -> RobotDescription:
    """The description in a parsed TOML document.

    Args:
        data: the document.   place: its file, for errors.   folder: where the paths of meshes start, and stay.
    """
    data = _with_servos(_with_defaults(data, place), place)
    left = {problem.place: problem.within(file=place) for problem in todo_problems(data)}
    try:
        robot = validated(RobotDescription, data, file=place, folder=folder)
    except DescriptionError as refused:
        error = refused
        if left:  # whatever else was said of these values
            for each in error.problems:
                if each.what == UNKNOWN_KEY:
                    left.pop(each.place, None)
            found = [each for each in error.problems if not each.place.startswith(tuple(left))]
            error = DescriptionError.of(*left.values(), *found)
        known = {problem.place for problem in error.problems}
        further = [problem.within(file=place) for problem in robot_problems(*readable_robot(data, folder))]
        raise error.joined(*(problem for problem in further if problem.place not in known)) from None
    if left:
        raise DescriptionError.of(*left.values())
    return robot

"""From a name or a file to an arm."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from armwright.description import RobotDescription, builtin_names, read_description
from armwright.description.readable import readable_robot
from armwright.description.toml_file import read_text
from armwright.errors import DescriptionError
from armwright.lint.feasibility import body_problems
from armwright.model.model import Model, build_model
from armwright.toml_text import TomlText


def load(
    name_or_path: str | os.PathLike[str],
    *,
    tip: str | None = None,
    drive: str | os.PathLike[str] | None = None,
    meshes: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] | None = None,
    on_impossible: Literal["error", "warn"] = "error",
    kinematics_only: bool = False,
    **reading: Any,
) -> Model:
    """An arm, from a built-in name such as "cmu-dd" or the path of a TOML database, a URDF or an MJCF.

    Args:
        name_or_path: what to load.
        tip: name of the frame or link that kinematics and wrench are about, in place of the file's.
        drive: of a URDF or an MJCF, the TOML file of its motors, gears and friction; by default NAME.drive.toml beside it.
        meshes: of a URDF, the folder or folders where its meshes lie, if not where the file says.
        on_impossible: "error" refuses links whose mass properties no real body can have, "warn" loads them with a warning.
        kinematics_only: True takes a TOML database whose links state no mass properties, with a warning; what needs masses
            refuses it. A URDF may leave them out anyway.
        reading: what a URDF or an MJCF leaves open, as `read_urdf` and `read_mjcf` have it: packages, smoothing,
            mimic, ignore.
    Returns:
        arm: frozen; `arm.description` keeps the record that it was built from.
    Raises:
        DescriptionError: no such robot, or an invalid file.
    Example:
        >>> arm = aw.load("ur5e")
        >>> print(arm.n, arm.names[0])
        6 shoulder_pan_joint
    """
    reading |= {key: value for key, value in (("tip", tip), ("drive", drive), ("meshes", meshes)) if value is not None}
    if kinematics_only and Path(name_or_path).suffix == ".toml":
        reading["kinematics_only"] = True
    description = described(name_or_path, **reading)
    model = built(description, name_or_path, on_impossible)
    builtin = name_or_path if isinstance(name_or_path, str) and name_or_path in builtin_names() else None
    warnings = (*model.warnings, *outdated(description, Path(name_or_path)))
    return replace(model, warnings=warnings, file=builtin or os.path.abspath(name_or_path))


def described(name_or_path: str | os.PathLike[str], **reading: Any) -> RobotDescription:
    """The description of a file or a built-in arm.

    Raises:
        DescriptionError: as `read_description`; of a TOML database that is refused, with the impossible links in it.
    """
    try:
        return read_description(name_or_path, **reading)
    except DescriptionError as error:
        path = Path(name_or_path) if isinstance(name_or_path, (str, os.PathLike)) else Path()
        if path.suffix != ".toml" or error.problems[0].line == math.inf:
            raise
        text = TomlText(read_text(path), path)
        robot, _ = readable_robot(text.tables, path.parent)
        raise error.joined(*map(text.with_line, body_problems(robot))) from None


def built(description: RobotDescription, name_or_path: str | os.PathLike[str], on_impossible: str) -> Model:
    """The model of a description that was read from a file.

    Raises:
        DescriptionError: as `build_model`, with the file and, of a TOML database, the lines.
    """
    try:
        return build_model(description, on_impossible=on_impossible)
    except DescriptionError as error:  # it knows the robot, not the file
        path = Path(name_or_path)
        known = error.within(file=path)
        raise TomlText(read_text(path), path).located(known) if path.suffix == ".toml" else known from None


def outdated(description: RobotDescription, path: Path) -> list[str]:
    """A warning, where the parts or modules beside a file are not those that it was built from."""
    if description.built_from is None or not os.path.isfile(path):
        return []
    changed = description.built_from.changed(path.parent)
    return [
        f"{path}: older than {name}, which has changed since it was built from it; build it again" for name in changed
    ]

"""From a name or a file to an arm."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from armwright.description import RobotDescription, read_description
from armwright.errors import DescriptionError
from armwright.model.model import Model, build_model


def load(
    name_or_path: str | os.PathLike[str], *, on_impossible: str = "error", kinematics_only: bool = False, **reading: Any
) -> Model:
    """An arm, from a built-in name such as "cmu-dd" or the path of a TOML database, a URDF or an MJCF.

    Args:
        name_or_path: what to load.
        on_impossible: "error" refuses links whose mass properties no real body can have, "warn" loads them with a warning.
        kinematics_only: True takes a TOML database whose links state no mass properties, with a warning; what needs masses
            refuses it. A URDF may leave them out anyway.
        reading: what a URDF or an MJCF leaves open, as `read_urdf` and `read_mjcf` have it: packages, drive, smoothing,
            mimic, ignore.
    Returns:
        arm: frozen; `arm.description` keeps the record that it was built from.
    Raises:
        DescriptionError: no such robot, or a file that cannot be believed.
    """
    if kinematics_only and Path(name_or_path).suffix == ".toml":
        reading["kinematics_only"] = True
    description = read_description(name_or_path, **reading)
    try:
        model = build_model(description, on_impossible=on_impossible)
    except DescriptionError as error:  # it knows the robot, not the file
        raise error.within(file=os.fspath(name_or_path)) from None
    return replace(model, warnings=(*model.warnings, *outdated(description, Path(name_or_path))))


def outdated(description: RobotDescription, path: Path) -> list[str]:
    """A warning, where the parts or modules beside a file are not those that it was built from."""
    if description.built_from is None or not os.path.isfile(path):
        return []
    changed = description.built_from.changed(path.parent)
    return [
        f"{path}: older than {name}, which has changed since it was built from it; build it again" for name in changed
    ]

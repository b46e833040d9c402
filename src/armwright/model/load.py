"""From a name or a file to an arm."""

from __future__ import annotations

import os

from armwright.description import read_description
from armwright.errors import DescriptionError
from armwright.model.build import build_model
from armwright.model.model import Model


def load(name_or_path: str | os.PathLike[str], *, on_impossible: str = "error") -> Model:
    """An arm, from a built-in name such as "cmu-dd" or the path of a TOML database.

    Args:
        name_or_path: what to load.
        on_impossible: "error" refuses links whose mass properties no real body can have, "warn" loads them with a warning.
    Returns:
        arm: frozen; `arm.description` keeps the record that it was built from.
    Raises:
        DescriptionError: no such robot, or a file that cannot be believed.
    """
    description = read_description(name_or_path)
    try:
        return build_model(description, on_impossible=on_impossible)
    except DescriptionError as error:  # it knows the robot, not the file
        raise DescriptionError(f"{os.fspath(name_or_path)}: {error}") from None

"""The Manipulator Database: one TOML file a robot. [SwartzReport] calls its own by that name."""

from __future__ import annotations

import os
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import pydantic

from armwright.description.refusal import refusal
from armwright.description.robot import RobotDescription
from armwright.errors import DescriptionError, nearest


def builtin_names() -> list[str]:
    """Names of the arms that come with Armwright.

    Returns:
        names: what `load` takes, in alphabetical order.
    """
    folder = resources.files("armwright.robots")
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def read_description(name_or_path: str | os.PathLike[str]) -> RobotDescription:
    """The description of a built-in arm (by name) or of a TOML database (by path).

    A built-in name is that arm, whatever else in the working directory is called so; `./panda` is the file.

    Raises:
        DescriptionError: no such robot, no such file, or a file that cannot be believed; one line that names file,
            place, value and what was expected.
    """
    text = os.fspath(name_or_path) if isinstance(name_or_path, (str, os.PathLike)) else None
    if not isinstance(text, str):
        raise DescriptionError(f"{name_or_path!r}: expected the name of a built-in arm, or the path of a TOML file")
    path, names = Path(text), builtin_names()
    if text in names and (isinstance(name_or_path, str) or not path.exists()):
        with resources.as_file(resources.files("armwright.robots") / f"{text}.toml") as builtin:
            return read_toml(builtin)
    if text and (path.suffix == ".toml" or path.exists()):
        return read_toml(path)
    raise DescriptionError(f"no robot {text!r}: not a built-in arm and not a file; {nearest(text, names)}")


def read_toml(path: Path) -> RobotDescription:
    """The description in a TOML database."""
    try:
        with open(path, "rb") as file:
            data = tomllib.load(file)
    except FileNotFoundError:
        raise DescriptionError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise DescriptionError(f"{path}: a folder, expected a TOML file") from None
    except OSError as error:
        raise DescriptionError(f"{path}: cannot be read: {error.strerror}") from None
    except tomllib.TOMLDecodeError as error:
        raise DescriptionError(f"{path}: not TOML: {error}") from None
    except UnicodeDecodeError as error:
        raise DescriptionError(f"{path}: not TOML: byte {error.start} is no UTF-8 text") from None
    except (ValueError, RecursionError) as error:  # a number of a million digits, a list in a list in a list …
        raise DescriptionError(f"{path}: not TOML that can be read: {error}") from None
    return parse(data, str(path))


def parse(data: dict[str, Any], place: str) -> RobotDescription:
    """The description in a parsed TOML document; `place` is what errors call it."""
    try:
        return RobotDescription.model_validate(data)
    except pydantic.ValidationError as error:
        raise DescriptionError(f"{place}: {refusal(error, data, RobotDescription)}") from None

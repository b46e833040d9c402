"""TOML files, read whole."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from armwright.errors import DescriptionError
from armwright.quantity import Record
from armwright.reading import read_file
from armwright.validation import validated

Read = TypeVar("Read", bound=Record)

BOM = b"\xef\xbb\xbf"  # what some editors put before UTF-8


def read_text(path: Path) -> str:
    """The text of a TOML file.

    Raises:
        DescriptionError: no such file, or none in UTF-8.
    """
    content = read_file(path, "a TOML file", DescriptionError)
    if content.startswith(BOM):
        raise DescriptionError("not TOML: begins with a byte order mark (BOM)", expected="UTF-8 without", file=path)
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise DescriptionError(f"not TOML: byte {error.start} is no UTF-8 text", file=path) from None


def read_document(path: Path, text: str | None = None) -> dict[str, Any]:
    """The tables of a TOML file, unchecked.

    Args:
        path: of the file.   text: what is in it, where that was read before.
    Raises:
        DescriptionError: no such file, or no TOML.
    """
    try:
        return tomllib.loads(read_text(path) if text is None else text)
    except (ValueError, RecursionError) as error:  # no TOML, a number of a million digits, a list in a list in a list …
        raise DescriptionError(f"not TOML: {error}", file=path) from None


def read_record(path: Path, record: type[Read]) -> Read:
    """The record in a TOML file; paths of meshes start in the file's folder.

    Raises:
        DescriptionError: no such file, or one that is not valid.
    """
    return validated(record, read_document(path), file=path, folder=Path(path).parent)

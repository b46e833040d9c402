"""TOML files, read whole."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from armwright.errors import ArmwrightError, DescriptionError
from armwright.quantity import Record
from armwright.reading import read_file
from armwright.toml_text import TomlText
from armwright.validation import validated

Read = TypeVar("Read", bound=Record)

BOM = b"\xef\xbb\xbf"  # what some editors put before UTF-8


def read_text(path: Path, error: type[ArmwrightError] = DescriptionError) -> str:
    """The text of a TOML file.

    Args:
        path: of the file.   error: what is raised.
    Raises:
        error: no such file, or none in UTF-8.
    """
    content = read_file(path, "a TOML file", error)
    if content.startswith(BOM):
        raise error("not TOML: begins with a byte order mark (BOM)", expected="UTF-8 without", file=path)
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as fault:
        raise error(f"not TOML: byte {fault.start} is no UTF-8 text", file=path) from None


@contextmanager
def toml_tables(path: Path, error: type[ArmwrightError]) -> Iterator[dict[str, Any]]:
    """The tables of a TOML file, for a block that makes something of them.

    Errors of the block are raised with the lines of the file, beside all that is no TOML; see `TomlText`.

    Args:
        path: of the file.   error: what is raised where it cannot be read.
    Raises:
        error: no such file, or no TOML.   ArmwrightError: as the block raised it.
    """
    document = TomlText(read_text(path, error), path)
    with document.checked(error):
        yield document.tables


def read_record(path: Path, record: type[Read]) -> Read:
    """The record in a TOML file; paths of meshes start in the file's folder.

    Raises:
        DescriptionError: no such file, or one that is not valid.
    """
    with toml_tables(path, DescriptionError) as tables:
        return validated(record, tables, file=path, folder=Path(path).parent)

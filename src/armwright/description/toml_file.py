"""TOML files, read whole."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from armwright.errors import DescriptionError
from armwright.quantity import Record
from armwright.validation import validated

Read = TypeVar("Read", bound=Record)

BOM = b"\xef\xbb\xbf"  # what some editors put before UTF-8


def read_document(path: Path) -> dict[str, Any]:
    """The tables of a TOML file, unchecked.

    Raises:
        DescriptionError: no such file, or no TOML.
    """
    try:
        content = Path(path).read_bytes()
        if content.startswith(BOM):
            raise DescriptionError("not TOML: begins with a byte order mark (BOM)", expected="UTF-8 without", file=path)
        return tomllib.loads(content.decode("utf-8"))
    except FileNotFoundError:
        raise DescriptionError("no such file", file=path) from None
    except IsADirectoryError:
        raise DescriptionError("a folder", expected="a TOML file", file=path) from None
    except OSError as error:
        raise DescriptionError(f"cannot be read: {error.strerror}", file=path) from None
    except UnicodeDecodeError as error:
        raise DescriptionError(f"not TOML: byte {error.start} is no UTF-8 text", file=path) from None
    except (ValueError, RecursionError) as error:  # no TOML, a number of a million digits, a list in a list in a list …
        raise DescriptionError(f"not TOML: {error}", file=path) from None


def read_record(path: Path, record: type[Read]) -> Read:
    """The record in a TOML file; paths of meshes start in the file's folder.

    Raises:
        DescriptionError: no such file, or one that is not valid.
    """
    return validated(record, read_document(path), file=path, folder=Path(path).parent)

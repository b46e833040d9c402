"""Reading a Parts Database: `*.parts.toml`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from armwright.description.toml_file import read_document
from armwright.parts.records import PartsDatabase
from armwright.validation import validated


def read_parts(path: str | os.PathLike[str]) -> PartsDatabase:
    """The parts in a file.

    Args:
        path: of the file.
    Returns:
        database: validated; its meshes are read when they are weighed.
    Raises:
        DescriptionError: no such file, or one that cannot be believed; one line that names file, place, value and what
            was expected.
    """
    path = Path(path)
    return parse_parts(read_document(path), str(path), path.parent)


def parse_parts(data: dict[str, Any], place: str, folder: Path | None = None) -> PartsDatabase:
    """The parts in a parsed TOML document.

    Args:
        data: the document.   place: what errors call it.   folder: where the paths of meshes start, and stay.
    """
    return validated(PartsDatabase, data, file=place, folder=folder)

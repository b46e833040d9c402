"""TOML files as records: parts, modules, assemblies and tasks are all read in this way."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from armwright.description.toml_file import read_document
from armwright.quantity import Record
from armwright.validation import validated

Read = TypeVar("Read", bound=Record)


def read_record(path: Path, record: type[Read]) -> Read:
    """The record in a TOML file; paths of meshes start in the file's folder.

    Raises:
        DescriptionError: no such file, or one that is not valid.
    """
    return validated(record, read_document(path), file=path, folder=path.parent)

"""The file that a description was computed from, and whether that has changed since."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

from pydantic import Field

from armwright.description.quantity import Record

Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class BuiltFrom(Record):
    """The parts or modules that a description was computed from, as they were then."""

    file: str = Field(min_length=1, description="Path of the file, relative to this one's folder.")
    sha256: Sha256 = Field(description="Hash of its bytes, a line's end counted as one.")
    meshes: dict[str, Sha256] = Field(
        default_factory=dict, description="Hashes of the meshes that it names, by their paths."
    )

    def changed(self, folder: str | os.PathLike[str]) -> list[str]:
        """Which of the files are others by now, seen from that folder; one that is not there says nothing."""
        path = Path(folder) / self.file
        files = {self.file: (path, self.sha256), **{m: (path.parent / m, was) for m, was in self.meshes.items()}}
        return [name for name, (file, was) in files.items() if _hash(file) not in (was, None)]


def built_from(path: Path, meshes: Iterable[str] = (), folder: Path | None = None) -> BuiltFrom:
    """The record of a file as it is now.

    Args:
        path: the file.   meshes: paths of what else was read, relative to its folder.
        folder: where the description will stand; None: beside the file.
    """
    hashes = {name: _hash(path.parent / name) or "" for name in sorted(set(meshes))}
    name = path.name if folder is None else _relative(path, folder)
    return BuiltFrom(file=name, sha256=_hash(path) or "", meshes=hashes)


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:  # on another drive
        return path.resolve().as_posix()


def _hash(path: Path) -> str | None:
    try:
        content = path.read_bytes()
    except (OSError, ValueError):
        return None
    if path.suffix == ".toml":
        content = content.replace(b"\r\n", b"\n")  # as git may have it on Windows
    return hashlib.sha256(content).hexdigest()

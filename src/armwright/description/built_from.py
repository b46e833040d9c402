"""The file that a description was computed from, and whether that has changed since."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Annotated

from pydantic import Field

from armwright.errors import DescriptionError
from armwright.quantity import Record
from armwright.reading import read_file

BUILTIN = "armwright:"  # before the name of a file that comes with Armwright
Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class BuiltFrom(Record):
    """The parts or modules from which a description was computed, as they were at that time."""

    file: str = Field(
        min_length=1, description="Path of the file, relative to this one's folder; armwright:NAME comes with it."
    )
    sha256: Sha256 = Field(description="Hash of its bytes, a line's end counted as one.")
    meshes: dict[str, Sha256] = Field(
        default_factory=dict, description="Hashes of the meshes that it names, by their paths."
    )

    libraries: dict[str, Sha256] = Field(
        default_factory=dict, description="Hashes of the module libraries that it names, by their paths."
    )

    def changed(self, folder: str | os.PathLike[str]) -> list[str]:
        """Files that have changed, seen from that folder; absent files are left out."""
        files = {self.file: (Path(folder), self.sha256)}
        files |= {name: (self._beside(folder), was) for name, was in (*self.meshes.items(), *self.libraries.items())}
        return [name for name, (start, was) in files.items() if _hash_of(name, start) not in (was, None)]

    def texts(self, folder: str | os.PathLike[str]) -> dict[str, Path]:
        """Parts or assembly and libraries that do not come with Armwright, each with the folder that its path starts in.

        Args:
            folder: of the description's file.
        """
        files = {self.file: Path(folder), **dict.fromkeys(self.libraries, self._beside(folder))}
        return {name: start for name, start in files.items() if not name.startswith(BUILTIN)}

    def is_unchanged(self, name: str, text: str) -> bool:
        """True if one of `texts` is what it was then."""
        return _digest(text.encode("utf-8"), name) == {self.file: self.sha256, **self.libraries}[name]

    def _beside(self, folder: str | os.PathLike[str]) -> Path:
        """The folder that paths of meshes and libraries start in."""
        return Path(folder) if self.file.startswith(BUILTIN) else (Path(folder) / self.file).parent


def built_from(path: Path, meshes: Iterable[str] = (), folder: Path | None = None) -> BuiltFrom:
    """The record of a parts file as it is now.

    Args:
        path: the file.   meshes: paths of what else was read, relative to its folder.
        folder: where the description will stand; None: beside the file.
    Raises:
        DescriptionError: a mesh that is not there.
    """
    hashes = {}
    for mesh in sorted(set(meshes)):
        digest = _hash(path.parent / mesh)
        if digest is None:
            at = path.parent / mesh
            why = "a folder" if at.is_dir() else "cannot be read" if at.exists() else "no such file"
            raise DescriptionError(
                why, place="mesh", value=mesh, expected=f"a mesh file below {path.parent.as_posix()!r}"
            )
        hashes[mesh] = digest
    name = path.name if folder is None else _relative(path, folder)
    return BuiltFrom(file=name, sha256=_hash(path) or "", meshes=hashes)


def assembled_from(assembly: str | Path, libraries: Iterable[str | Path], folder: Path | None = None) -> BuiltFrom:
    """The record of an assembly and its libraries as they are now.

    Args:
        assembly, libraries: the paths of their files; where they come with Armwright, the name of the file in it.
        folder: where the description will stand; None: beside the assembly.
    """
    if isinstance(assembly, str):
        name, beside = f"{BUILTIN}{assembly}", Path(folder or ".")
    else:
        name, beside = assembly.name if folder is None else _relative(assembly, folder), assembly.parent
    names = [f"{BUILTIN}{one}" if isinstance(one, str) else _relative(one, beside) for one in libraries]
    hashes = {one: _hash_of(one, beside) or "" for one in sorted(set(names))}
    start = beside if folder is None else folder
    return BuiltFrom(file=name, sha256=_hash_of(name, start) or "", libraries=hashes)


def _hash_of(name: str, start: Path) -> str | None:
    """Of a file by its path from a folder, or of one that comes with Armwright."""
    if not name.startswith(BUILTIN):
        return _hash(start / name)
    with resources.as_file(resources.files("armwright.robots") / "modules" / name.removeprefix(BUILTIN)) as path:
        return _hash(path)


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:  # on another drive
        return path.resolve().as_posix()


def _hash(path: Path) -> str | None:
    try:
        content = read_file(path, "a file", DescriptionError)
    except DescriptionError:
        return None
    return _digest(content, path.name)


def _digest(content: bytes, name: str) -> str:
    if name.endswith(".toml"):
        content = content.replace(b"\r\n", b"\n")  # as git may have it on Windows
    return hashlib.sha256(content).hexdigest()

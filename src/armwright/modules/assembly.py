"""Reading of an assembly, `*.assembly.toml` (modules on connectors), and of the libraries it names."""

from __future__ import annotations

import os
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from armwright.description.built_from import BuiltFrom, assembled_from
from armwright.description.consistency import check_sources
from armwright.description.drive import Command
from armwright.description.robot import Name
from armwright.description.toml_file import Read, read_record
from armwright.errors import DescriptionError
from armwright.modules.library import ModuleLibrary
from armwright.quantity import Number, Record, Source, Vector3, optional
from armwright.reading import real_path
from armwright.validation import CONNECTOR

MODULES, ASSEMBLY = ".modules.toml", ".assembly.toml"
Place = Annotated[str, Field(pattern=CONNECTOR)]


class Placed(Record):
    """A module of an assembly, and the connector that carries it."""

    source: str | None = None
    module: Name = Field(description="Which module of the libraries it is.")
    name: Name | None = optional("Name here; absent: the module's.")
    on: Place | None = optional("The connector that carries it, NAME.CONNECTOR; absent only for the one on the ground.")
    by: Name | None = optional("Its own connector there; absent: the only one that fits, or the module's ground.")
    angle_rad: Number | None = optional(
        "How far it is turned about the carrying face's z axis; needed where there are steps."
    )

    @property
    def called(self) -> str:
        """Name in the assembly."""
        return self.name or self.module


class Assembly(Record):
    """An arm of modules."""

    name: Name = Field(description="Name of the arm.")
    title: str | None = optional("One line for the catalogue.")
    notes: str | None = optional("Notes for users, in a few sentences.")
    source: str | None = optional("Source of every number of this file that names none.")
    sources: dict[str, Source] = Field(default_factory=dict, description="[sources.KEY]: sources of numbers.")
    libraries: tuple[str, ...] = Field(
        min_length=1, description="Names of built-in libraries, or paths of *.modules.toml beside this file."
    )
    gravity_m_s2: Vector3 | None = optional("In base axes; absent: standard gravity along -z.")
    base: Name = Field(default="ground", description="Name of the ground as a parent of joints.")
    command: Command | None = optional("Command of the joints; absent: the libraries'.")
    tip: Place | None = optional("The free connector NAME.CONNECTOR that kinematics are about.")
    modules: tuple[Placed, ...] = Field(min_length=1, description="One table a module, from the ground outward.")
    limits: dict[Name, dict[str, Any]] = Field(
        default_factory=dict, description="[limits.JOINT]: limits that are narrower here than the module's own."
    )

    @model_validator(mode="after")
    def _sourced(self) -> Assembly:
        check_sources(self)
        return self


def library_names() -> list[str]:
    """Names of the module libraries that come with Armwright, in alphabetical order."""
    return _builtin(MODULES)


def assembly_names() -> list[str]:
    """Names of the assemblies that come with Armwright, in alphabetical order."""
    return _builtin(ASSEMBLY)


def read_modules(name_or_path: str | os.PathLike[str]) -> ModuleLibrary:
    """A module library, by the name of a built-in one or the path of a TOML file.

    Args:
        name_or_path: such as "improv" or "mine.modules.toml".
    Returns:
        library: its modules, each number with its source. Impossible bodies are refused when they are assembled.
    Raises:
        DescriptionError: no such library, or an invalid file.
    Example:
        >>> aw.modules.read_modules("improv").name
        'improv'
    """
    return _read(name_or_path, ModuleLibrary, MODULES, "module library")


def read_assembly(name_or_path: str | os.PathLike[str]) -> tuple[Assembly, list[ModuleLibrary]]:
    """An assembly and the libraries that it names, by the name of a built-in one or the path of a TOML file.

    Args:
        name_or_path: such as "lwa4p" or "mine.assembly.toml".
    Returns:
        assembly, libraries: what `assemble` takes; paths of libraries start where the assembly's file is.
    Raises:
        DescriptionError: no such file, or an invalid one.
    """
    assembly = _read(name_or_path, Assembly, ASSEMBLY, "assembly")
    try:
        places = _library_places(assembly, Path(name_or_path).parent)
    except DescriptionError as error:
        raise error.within(file=name_or_path) from None
    return assembly, [read_modules(place) for place in places]


def origin(name_or_path: str | os.PathLike[str], folder: str | os.PathLike[str] | None = None) -> BuiltFrom:
    """The files of an assembly and its libraries as they are now.

    Args:
        name_or_path: as `read_assembly` takes it.   folder: where the arm's file will stand; None: beside the assembly's.
    Raises:
        DescriptionError: as `read_assembly`.
    """
    assembly, beside = _read(name_or_path, Assembly, ASSEMBLY, "assembly"), Path(name_or_path).parent
    files = [_file(library, MODULES) for library in _library_places(assembly, beside)]
    return assembled_from(_file(name_or_path, ASSEMBLY), files, None if folder is None else Path(folder))


def _library_places(assembly: Assembly, beside: Path) -> list[str | Path]:
    """Names of built-in libraries, and paths of the others, which stay below the assembly's folder.

    Raises:
        DescriptionError: a path that leads out of it, or a name that is neither.
    """
    places: list[str | Path] = []
    for k, name in enumerate(assembly.libraries):
        at, path = f"libraries[{k}]", beside / name
        if name in library_names():
            places.append(name)
        elif "\0" in name or not real_path(path).is_relative_to(real_path(beside)):
            expected = "the name of a built-in library, or a path below it"
            raise DescriptionError(f"leads out of {os.fspath(beside)!r}", place=at, value=name, expected=expected)
        elif path.suffix != ".toml" and not os.path.exists(path):
            raise DescriptionError("neither built in nor a file", place=at, value=name, choices=library_names())
        else:
            places.append(path)
    return places


def _file(name_or_path: str | os.PathLike[str], ending: str) -> str | Path:
    """The file's name where it comes with Armwright, its path elsewhere."""
    path, name = Path(name_or_path), os.fspath(name_or_path).removesuffix(ending)
    builtin = name in _builtin(ending) and not (path.suffix == ".toml" and os.path.exists(path))
    return f"{name}{ending}" if builtin else path


def _builtin(ending: str) -> list[str]:
    folder = resources.files("armwright.robots") / "modules"
    return sorted(entry.name.removesuffix(ending) for entry in folder.iterdir() if entry.name.endswith(ending))


def _read(name_or_path: str | os.PathLike[str], record: type[Read], ending: str, kind: str) -> Read:
    text = os.fspath(name_or_path) if isinstance(name_or_path, (str, os.PathLike)) else None
    if not isinstance(text, str) or not text:
        raise DescriptionError(
            value=name_or_path, expected=f"the name of a built-in {kind}, or the path of a TOML file"
        )
    file = _file(text, ending)
    if isinstance(file, str):
        with resources.as_file(resources.files("armwright.robots") / "modules" / file) as builtin:
            return read_record(builtin, record)
    if file.suffix == ".toml" or os.path.exists(file):
        return read_record(file, record)
    raise DescriptionError("neither built in nor a file", place=kind, value=text, choices=_builtin(ending))

"""Path of a mesh that a robot file names: `package://NAME/…`, `file://…` or a path, and never outside the search path."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import unquote

from armwright.description.xml_tree import Element
from armwright.errors import DescriptionError
from armwright.reading import real_path

SCHEMES = ("package://", "model://")


def package_folders(file: Path, packages: Iterable[str | os.PathLike[str]] = ()) -> tuple[Path, ...]:
    """Folders in which packages are looked for: those given, ROS_PACKAGE_PATH, and the parents of the file.

    Args:
        file: the robot file.   given: folders that are packages, or that hold packages.
    Raises:
        DescriptionError: a given folder is none.
    """
    folders = []
    for folder in packages:
        if not Path(folder).is_dir():
            raise DescriptionError("no such folder", place="packages", value=os.fspath(folder))
        folders.append(Path(folder).resolve())
    named = [Path(folder) for folder in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if folder]
    return (*folders, *(folder.resolve() for folder in named if folder.is_dir()), *file.resolve().parents)


def mesh_folders(meshes: str | os.PathLike[str] | Iterable[str | os.PathLike[str]]) -> tuple[Path, ...]:
    """Folders where meshes lie, as the user named them.

    Raises:
        DescriptionError: one of them is no folder.
    """
    named = [meshes] if isinstance(meshes, (str, os.PathLike)) else list(meshes)
    for folder in named:
        if not isinstance(folder, (str, os.PathLike)) or not os.path.isdir(folder):
            raise DescriptionError("no such folder", place="meshes", value=folder)
    return tuple(real_path(Path(folder)) for folder in named)


def mesh_below(name: str, folders: tuple[Path, ...]) -> Path | None:
    """The file below one of the folders that matches the longest end of a mesh's path; None if absent.

    `package://ur/meshes/visual/base.stl` is ur/meshes/visual/base.stl, or else meshes/visual/base.stl, … or base.stl there.
    """
    parts = [part for part in unquote(name.rpartition("://")[2]).replace("\\", "/").split("/") if part not in ("", ".")]
    while parts[:1] == [".."]:  # ../meshes/base.stl: the folders named take the place of what that starts from
        del parts[0]
    if "\0" in name or ".." in parts:
        return None
    for k in range(len(parts)):
        for folder in folders:
            path = real_path(folder.joinpath(*parts[k:]))
            if path.is_relative_to(folder) and os.path.isfile(path):
                return path
    return None


def find_mesh(element: Element, name: str, file: Path, folders: tuple[Path, ...]) -> Path | None:
    """The file for a mesh `name`; None if absent. Nothing is opened.

    `package://P/rest` is `rest` below a folder on the search path that is called P, or below a P in one. Other paths start
    at the robot file's folder, and end below its package: the nearest parent with a package.xml, or else the next one.

    Raises:
        DescriptionError: a path that leads out, by `..`, links or from the root; another scheme.
    """
    if "\0" in name:
        raise element.error(value=name, expected="the path of a file")
    for scheme in SCHEMES:
        if name.startswith(scheme):
            # some write package:///NAME
            package, _, rest = unquote(name.removeprefix(scheme)).lstrip("/").partition("/")
            return _in_package(element, name, package, rest, _roots(package, file, folders))
    if name.startswith("file://"):
        name = unquote(name.removeprefix("file://"))
    elif "://" in name:
        raise element.error("nothing is fetched", value=name, expected="package://, file:// or a path")
    path = real_path(file.resolve().parent / name)
    if not any(
        path.is_relative_to(root) for root in (_package_of(file), *folders[: _count_of_searched(file, folders)])
    ):
        what = f"leads out of {str(_package_of(file))!r}"
        raise element.error(what, value=name, expected="a path below it, or packages = [FOLDER]")
    return path if os.path.isfile(path) else None


def _roots(package: str, file: Path, folders: tuple[Path, ...]) -> list[Path]:
    """Folders that may hold a package of that name: a folder called so, or one in a folder of packages.

    Of the file's parents only those below the home folder and the disk's top folders count, and as folders of packages only
    up to the one that the file's own package stands in.
    """
    searched, top = folders[: _count_of_searched(file, folders)], _package_of(file).parent
    parents = [folder for folder in folders[len(searched) :] if not _is_shared_folder(folder)]
    named = [folder for folder in (*searched, *parents) if folder.name == package]
    holding = [*searched, *(folder for folder in parents if folder.is_relative_to(top))]
    return [*named, *(folder / package for folder in holding)]


def _is_shared_folder(folder: Path) -> bool:
    """The disk, its top folders, the home folder and what that stands in: no packages."""
    home = real_path(Path.home())
    return folder.parent == folder.parent.parent or folder in (home, *home.parents)


def _in_package(element: Element, name: str, package: str, rest: str, roots: list[Path]) -> Path | None:
    if not package or package in (".", "..") or not rest:
        raise element.error(value=name, expected="package://NAME/path")
    for root in roots:
        path = real_path(root / rest)
        if not path.is_relative_to(real_path(root)):
            raise element.error(f"leads out of the package {package!r}", value=name, expected="a path below it")
        if os.path.isfile(path):
            return path
    return None


def _count_of_searched(file: Path, folders: tuple[Path, ...]) -> int:
    """Number of the folders that are not just parents of the file."""
    return len(folders) - len(file.resolve().parents)


def _package_of(file: Path) -> Path:
    parents = file.resolve().parents
    return next((folder for folder in parents if (folder / "package.xml").is_file()), parents[min(1, len(parents) - 1)])

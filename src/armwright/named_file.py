"""Files named by other files: paths relative to a folder and below it, or below one that the user allowed."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from armwright.errors import ArmwrightError

PERMITS = "permits another folder (in Python allow=[FOLDER])"


def named_file(
    name: str, folder: Path, allow: Iterable[str | os.PathLike[str]] = (), *, place: str, error: type[ArmwrightError]
) -> Path:
    """The path of the plain file that `name` means; nothing is opened.

    Args:
        name: as another file states it, relative to `folder`, or absolute.   folder: of that other file.
        allow: further folders that the user named.   place: of the name in that file.   error: what is raised.
    Raises:
        error: a path that leads out of all folders, by `..`, from the root or through links; or to no plain file.
    """
    path = _resolved(folder / name)
    roots = [_resolved(each) for each in (folder, *map(Path, allow))]
    if path is None:
        raise error("no path of a file", place=place, value=name)
    if not any(root is not None and path.is_relative_to(root) for root in roots):
        what = f"leads out of {os.fspath(roots[0] or folder)!r}"
        expected = f"a file below that folder; --allow {path.parent} {PERMITS}"
        raise error(what, place=place, value=name, expected=expected)
    if not os.path.isfile(path):  # which says False of a name too long; Path.is_file raises
        what = "a folder" if os.path.isdir(path) else "no plain file" if os.path.exists(path) else "no such file"
        raise error(what, place=place, value=name, expected=f"a file below {os.fspath(roots[0] or folder)!r}")
    return path


def _resolved(path: Path) -> Path | None:
    """The path without links; None for a loop of links, a name too long, or one with a null character."""
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError):
        return None

"""The example programs and files: their paths, their titles, and copies of them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

from armwright.entry import as_path
from armwright.errors import OutputError
from armwright.output import whole_file

HERE = Path(__file__).parent
FOLDERS = (HERE / "example_files", HERE.parents[1] / "examples")  # of an installed wheel, of a checkout
OF_LOGS = (".md", ".txt", ".json", ".parquet", ".urdf")  # rows, and whose they are
TITLES = {  # the first pattern that is found says what a file is
    ".py": (r'\A"""(.+)',),
    ".toml": (r'^title = "(.+)"', r"\A# (.+)"),
}


def example_files() -> dict[str, Path]:
    """Paths of the examples by their names within the folder of examples, in alphabetical order.

    Raises:
        OutputError: this installation has none.
    """
    folder = next((folder for folder in FOLDERS if (folder / "01_first_motion.py").is_file()), None)
    if folder is None:
        raise OutputError(
            "this installation has no examples", expected="a wheel of Armwright, or a checkout of its source"
        )
    return {path.relative_to(folder).as_posix(): path for path in sorted(_files(folder))}


def _files(folder: Path) -> Iterator[Path]:
    """Programs, robots, scenarios, motions, schedules and measured logs; not what runs have left beside them."""
    for path in folder.rglob("*"):
        is_log = folder / "logs" in path.parents and path.suffix in OF_LOGS
        if (path.suffix in (".py", ".toml", ".csv", ".ipynb") or is_log) and path.is_file():
            yield path


def example_title(path: Path) -> str:
    """First sentence of a program, or title of a file; empty if it has none."""
    patterns = TITLES.get(path.suffix, ())
    text = path.read_text(encoding="utf-8") if patterns else ""
    found = (re.search(pattern, text, re.MULTILINE) for pattern in patterns)
    return next((match[1].removesuffix('"""').strip() for match in found if match), "")


def copy_examples(folder: str | os.PathLike[str]) -> list[Path]:
    """Copies all examples into a folder, which is created if absent. No file is overwritten.

    Args:
        folder: where they go, with their folders below it.
    Returns:
        paths: of the copies.
    Raises:
        OutputError: one of the files is there already, or the folder cannot be written; nothing is copied then.
    Example:
        >>> len(aw.copy_examples("own")) > 50
        True
    """
    folder = as_path(folder, "folder", OutputError)
    sources = example_files()
    copies = {name: Path(folder) / name for name in sources}
    there = next((path for path in copies.values() if path.exists() or path.is_symlink()), None)
    if there is not None:
        raise OutputError("is there already, and is not overwritten", file=there, expected="a folder without it")
    for name, path in copies.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot be made: {error.strerror}", file=path.parent) from error
        with whole_file(path) as temporary:
            temporary.write_bytes(sources[name].read_bytes())
    return list(copies.values())

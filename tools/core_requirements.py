"""Print the part of `requirements.lock` that running Armwright needs, without the extras and the developers' tools.

The lock is one file for everything. uv notes below each entry what asked for it (`# via …`); walking those notes from
the project's own dependencies, and the build backend, gives the core. Standard library only: it runs before anything
is installed.
"""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def canonical(name: str) -> str:
    """The package's name as an index compares it: lower case, one dash between words (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def asked_for(pyproject: dict) -> set[str]:
    """Names in `project.dependencies` and `build-system.requires`."""
    wanted = pyproject["project"]["dependencies"] + pyproject["build-system"]["requires"]
    return {canonical(re.match(r"[\w.-]+", requirement)[0]) for requirement in wanted}


def entries(lock: str) -> list[tuple[str, set[str], str]]:
    """(name, what asked for it, text) of every entry; a package has several where versions differ by Python."""
    found = []
    for text in re.split(r"\n(?=\S)", lock):
        if named := re.match(r"([\w.-]+)==", text):
            notes = [note.removeprefix("via").strip() for note in re.findall(r"^ +# *(.*)$", text, re.MULTILINE)]
            found.append((canonical(named[1]), {canonical(note) for note in notes}, text))
    return found


def core(pyproject: dict, lock: str) -> list[str]:
    """The entries that the project's own dependencies and their dependencies name."""
    every = entries(lock)
    names = asked_for(pyproject)
    if missing := names - {name for name, _, _ in every}:
        raise SystemExit(f"requirements.lock: no entry for {', '.join(sorted(missing))}; run `make lock`")
    while more := {name for name, via, _ in every if via & names} - names:
        names |= more
    return [text for name, _, text in every if name in names]


if __name__ == "__main__":
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    lock = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    sys.stdout.write("\n".join(core(pyproject, lock)) + "\n")

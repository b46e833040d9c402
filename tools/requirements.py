"""Print a part of `requirements.lock`: what running Armwright needs, or what `make test` needs beside it.

    python tools/requirements.py core | test

The lock is one file for everything. uv notes below each entry what asked for it (`# via …`); walking those notes from the
names in `pyproject.toml` gives the part: the project's own dependencies and the build backend for `core`; for `test` also
the extras that add functions, and the group `test`. What only benchmarks, the docs, the checks and studies use is left out.
Standard library only: it runs before anything is installed.
"""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TESTED = ("identify", "control", "trajectory", "sweep", "meshes", "logs", "twin")  # extras that add functions


def canonical(name: str) -> str:
    """The package's name as an index compares it: lower case, one dash between words (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def asked_for(pyproject: dict, part: str) -> set[str]:
    """Names that a part begins with."""
    project = pyproject["project"]
    wanted = project["dependencies"] + pyproject["build-system"]["requires"]
    if part == "test":
        wanted += [each for extra in TESTED for each in project["optional-dependencies"][extra]]
        wanted += pyproject["dependency-groups"]["test"]
    return {canonical(re.match(r"[\w.-]+", requirement)[0]) for requirement in wanted}


def entries(lock: str) -> list[tuple[str, set[str], str]]:
    """(name, what asked for it, text) of every entry; a package has several where versions differ by Python."""
    found = []
    for text in re.split(r"\n(?=\S)", lock):
        if named := re.match(r"([\w.-]+)==", text):
            notes = [note.removeprefix("via").strip() for note in re.findall(r"^ +# *(.*)$", text, re.MULTILINE)]
            found.append((canonical(named[1]), {canonical(note) for note in notes}, text))
    return found


def part_of(lock: str, names: set[str]) -> list[str]:
    """The entries of those names and of all that they ask for."""
    every = entries(lock)
    if missing := names - {name for name, _, _ in every}:
        raise SystemExit(f"requirements.lock: no entry for {', '.join(sorted(missing))}; run `make lock`")
    while more := {name for name, via, _ in every if via & names} - names:
        names |= more
    return [text for name, _, text in every if name in names]


if __name__ == "__main__":
    if sys.argv[1:] not in (["core"], ["test"]):
        raise SystemExit("expected one word: core or test")
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    lock = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    sys.stdout.write("\n".join(part_of(lock, asked_for(pyproject, sys.argv[1]))) + "\n")

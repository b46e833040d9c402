"""Recomputes what is frozen and compares:  PYTHONPATH=tests python -m frozen [PART ...] [--write] [--target LEVEL]"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from frozen import numbers
from frozen.records import FILE, computed, differences, frozen

PARTS = ("programs", "runs")


def main() -> int:
    """Exit status 1 where something differs; with --write it becomes what is frozen."""
    options = argparse.ArgumentParser(prog="frozen", description=__doc__)
    options.add_argument(
        "parts", nargs="*", metavar="PART", help=f"of {', '.join((*PARTS, *numbers.ROOMS))}; default: all"
    )
    options.add_argument("--write", action="store_true", help="freeze what is computed now")
    options.add_argument("--target", help="processor level to compile for, such as x86-64-v3")
    chosen = options.parse_args()
    if unknown := {*chosen.parts} - {*PARTS, *numbers.ROOMS}:
        options.error(f"no part {', '.join(sorted(unknown))}")
    changed = 0
    if not chosen.parts or {*chosen.parts} & {*PARTS}:
        changed += _bits(chosen.target, chosen.write)
    for room in numbers.ROOMS:
        if not chosen.parts or room in chosen.parts:
            changed += _numbers(room, chosen.write)
    return int(changed > 0 and not chosen.write)


def _bits(target: str | None, write: bool) -> int:
    """Programs and runs: how many differ."""
    kept = frozen() if FILE.exists() else {part: {} for part in PARTS}
    found: dict[str, dict[str, Any]] = {part: {} for part in PARTS}
    changed = 0
    for part, name, digests in computed(target):
        found[part][name] = digests
        changed += _said(f"{part}: {name}", differences(kept[part].get(name, {}), digests))
    for part in found:
        changed += sum(
            _said(f"{part}: {name}", ["no longer computed"]) for name in kept[part].keys() - found[part].keys()
        )
    text = json.dumps(found, indent=1, sort_keys=True) + "\n"
    return _end(FILE, text if write else "", changed, sum(map(len, found.values())))


def _numbers(room: str, write: bool) -> int:
    """Cases of a room: how many differ. What is as before keeps its digits."""
    kept, found = numbers.kept(room), {}
    changed = 0
    for name, case in numbers.cases(room).items():
        with tempfile.TemporaryDirectory() as folder:
            now = numbers.computed(room, name, Path(folder))
        lines = numbers.differing(kept.get(name, {}), now, case.close)
        found[name] = now if lines else kept[name]
        changed += _said(f"{room}: {name}", lines)
    changed += sum(_said(f"{room}: {name}", ["no longer computed"]) for name in kept.keys() - found.keys())
    return _end(numbers.FOLDER / f"{room}.json", numbers.as_text(found) if write else "", changed, len(found))


def _said(name: str, differing: list[str]) -> int:
    if differing:
        print(f"{name}: {', '.join(differing[:20])}")
    return bool(differing)


def _end(path: Path, text: str, changed: int, count: int) -> int:
    """Says how many differ, and writes the text, if there is any."""
    print(f"{changed} of {count} differ from {path.name}")
    if text:
        path.write_text(text, encoding="utf-8")
    return changed


if __name__ == "__main__":
    sys.exit(main())

"""`make bench`: what Armwright does in a nanosecond, beside its peers in the same minutes. One command, one report.

python benchmarks/run.py [--quick] [--only WORDS] [--save [FOLDER]]
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import os
import sys
from pathlib import Path
from typing import Any

from machine import described
from plots import IMAGES, draw
from readme import update
from records import Record, Task
from report import CHAPTERS, Saved, markdown, show
from rich.console import Console
from rich.progress import Progress

MODULES = (
    "rows_kernels",
    "rows_variants",
    "rows_simulation",
    "rows_auto",
    "rows_stiff",
    "rows_control",
    "rows_identification",
    "rows_ik",
    "rows_planning",
    "rows_scaling",
    "rows_start",
)
PEERS = {"pinocchio": "pin", "mujoco": "mujoco"}  # whose results ours are checked against
RESULTS = Path(__file__).with_name("results")
REPETITIONS, QUICK_REPETITIONS = 11, 1


def main(arguments: list[str] | None = None) -> int:
    options = parsed(arguments)
    lacking = [package for module, package in PEERS.items() if importlib.util.find_spec(module) is None]
    if lacking:
        print(f"the peers check every row, and are not installed: pip install {' '.join(lacking)}", file=sys.stderr)
        return 2
    saved = measured(options.quick, options.only or "")
    if not any(chapter["rows"] for chapter in saved["chapters"].values()):
        print(f"--only {options.only!r}: no row has these words; --list tells them all", file=sys.stderr)
        return 2
    show(saved, Console(width=None if sys.stdout.isatty() else 320))
    failed = [row for chapter in saved["chapters"].values() for row in chapter["rows"] if not row["checked"]]
    for row in failed:
        print(f"FAILED its check: {row['labels']}", file=sys.stderr)
    if failed:
        return 1
    if options.save is not None:
        paths = save(saved, options.save or RESULTS, options.save or IMAGES)
        for path in paths if options.save else [*paths, update(saved)]:
            print(f"saved {path}")
    return 0


def parsed(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Times Armwright beside Pinocchio and MuJoCo; every result is checked first."
    )
    parser.add_argument(
        "--quick", action="store_true", help="a smoke run: few repetitions, small work, no C++ compiled"
    )
    parser.add_argument(
        "--only", metavar="WORDS", help='only rows whose title has all of these words: "puma560 inverse"'
    )
    parser.add_argument("--list", action="store_true", help="print the titles of all rows and stop")
    parser.add_argument(
        *("--save",),
        metavar="FOLDER",
        nargs="?",
        const=Path(),
        type=Path,
        help="keep tables and pictures there; without a folder: in benchmarks/results, docs/images and the README",
    )
    options = parser.parse_args(arguments)
    if options.list:
        for task, _ in tasks(options.quick):
            print(f"{task.chapter}: {task.title}")
        parser.exit()
    if options.save == Path():
        options.save = False
        if options.quick or options.only:
            parser.error("--save without a folder keeps the whole run that the docs show: not with --quick or --only")
    return options


def tasks(quick: bool) -> list[tuple[Task, Any]]:
    """Every task, and the module that it is from."""
    modules = [importlib.import_module(name) for name in MODULES]
    return [(task, module) for module in modules for task in module.tasks(quick)]


def measured(quick: bool, only: str) -> Saved:
    """Runs the tasks whose title has all the words, and tells what came out of it."""
    wanted = [(task, module) for task, module in tasks(quick) if all(word in task.title for word in only.split())]
    repetitions = QUICK_REPETITIONS if quick else REPETITIONS
    chapters: dict[str, dict[str, list[Any]]] = {chapter: {"rows": [], "notes": []} for chapter in CHAPTERS}
    machine = described()
    notes = {module: module.notes(quick) for module in dict.fromkeys(module for _, module in wanted)}
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task("racing", total=len(wanted))
        for task, module in wanted:
            progress.update(bar, description=task.title)
            if not console.is_terminal:
                console.print(task.title, highlight=False)  # a log tells how far it came
            rows: list[Record] = task.run(repetitions)
            chapters[task.chapter]["rows"] += rows
            chapters[task.chapter]["notes"] = notes[module][task.chapter]
            progress.advance(bar)
    return {"machine": machine, "repetitions": repetitions, "quick": quick, "chapters": chapters}


def save(saved: Saved, results: Path, images: Path) -> list[Path]:
    """JSON, Markdown and pictures; each file is whole or not there."""
    machine = saved["machine"]
    words = "".join(c if c.isalnum() else " " for c in f"{machine['processor']} {machine['cpu']}").lower().split()
    stem = "-".join([machine["date"], *words])
    results.mkdir(parents=True, exist_ok=True)
    texts = {".json": as_json(saved), ".md": markdown(saved)}
    paths = []
    for suffix, text in texts.items():
        path = results / f"{stem}{suffix}"
        part = path.with_name(path.name + ".part")
        part.write_text(text, encoding="utf-8")
        os.replace(part, path)
        paths.append(path)
    return [*paths, *draw(saved, images)]


def as_json(saved: Saved) -> str:
    """One row a line, so that two results can be compared line by line."""

    def text(value: Any) -> str:
        return json.dumps(value, ensure_ascii=False, allow_nan=False)

    def lines(values: list[Any]) -> str:
        return "[" + ",".join(f"\n  {text(value)}" for value in values) + "]"

    chapters = [
        f'{text(name)}: {{"notes": {lines(chapter["notes"])},\n "rows": {lines(chapter["rows"])}}}'
        for name, chapter in saved["chapters"].items()
    ]
    head = text({key: value for key, value in saved.items() if key != "chapters"})
    return head[:-1] + ', "chapters": {\n' + ",\n".join(chapters) + "\n}}\n"


if __name__ == "__main__":
    sys.exit(main())

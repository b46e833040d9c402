"""`make bench`: what Armwright does in a nanosecond, beside its peers in the same minutes. One command, one report.

python benchmarks/run.py [--quick] [--only WORDS] [--chapters NAME …] [--save [FOLDER]] [--million]
"""

from __future__ import annotations

import argparse
import importlib
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
    "rows_calls",
    "rows_variants",
    "rows_simulation",
    "rows_auto",
    "rows_stiff",
    "rows_control",
    "rows_closed_loops",
    "rows_identification",
    "rows_ik",
    "rows_planning",
    "rows_scaling",
    "rows_between",
    "rows_large",
    "rows_start",
)
OF_GPU = ("rows_gpu",)  # alone where nothing else is asked for: a machine with a GPU may have no peers
PEERS = {"pinocchio": "pin", "mujoco": "mujoco"}  # whose results ours are checked against
RESULTS = Path(__file__).with_name("results")
REPETITIONS, QUICK_REPETITIONS = 11, 1


def main(arguments: list[str] | None = None) -> int:
    options = parsed(arguments)
    lacking = [] if options.chapters == ["gpu"] else missing_peers()
    if lacking:
        print(f"the peers check every row: {'; '.join(lacking)}", file=sys.stderr)
        return 2
    if options.chapters and options.save is False and newest_of_this(described(), RESULTS) is None:
        print(
            f"{RESULTS}: no result of this processor to put chapters into; make bench ARGS=--save first",
            file=sys.stderr,
        )
        return 2
    saved = measured(
        options.quick, options.only or "", chapters=options.chapters or [*CHAPTERS], million=options.million
    )
    if not any(chapter["rows"] for chapter in saved["chapters"].values()):
        why = f"no row has the words {options.only!r}; --list tells them all" if options.only else "there is no row"
        print(f"{why}: nothing is timed", file=sys.stderr)
        return 2
    show(saved, Console(width=None if sys.stdout.isatty() else 320))
    failed = [row for chapter in saved["chapters"].values() for row in chapter["rows"] if not row["checked"]]
    for row in failed:
        print(f"FAILED its check: {row['labels']}", file=sys.stderr)
    if failed:
        return 1
    if options.chapters and options.save is False:
        saved = merged(saved, RESULTS)
    if options.save is not None:
        paths = save(saved, options.save or RESULTS, options.save or IMAGES)
        for path in paths if options.save else [*paths, update(saved)]:
            print(f"saved {path}")
    return 0


def missing_peers() -> list[str]:
    """Of each peer that cannot be imported: why, and what installs it."""
    missing = []
    for module, package in PEERS.items():
        try:
            importlib.import_module(module)
        except ImportError as error:  # or a library of the system that it needs
            missing.append(f"{error} (pip install {package})")
    return missing


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
    parser.add_argument(
        "--million", action="store_true", help="nothing but a million closed loops, and what makes them up"
    )
    parser.add_argument(
        *("--chapters",),
        metavar="NAME",
        nargs="+",
        choices=[*CHAPTERS],
        help=f"only whole chapters, of {', '.join(CHAPTERS)}; with --save they take the place of those in the newest result of "
        "this processor, with their own date and commit",
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
    if options.million:
        options.only = options.only or "closed loops"
    if options.list:
        for task, _ in tasks(options.quick, million=options.million):
            print(f"{task.chapter}: {task.title}")
        parser.exit()
    if options.save == Path():
        options.save = False
        if options.quick or options.only:
            parser.error("--save without a folder keeps the whole run that the docs show: not with --quick or --only")
    return options


def tasks(quick: bool, *, million: bool = False, names: tuple[str, ...] = MODULES + OF_GPU) -> list[tuple[Task, Any]]:
    """Every task of some modules, and its module; those of a million only where they are asked for: they take minutes."""
    modules = [importlib.import_module(name) for name in names]
    found = [(task, module) for module in modules for task in module.tasks(quick)]
    if million:
        found += [
            (task, module)
            for module in modules
            if hasattr(module, "million_tasks")
            for task in module.million_tasks(quick)
        ]
    return found


def measured(quick: bool, only: str, *, chapters: list[str], million: bool = False) -> Saved:
    """Runs the tasks of some chapters whose title has all the words, and tells what came out of it."""
    names = OF_GPU if chapters == ["gpu"] else MODULES + OF_GPU if "gpu" in chapters else MODULES
    found = [pair for pair in tasks(quick, million=million, names=names) if pair[0].chapter in chapters]
    wanted = [(task, module) for task, module in found if all(word in task.title for word in only.split())]
    repetitions = QUICK_REPETITIONS if quick else REPETITIONS
    filled: dict[str, dict[str, list[Any]]] = {chapter: {"rows": [], "notes": []} for chapter in CHAPTERS}
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
            filled[task.chapter]["rows"] += rows
            filled[task.chapter]["notes"] = notes[module][task.chapter]
            progress.advance(bar)
    return {"machine": machine, "repetitions": repetitions, "quick": quick, "chapters": filled}


SAME = ("processor", "cpu", "width", "processors")  # of two machines whose times may stand in one result


def newest_of_this(machine: Record, results: Path) -> Saved | None:
    """The newest saved result of this machine's kind."""
    for path in sorted(results.glob("*.json"), reverse=True):
        saved = json.loads(path.read_text(encoding="utf-8"))
        if all(saved["machine"][key] == machine[key] for key in SAME):
            return saved
    return None


def merged(saved: Saved, results: Path) -> Saved:
    """The newest saved result of this machine's kind with these chapters, which say when and of what commit they are."""
    whole = newest_of_this(saved["machine"], results)
    assert whole is not None
    about = {"machine": saved["machine"], "repetitions": saved["repetitions"]}
    ours = {name: chapter | about for name, chapter in saved["chapters"].items() if chapter["rows"]}
    chapters = whole["chapters"] | ours
    return whole | {"chapters": {name: chapters[name] for name in CHAPTERS if name in chapters}}


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

    def one(chapter: dict[str, Any]) -> str:
        """Notes and rows, and what else a chapter of another day says of itself."""
        others = "".join(f"{text(key)}: {text(chapter[key])},\n " for key in chapter if key not in ("notes", "rows"))
        return f'{{{others}"notes": {lines(chapter["notes"])},\n "rows": {lines(chapter["rows"])}}}'

    chapters = [f"{text(name)}: {one(chapter)}" for name, chapter in saved["chapters"].items()]
    head = text({key: value for key, value in saved.items() if key != "chapters"})
    return head[:-1] + ', "chapters": {\n' + ",\n".join(chapters) + "\n}}\n"


if __name__ == "__main__":
    sys.exit(main())

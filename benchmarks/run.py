"""`make bench`: what Armwright does in a nanosecond, beside its peers in the same minutes. One command, one table.

python benchmarks/run.py [--quick] [--save]
"""

from __future__ import annotations

import argparse
import datetime
import importlib.util
import platform
import sys
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from timing import Pair, Row, Timing, race

CHAPTERS = {
    "rows_kernels": ("kernel_pairs", "pinocchio", "pin"),
    "rows_simulation": ("simulation_pairs", "mujoco", "mujoco"),
}
RESULTS = Path(__file__).with_name("results")
COLUMNS = ("work", "ours", "ns", "peer", "ns", "ratio", "at best", "expected", "error")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description="Times Armwright beside Pinocchio and MuJoCo; every result is checked first."
    )
    parser.add_argument(
        "--quick", action="store_true", help="a smoke run: few repetitions, small simulations, no C++ compiled"
    )
    parser.add_argument(
        "--save", action="store_true", help="write the table to benchmarks/results/<date>-<processor>.md as well"
    )
    options = parser.parse_args(arguments)
    repetitions = 3 if options.quick else 11
    races, notes = chapters(options.quick)
    if options.quick:  # too small and too short to expect anything of
        races = [[replace(pair, expected=None) for pair in pairs] for pairs in races]
    rows: list[Row] = []
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        for pairs in progress.track(races, description="racing"):
            rows += race(pairs, repetitions)
    heading = f"{processor()}, Python {platform.python_version()}, {datetime.date.today().isoformat()}"
    notes += [
        f"ns per state or step: median of {repetitions} samples taken in turns (the least in brackets); "
        "ratio: median of neighbouring samples, peer over ours; at best: of the two least",
    ]
    show(heading, rows, notes)
    if options.save:
        print(f"saved {save(heading, rows, notes)}")
    return 0 if all(row.checked for row in rows) else 1


def chapters(quick: bool) -> tuple[list[list[Pair]], list[str]]:
    """The races of all chapters whose peer is installed, and notes; a chapter without its peer has no check, so no rows."""
    races, notes = [], []
    for module, (function, peer, package) in CHAPTERS.items():
        if importlib.util.find_spec(peer) is None:
            notes.append(f"no rows beside {peer}, which is not installed: pip install {package}")
            continue
        more_races, more_notes = getattr(importlib.import_module(module), function)(quick)
        races += more_races
        notes += more_notes
    return races, notes


def cells(row: Row) -> list[str]:
    """A row as text; a failed check stands in place of the time."""
    pair = row.pair
    expected = (
        ""
        if pair.expected is None
        else f"≥ {pair.expected:g} {'✓' if row.checked and row.ratio >= pair.expected else '✗'}"
    )
    ratio, best = (f"{row.ratio:.1f}", f"{row.ratio_at_best:.1f}") if row.checked else ("", "")
    checks = [row.ours.check, row.peer.check]
    worst = max(checks, key=lambda check: check.error / check.tolerance if check.error == check.error else float("inf"))
    peer = f"{pair.peer.name} ({pair.note})" if pair.note else pair.peer.name
    return [pair.work, pair.ours.name, times(row.ours), peer, times(row.peer), ratio, best, expected, str(worst)]


def times(timing: Timing) -> str:
    if not timing.check.passed:
        return f"FAILED: error {timing.check}"
    digits = 0 if timing.best >= 100 else 1
    return f"{timing.median:.{digits}f} ({timing.best:.{digits}f})"


def show(heading: str, rows: list[Row], notes: list[str]) -> None:
    table = Table(title=heading)
    for name in COLUMNS:
        table.add_column(name, justify="right" if name in ("ns", "ratio", "at best", "expected") else "left")
    work = None
    for row in rows:
        if work not in (None, row.pair.work):
            table.add_section()
        work = row.pair.work
        table.add_row(*cells(row))
    console = Console(width=None if sys.stdout.isatty() else 200)
    console.print(table)
    for note in notes:
        console.print(f"- {note}", soft_wrap=True, highlight=False)


def save(heading: str, rows: list[Row], notes: list[str]) -> Path:
    """The table as Markdown."""
    RESULTS.mkdir(exist_ok=True)
    name = "-".join("".join(c if c.isalnum() else " " for c in processor().split("@")[0]).lower().split())
    path = RESULTS / f"{datetime.date.today().isoformat()}-{name}.md"
    lines = [f"# {heading}", "", " | ".join(("", *COLUMNS, "")).strip(), "|---" * len(COLUMNS) + "|"]
    lines += [" | ".join(("", *cells(row), "")).strip() for row in rows]
    path.write_text("\n".join([*lines, "", *(f"- {note}" for note in notes), ""]), encoding="utf-8")
    return path


def processor() -> str:
    """The processor's name, as far as the system tells it, with the name that LLVM knows it by."""
    from armwright.kernels.llvm import select_target

    info = Path("/proc/cpuinfo")
    named = (
        [line.split(":")[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
        if info.exists()
        else []
    )
    return f"{named[0] if named else platform.processor() or platform.machine()} ({select_target().cpu})"


if __name__ == "__main__":
    sys.exit(main())

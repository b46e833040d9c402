"""`armwright log`: a log of measurements, read and checked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import armwright as aw
from armwright.cli.arguments import argument, as_options, option
from armwright.cli.outcome import PICTURE, check_file, say_each, write
from armwright.cli.tables import console_for_tables, number, table
from armwright.errors import LogError
from armwright.progress import progress
from armwright.terminal import say

if TYPE_CHECKING:
    from armwright.identification.logs.log import Log

HEADS = ("run", "use", "rows", "duration [s]", "rate [Hz]", "jitter", "gaps", "stretches")


def log(
    file: Path = argument("FILE.log.toml", "The log file, which describes the columns of its data files."),
    run: str | None = option("NAME", "The run to prepare and to draw; by default the first."),
    picture: Path | None = option(
        "FILE", "Draw the run and its spectra, as logged and as prepared: .png, .svg or .pdf.", names="--plot"
    ),
    cutoff: float | None = option("HZ", "Cut-off of the low-pass; by default chosen."),
    decimate: int | None = option("K", "Keep every k-th row; by default chosen."),
) -> None:
    """Read a log of measurements, check it, and show how it would be filtered for a fit.

    Errors make a log unusable: time that goes backwards, units, sides or signs that contradict each other. Warnings may
    make a fit wrong: saturation, rows that repeat, forces against the motion. Notes are good to know: gaps, quantisation,
    delays between columns. Exit code: 0 it can be used, 2 it cannot.

    \b
    Examples:
      armwright log motor.log.toml
      armwright log arm.log.toml --run fast --plot fast.png
    """
    from armwright.identification.logs.plot import plot_log
    from armwright.identification.logs.preparation import choose_preparation

    check_file(picture, PICTURE)
    with progress(f"reading {file.name}") as tell:
        found = aw.identification.read_log(file, on_error="keep", progress=tell)
    with as_options("run"):
        found.run(run)
    console = console_for_tables()
    console.print(_runs(found))
    console.print(_signals(found))
    for level, style in (("error", "red"), ("warning", "yellow"), ("note", None)):
        for finding in found.findings:
            if finding.level == level:
                console.print(f"\n{finding}", style=style, soft_wrap=True, markup=False, highlight=False)
    if found.errors:
        console.print()
        count = f"{len(found.errors)} error{'s' * (len(found.errors) != 1)}"
        raise LogError(f"{count}: the log cannot be used as its file describes it", file=file)
    with as_options("cutoff", "decimate"):
        preparation = choose_preparation(found, run, cutoff=cutoff, decimate=decimate)
    say(f"\nprepared for a fit ({found.run(run).name}):")
    say_each("  ", preparation.reasons)
    write(picture, lambda path: plot_log(found, path, run, preparation))


def _runs(found: Log) -> object:
    rows = []
    for each in found.runs:
        census = each.census
        gaps = str(census.gaps.count) if census.gaps.count else ""
        stretches = str(len(each.stretches)) if len(each.stretches) > 1 else ""
        jitter = f"{census.jitter / census.period:.1%}"
        duration, rate = number(each.duration), number(1.0 / each.period)
        rows.append([each.name, each.use, str(each.rows), duration, rate, jitter, gaps, stretches])
    return table(found.title, HEADS, rows, HEADS[:2])


def _signals(found: Log) -> object:
    """Extremes of every signal and joint over all runs."""
    rows = []
    for signal in found.layout:
        for k, joint in enumerate(signal.joints or ()):
            columns = [each.census.signals[signal.name] for each in found.runs]
            low, high = min(c.low[k] for c in columns), max(c.high[k] for c in columns)
            rows.append([signal.name, found.joints[joint], signal.units[k], number(low), number(high)])
    heads = ("signal", "joint", "unit", "lowest", "highest")
    return table("", heads, rows, heads[:3])

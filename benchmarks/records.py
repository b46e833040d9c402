"""Rows as plain data for JSON: what tables, pictures and docs are made from, without running anything again."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from timing import Row, Timing

Record = dict[str, Any]


@dataclass(frozen=True)
class Task:
    """Work that gives rows of a chapter of the report when it is run, and holds its memory no longer.

    Args:
        chapter: of the report.   title: for `--only` and the progress bar.   run: repetitions to records.
    """

    chapter: str
    title: str
    run: Callable[[int], list[Record]]


def record(row: Row) -> Record:
    """A row. Where the machine's limit was in the race, under "peak", also how much of it ours reached."""
    entry = row.entry
    result: Record = {
        "labels": dict(entry.labels),
        "timings": {column: timing_record(timing) for column, timing in row.timings.items()},
        "ratios": {column: _ratio(row, column) for column in entry.beside if row.ratios(column)},
        "facts": dict(entry.facts),
    }
    result["checked"] = all(timing["passed"] for timing in result["timings"].values())
    peak = row.timings.get("peak")
    if peak is not None and result["checked"] and "slots" in entry.facts:
        limit = entry.facts["slots"] * peak.best  # [ns] what the machine can do, whatever else it did meanwhile
        share = limit / row.timings["batch"].median
        flops = entry.facts["flops"] / (2 * entry.facts["slots"])  # an operation of the peak is two
        result["facts"] |= {"limit": limit, "of_slots": share, "of_flops": share * flops}
    return result


def timing_record(timing: Timing) -> Record:
    """A contestant's times; none where its check failed."""
    result: Record = {"name": timing.name, "error": timing.check.error, "tolerance": timing.check.tolerance}
    result["passed"] = timing.check.passed
    if timing.check.passed:
        result["median"], result["best"] = timing.median, timing.best
        result["samples"] = [float(f"{sample:.4g}") for sample in timing.samples]
    return result


def _ratio(row: Row, column: str) -> Record:
    ratios = row.ratios(column)
    result = {"beside": row.entry.beside[column], "median": statistics.median(ratios)}
    result |= {"lowest": min(ratios), "highest": max(ratios)}
    if column in row.entry.expected:
        result["expected"] = row.entry.expected[column]
    return result

"""Rows of a run, read from its files block by block; files with their own clock are interpolated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from armwright.errors import LogError
from armwright.identification.logs.clocks import Clock, Interpolated
from armwright.identification.logs.columns import converted, joint_numbers, unit_of
from armwright.identification.logs.log_file import SignalTable
from armwright.identification.logs.measured_table import MeasuredTable
from armwright.identification.logs.tables import open_table
from armwright.identification.logs.units import QUANTITIES

if TYPE_CHECKING:
    from armwright.identification.logs.log import Log, LogRun

ROWS = 65536  # of a block: a few megabytes for a whole arm
# Larger numbers are damage, and their squares would overflow.
LARGEST = 1e30  # of a signal in SI units
LATEST = 1e12  # [s] of a time
ON_THE_EDGE = 1e-9  # [s]: rows so near the beginning or the end of a run are at it


@dataclass(frozen=True, eq=False)
class Block:
    """Some rows of a run.

    Attributes:
        row: number of the first, from 0.   t: (rows,) [s] since the run's first row.
        values: signal → (rows, joints that have it), in the units of the log's layout.
        before: rows of the files that come before the run's first.
    """

    row: int
    t: np.ndarray
    values: Mapping[str, np.ndarray]
    before: int = 0


def run_blocks(log: Log, run: LogRun, rows: int) -> Iterator[Block]:
    """Rows of a run with time and signals, block by block; files with their own clock are interpolated."""
    tables = {key: open_table(path, log.table.files[key]) for key, path in run.paths.items()}
    try:
        whole = _blocks(log, run, tables, rows)
        yield from whole if (run.begin, run.end) == (0.0, inf) else _between(whole, run)
    except LogError as error:
        raise error.within(f"run {run.name!r}" if not error.file else "", file=log.path) from None


def _between(blocks: Iterator[Block], run: LogRun) -> Iterator[Block]:
    """Rows of a run that is a part of its files; their time counts from the first of them.

    Raises:
        LogError: there are none.
    """
    first, begun, block = 0, np.nan, None
    for block in blocks:
        inside = (block.t >= run.begin - ON_THE_EDGE) & (block.t < run.end - ON_THE_EDGE)
        rows = np.flatnonzero(inside)
        if len(rows):
            part = slice(int(rows[0]), int(rows[-1]) + 1)
            if np.isnan(begun):
                first, begun = block.row + part.start, float(block.t[part.start])
            values = {name: each[part] for name, each in block.values.items()}
            yield Block(block.row + part.start - first, block.t[part] - begun, values, first)
        if (block.t >= run.end).any():
            break
    if np.isnan(begun):
        last = 0.0 if block is None else float(np.nanmax(block.t))
        upto = "its end" if run.end == inf else f"{run.end:g} s"
        raise LogError(f"no rows from {run.begin:g} s to {upto}", place="runs", expected=f"a part of 0 to {last:g} s")


def _blocks(log: Log, run: LogRun, tables: Mapping[str, MeasuredTable], rows: int) -> Iterator[Block]:
    table = log.table
    groups = {key: [(k, s) for k, s in enumerate(table.signals) if table.only(s.file) == key] for key in tables}
    units = {k: unit_of(s, tables[key], f"signals[{k}]") for key, group in groups.items() for k, s in group}
    columns = {key: [column for _, s in group for column in s.columns] for key, group in groups.items()}
    clock = Clock(table.time, None if table.time.column is None else tables[table.only(table.time.file)])
    timed = table.only(table.time.file) if table.time.column is not None else None
    in_step: dict[str, Iterator[list[np.ndarray]]] = {}
    interpolated: dict[str, Interpolated] = {}
    for key, source in tables.items():
        own = table.files[key].time
        if own is not None:
            interpolated[key] = Interpolated(source, Clock(own, source), columns[key], rows, clock)
        elif columns[key] or key == timed:
            ahead = [] if key != timed or table.time.column is None else [table.time.column]
            in_step[key] = source.blocks([*ahead, *columns[key]], rows)
    row = 0
    for parts in _in_step(in_step, tables, rows):
        times = parts[timed].pop(0) if timed is not None else None
        count = len(times) if times is not None else len(next(iter(parts.values()))[0])
        t = clock.seconds(times, row, count)
        if timed is not None:
            t = np.where(np.isfinite(t), t, np.nan)
            _refuse_absurd(t, LATEST, "s", tables[timed], table.time.column, row)
        for key, each in interpolated.items():
            parts[key] = each.at(t)
        yield Block(row, t, _signals(log, groups, units, parts, tables, row))
        row += count
    if row == 0:
        raise LogError("has no rows", file=next(iter(run.paths.values())), expected="at least two")


def _signals(
    log: Log,
    groups: Mapping[str, list[tuple[int, SignalTable]]],
    units: Mapping[int, str],
    parts: Mapping[str, list[np.ndarray]],
    tables: Mapping[str, MeasuredTable],
    row: int,
) -> dict[str, np.ndarray]:
    """Every signal (rows, joints) from the columns of the files."""
    found: dict[str, list[tuple[int, np.ndarray]]] = {}
    for key, group in groups.items():
        at = 0
        for k, signal in group:
            columns = parts[key][at : at + len(signal.columns)]
            at += len(signal.columns)
            raw = np.stack(columns, axis=1).astype(float)
            raw[~np.isfinite(raw)] = np.nan
            for values, column in zip(raw.T, signal.columns, strict=True):
                _refuse_absurd(values, LARGEST, units[k], tables[key], column, row)
            values = converted(log, signal, k, raw, units[k])
            lost = np.isfinite(raw).all(axis=1, keepdims=True) & np.isnan(values)
            values[lost] = np.inf  # the difference of two that overflow
            for each, column in zip(values.T, signal.columns, strict=True):
                _refuse_absurd(each, LARGEST, "in SI units, at the joint", tables[key], column, row)
            numbers = joint_numbers(signal, log.joints, f"signals[{k}]")
            found.setdefault(QUANTITIES[signal.quantity].signal, []).extend(zip(numbers, values.T, strict=True))
    return {
        signal.name: np.stack([column for _, column in sorted(found[signal.name], key=lambda each: each[0])], axis=1)
        for signal in log.layout
    }


def _refuse_absurd(
    values: np.ndarray, most: float, unit: str, table: MeasuredTable, column: int | str | None, row: int
) -> None:
    """Refuses numbers that nothing measures, before squares of them overflow.

    Raises:
        LogError: with file and line.
    """
    absurd = np.abs(values) > most
    if absurd.any():
        k = int(np.argmax(absurd))
        expected = f"at most {most:g} {unit}"
        raise LogError(place=f"column {column!r}", value=float(values[k]), expected=expected, file=table.place(row + k))


def _in_step(
    sources: Mapping[str, Iterator[list[np.ndarray]]], tables: Mapping[str, MeasuredTable], rows: int
) -> Iterator[dict[str, list[np.ndarray]]]:
    """Blocks of several files whose rows belong together; one may have one row fewer, as inputs between samples have.

    Raises:
        LogError: files of different length.
    """
    if not sources:
        raise LogError("every file has a clock of its own", place="files", expected="one file with the log's clock")
    total = dict.fromkeys(sources, 0)
    ended = False
    while True:
        parts = {key: next(source, None) for key, source in sources.items()}
        for key, part in parts.items():
            total[key] += 0 if part is None else len(part[0])
        if max(total.values()) - min(total.values()) > 1:
            for key, source in sources.items():
                total[key] += sum(len(part[0]) for part in source)
            listed = ", ".join(f"{tables[key].path.name} {count}" for key, count in total.items())
            expected = "files with a row for each sample, or [files.KEY.time] for one with a clock of its own"
            raise LogError(f"files of different length: {listed} rows", expected=expected)
        count = min(0 if part is None else len(part[0]) for part in parts.values())
        if count and not ended:
            yield {key: [column[:count] for column in part or ()] for key, part in parts.items()}
        ended = ended or count < rows
        if all(part is None for part in parts.values()):
            return

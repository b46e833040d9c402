"""Tables of numbers as CSV: one header row, then one row a set of data.

A column's name may carry its unit, `tau_elbow [N m]`, and does so in the tables that Armwright writes: pandas, MATLAB and
Excel read that. A unit in a header is compared with the expected one, so a column in millivolts or degrees is refused and
not taken for volts or radians.
"""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from armwright.errors import ScheduleError
from armwright.output import whole_file
from armwright.reading import read_file

WITH_UNIT = re.compile(r"^(?P<name>[^\[\]]*?)\s*\[(?P<unit>[^\[\]]*)\]$")
ROWS_AT_ONCE = 4096  # rows turned into text together, so that a long table never stands in memory twice


@dataclass(frozen=True)
class CsvColumn:
    """A column that a table must have: its name, and the units that its header may state."""

    name: str
    units: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class CsvNumbers:
    """Numbers of a CSV file: `values` (rows, columns) in the order of `columns`, `lines` (rows,) of the file."""

    path: str
    columns: tuple[CsvColumn, ...]
    values: np.ndarray
    lines: tuple[int, ...]


def read_numbers(path: str | os.PathLike[str], columns: Sequence[CsvColumn]) -> CsvNumbers:
    """The finite numbers of a CSV file, its columns found by name, or by order where there is no header row.

    Args:
        path: UTF-8 text with commas between the cells; blank lines count for nothing.
        columns: all columns of the file.
    Raises:
        ScheduleError: no such file, not UTF-8, columns too many, too few or unknown, a wrong unit, a cell that holds
            no finite number, no rows; with file, line, column, value and expectation.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise ScheduleError(value=path, expected="the path of a CSV file")
    place = os.fsdecode(path)
    return parse_numbers(table_text(place), place, columns)


def parse_numbers(text: str, place: str, columns: Sequence[CsvColumn]) -> CsvNumbers:
    """The finite numbers in the text of a CSV file; `place` is what errors call it. See `read_numbers`."""
    columns = tuple(columns)
    expected = f"{len(columns)} columns: {', '.join(column.name for column in columns)}"
    order: list[int] | None = None
    values: list[list[float]] = []
    lines: list[int] = []
    for line, cells in _rows(place, text):
        if order is None:
            header = _is_header(cells, columns)
            order = _order(f"{place}:{line}", cells, columns, expected) if header else list(range(len(columns)))
            if header:
                continue
        if len(cells) != len(columns):
            count = "1 column" if len(cells) == 1 else f"{len(cells)} columns"
            raise ScheduleError(_separated(cells) or count, file=f"{place}:{line}", expected=expected)
        row = [_number(cells[k]) for k in order]
        for column, k, value in zip(columns, order, row, strict=True):
            if value is None or not isfinite(value):
                where, wanted = f"column {column.name!r}", "a finite number"
                raise ScheduleError(place=where, value=cells[k], expected=wanted, file=f"{place}:{line}")
        values.append(row)  # type: ignore[arg-type]
        lines.append(line)
    if not values:
        what = "empty" if order is None else "a header without rows"
        raise ScheduleError(what, file=place, expected=f"at least one row of {expected}")
    return CsvNumbers(place, columns, np.array(values, dtype=float), tuple(lines))


def read_table(
    path: str | os.PathLike[str],
    columns: Mapping[str, Sequence[str]],
    units: Mapping[str, Sequence[str]] | None = None,
) -> dict[str, np.ndarray]:
    """Sets of data, one a row: `read_table(path, {"q": arm.names, "qd": arm.names})` reads q_joint1, …, qd_joint1, ….

    Args:
        path: CSV with a header of those names in any order, or without a header and in just that order.
        columns: for every quantity the names of its joints.
        units: for every quantity the unit of each joint, compared with the header's where that states units.
    Returns:
        values: for every quantity its array (rows, joints), in the order of `columns`.
    Raises:
        ScheduleError: see `read_numbers`.
    """
    wanted = []
    for quantity, names in columns.items():
        stated = units[quantity] if units and quantity in units else [""] * len(names)
        wanted += [
            CsvColumn(f"{quantity}_{name}", (unit,) if unit else ()) for name, unit in zip(names, stated, strict=True)
        ]
    values = read_numbers(path, wanted).values
    ends = np.cumsum([len(names) for names in columns.values()])
    return dict(zip(columns, np.split(values, ends[:-1], axis=1), strict=True))


def joint_columns(
    quantity: str, names: Sequence[str], units: Sequence[str], values: np.ndarray
) -> dict[str, np.ndarray]:
    """Columns to write of a quantity (rows, n): `tau_elbow [N m]` → (rows,), one for each of the n joints."""
    heads = [f"{quantity}_{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
    return dict(zip(heads, values.T, strict=True))


def write_table(path: str | os.PathLike[str] | None, columns: Mapping[str, Any], stream: Any = None) -> None:
    """A CSV file of columns of equal length; floats in the fewest digits that read back to the same number.

    Args:
        path: the file, replaced as a whole; None writes to `stream`.
        columns: header, with its unit in brackets, and values (rows,).   stream: an open text file.
    Raises:
        OutputError: the file cannot be written.
    """
    if path is None:
        write_rows(stream, columns)
        return
    with whole_file(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        write_rows(file, columns)


def write_rows(file: Any, columns: Mapping[str, Any], *, with_head: bool = True) -> None:
    """Writes columns of equal length as CSV into an open text file, with their header or without."""
    writer = csv.writer(file, lineterminator="\n")
    if with_head:
        writer.writerow(columns)
    arrays = [np.asarray(values) for values in columns.values()]
    for start in range(0, len(arrays[0]) if arrays else 0, ROWS_AT_ONCE):
        part = slice(start, start + ROWS_AT_ONCE)
        writer.writerows(zip(*(array[part].tolist() for array in arrays), strict=True))


def table_text(path: str | os.PathLike[str]) -> str:
    """The text of a CSV file.

    Raises:
        ScheduleError: no such file, or none in UTF-8.
    """
    data = read_file(path, "a CSV file", ScheduleError)
    place = os.fsdecode(path)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        what = f"byte 0x{data[error.start]:02x} is not UTF-8"
        raise ScheduleError(what, file=f"{place}:{line}", expected="a CSV file in UTF-8") from None


def _rows(place: str, text: str) -> Iterator[tuple[int, list[str]]]:
    """Rows that are not blank, with the number of the line that each ends on, spaces around the cells removed."""
    reader = csv.reader(text.splitlines(), strict=True, skipinitialspace=True)
    try:
        for cells in reader:
            stripped = [cell.strip() for cell in cells]
            if len(stripped) > 1 or any(stripped):
                yield reader.line_num, stripped
    except csv.Error as error:
        raise ScheduleError(f"not CSV: {error}", file=f"{place}:{reader.line_num}") from None


def _is_header(cells: list[str], columns: Sequence[CsvColumn]) -> bool:
    """True if a first row holds names: one that is expected, or nothing that could be a number."""
    names = {column.name for column in columns}
    return any(_name_and_unit(cell)[0] in names for cell in cells) or all(_number(cell) is None for cell in cells)


def _number(cell: str) -> float | None:
    """The number in a cell; None if it is none."""
    if "_" in cell:  # Python reads 1_000, but in a table that is a typing mistake
        return None
    try:
        return float(cell)
    except ValueError:
        return None


def _name_and_unit(cell: str) -> tuple[str, str | None]:
    """Name and unit of a header's cell: `q_elbow [rad]` → ("q_elbow", "rad")."""
    match = WITH_UNIT.match(cell)
    return (match["name"], match["unit"].strip()) if match else (cell, None)


def _order(file: str, cells: list[str], columns: Sequence[CsvColumn], expected: str) -> list[int]:
    """Position in the file of each of the expected columns."""
    positions: dict[str, int] = {}
    known = {column.name: column for column in columns}
    for k, cell in enumerate(cells):
        name, unit = _name_and_unit(cell)
        if not name:
            raise ScheduleError(f"column {k + 1} has no name", file=file, expected=expected)
        if name not in known:
            separated = _separated(cells)
            if separated:
                raise ScheduleError(separated, file=file, expected=expected)
            raise ScheduleError("unknown", place="column", value=name, choices=known, file=file)
        if name in positions:
            raise ScheduleError("given twice", place=f"column {name!r}", file=file)
        units = known[name].units
        if unit is not None and units and unit not in units:
            raise ScheduleError(place=f"unit of column {name!r}", value=unit, expected=" or ".join(units), file=file)
        positions[name] = k
    missing = [name for name in known if name not in positions]
    if missing:
        raise ScheduleError("missing", place=f"column {missing[0]!r}", expected=expected, file=file)
    return [positions[column.name] for column in columns]


def _separated(cells: list[str]) -> str:
    """A note if cells are separated by something other than commas."""
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if any(mark in cell for cell in cells) and (len(cells) == 1 or mark == ";"):
            return f"cells are separated by {name}, not by commas"
    return ""

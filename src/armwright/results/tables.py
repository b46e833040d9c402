"""Tables of numbers as CSV: one header row, then one row a set of data.

A column's name may carry its unit, `tau_elbow [N m]`, and does so in the tables that Armwright writes: pandas, MATLAB,
Excel and people read that without being told how. Read back, a unit is compared with the one that is expected, so a
column in millivolts or degrees is refused and not taken for volts or radians.
"""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armwright.errors import ScheduleError, nearest
from armwright.output import whole_file

WITH_UNIT = re.compile(r"^(?P<name>[^\[\]]*?)\s*\[(?P<unit>[^\[\]]*)\]$")
ROWS_AT_ONCE = 4096  # rows turned into text together, so that a long table never stands in memory twice


@dataclass(frozen=True)
class Column:
    """A column that a table must have: its name, and the units that its header may state."""

    name: str
    units: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Numbers:
    """What a CSV file holds: `values` (rows, columns) in the order asked for, `lines` (rows,) where each stood."""

    path: str
    columns: tuple[Column, ...]
    values: np.ndarray
    lines: tuple[int, ...]

    def place(self, row: int, column: int) -> str:
        """Where a value stands, for an error to begin with."""
        return f"{self.path}: line {self.lines[row]}, column {self.columns[column].name!r}"


def read_numbers(path: str | os.PathLike[str], columns: Sequence[Column]) -> Numbers:
    """The finite numbers of a CSV file, its columns found by name, or by order where there is no header row.

    Args:
        path: UTF-8 text with commas between the cells; blank lines count for nothing.
        columns: every column that the file must have; it may have no other.
    Raises:
        ScheduleError: no such file, not UTF-8, columns too many, too few or unknown, a wrong unit, a cell that holds
            no finite number, no rows; one line that names file, line, column, value and what was expected.
    """
    place, columns = os.fspath(path), tuple(columns)
    rows = _rows(place, _text(place))
    expected = f"{len(columns)} columns: {', '.join(column.name for column in columns)}"
    order: list[int] | None = None
    values: list[list[float]] = []
    lines: list[int] = []
    for line, cells in rows:
        if order is None:
            header = _is_header(cells, columns)
            order = _order(place, line, cells, columns, expected) if header else list(range(len(columns)))
            if header:
                continue
        if len(cells) != len(columns):
            raise ScheduleError(f"{place}: line {line}: {_count(cells)}, expected {expected}{_separator_hint(cells)}")
        try:
            values.append([_number(cells[k]) for k in order])
        except ValueError:
            _refuse_cells(place, line, [cells[k] for k in order], columns)
            raise
        lines.append(line)
    if order is None:
        raise ScheduleError(f"{place}: empty; expected {expected}")
    if not values:
        raise ScheduleError(f"{place}: a header without rows; expected at least one row of {expected}")
    table = Numbers(place, columns, np.array(values, dtype=float), tuple(lines))
    bad = np.argwhere(~np.isfinite(table.values))
    if len(bad):
        row, column = bad[0]
        value = table.values[row, column]
        raise ScheduleError(f"{table.place(row, column)}: {value:g}: expected a finite number")
    return table


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
            Column(f"{quantity}_{name}", (unit,) if unit else ()) for name, unit in zip(names, stated, strict=True)
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
        _write_rows(stream, columns)
        return
    with whole_file(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as file:
        _write_rows(file, columns)


def _write_rows(file: Any, columns: Mapping[str, Any]) -> None:
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(columns)
    arrays = [np.asarray(values) for values in columns.values()]
    for start in range(0, len(arrays[0]) if arrays else 0, ROWS_AT_ONCE):
        part = slice(start, start + ROWS_AT_ONCE)
        writer.writerows(zip(*(array[part].tolist() for array in arrays), strict=True))


def _text(place: str) -> str:
    try:
        data = Path(place).read_bytes()
    except FileNotFoundError:
        raise ScheduleError(f"{place}: no such file") from None
    except IsADirectoryError:
        raise ScheduleError(f"{place}: a folder, expected a CSV file") from None
    except OSError as error:
        raise ScheduleError(f"{place}: cannot be read: {error.strerror or error}") from None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ScheduleError(
            f"{place}: line {line}: byte 0x{data[error.start]:02x} is not UTF-8; expected a CSV file in UTF-8"
        ) from None


def _rows(place: str, text: str) -> Iterator[tuple[int, list[str]]]:
    """Rows that are not blank, with the number of the line that each ends on, spaces around the cells removed."""
    reader = csv.reader(text.splitlines(), strict=True, skipinitialspace=True)
    try:
        for cells in reader:
            stripped = [cell.strip() for cell in cells]
            if len(stripped) > 1 or any(stripped):
                yield reader.line_num, stripped
    except csv.Error as error:
        raise ScheduleError(f"{place}: line {reader.line_num}: not CSV: {error}") from None


def _is_header(cells: list[str], columns: Sequence[Column]) -> bool:
    """Whether a first row holds names: one that is expected, or nothing that could be a number."""
    names = {column.name for column in columns}
    return any(_split(cell)[0] in names for cell in cells) or not any(_is_number(cell) for cell in cells)


def _number(cell: str) -> float:
    if "_" in cell:  # Python's 1_000 is a slip of the keyboard in a table
        raise ValueError(cell)
    return float(cell)


def _is_number(cell: str) -> bool:
    try:
        _number(cell)
    except ValueError:
        return False
    return True


def _split(cell: str) -> tuple[str, str | None]:
    """Name and unit of a header's cell: `q_elbow [rad]` → ("q_elbow", "rad")."""
    match = WITH_UNIT.match(cell)
    return (match["name"], match["unit"].strip()) if match else (cell, None)


def _order(place: str, line: int, cells: list[str], columns: Sequence[Column], expected: str) -> list[int]:
    """Where in the file each of the expected columns stands."""
    found: dict[str, int] = {}
    known = {column.name: column for column in columns}
    for k, cell in enumerate(cells):
        name, unit = _split(cell)
        if name not in known:
            if not name:
                raise ScheduleError(f"{place}: line {line}: column {k + 1} has no name; expected {expected}")
            hint = _separator_hint(cells) or f"; {nearest(name, known)}"
            raise ScheduleError(f"{place}: line {line}: unknown column {name!r}{hint}")
        if name in found:
            raise ScheduleError(f"{place}: line {line}: two columns are called {name!r}")
        units = known[name].units
        if unit is not None and units and unit not in units:
            raise ScheduleError(
                f"{place}: line {line}, column {name!r}: in {unit!r}; expected its unit to be {' or '.join(units)}"
            )
        found[name] = k
    missing = [name for name in known if name not in found]
    if missing:
        raise ScheduleError(f"{place}: line {line}: no column {missing[0]!r}; expected {expected}")
    return [found[column.name] for column in columns]


def _count(cells: list[str]) -> str:
    return "1 column" if len(cells) == 1 else f"{len(cells)} columns"


def _separator_hint(cells: list[str]) -> str:
    if len(cells) > 1 and not any(";" in cell for cell in cells):
        return ""
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if any(mark in cell for cell in cells):
            return f"; its cells are separated by {name}, expected commas"
    return ""


def _refuse_cells(place: str, line: int, cells: list[str], columns: Sequence[Column]) -> None:
    for cell, column in zip(cells, columns, strict=True):
        if not _is_number(cell):
            shown = repr(cell) if cell else "empty"
            raise ScheduleError(f"{place}: line {line}, column {column.name!r}: {shown}: expected a finite number")

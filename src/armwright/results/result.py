"""The verbs of every result: `rows`, `plot`, `report`, `save`; printed, and in notebooks, it shows its tables.

A type says what it has in `tables`, `sentences`, `good` and `draw`; without them its fields are the table, with the units that
its docstring states.
"""

from __future__ import annotations

import inspect
import json
import os
import re
from dataclasses import fields, is_dataclass
from html import escape
from itertools import takewhile
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from armwright.errors import ArmwrightError
from armwright.output import check_destination, write_whole
from armwright.results.csv_tables import write_table
from armwright.results.page_parts import plotted, said, section, shown_table, write_page
from armwright.results.plot import PICTURES, write_figure
from armwright.results.svg import INK, QUIET, ink_axes, page_svg
from armwright.results.table import Table, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENDINGS = (".csv", ".json")
ON_PAPER = ("#222222", "#777777")  # words and points of a picture in a file
BLUE = "#2a7fc9"  # seen on white and on black
WIDTH = 9.2  # of a picture in a page [inch]
LONGEST = 12  # values of an array that are shown one by one
BARS = 4  # columns of a table that are drawn
LABELS, LABEL = 60, 0.2  # rows of bars that are named, and the height of each [inch]
AXIS = 0.5  # height of an axis with its numbers and name [inch]
WORDS = re.compile(r"(?<=[a-z])(?=[A-Z])")


class Result:
    """Base of all result types of public functions."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "__repr__" not in cls.__dict__:  # that of a dataclass has all arrays, up to 100 kB of them
            cls.__repr__ = Result.__repr__

    def __repr__(self) -> str:
        """The printed tables and sentences, which a Python prompt shows."""
        return str(self)

    @property
    def height(self) -> float:
        """Of its picture [inch]."""
        return bars_height(self.tables()[0]) if type(self).draw is Result.draw else 3.6

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return WORDS.sub(" ", type(self).__name__).capitalize()

    def tables(self) -> list[Table]:
        """Its tables, the main one first."""
        return [Table(self.heading, ("name", "value", "unit"), list(_fields(self)), ("unit",))]

    def sentences(self) -> list[str]:
        """The meaning in words, the verdict first if there is one."""
        return []

    @property
    def good(self) -> bool | None:
        """True or False of a verdict that is the first sentence; None without one."""
        return None

    def sections(self) -> list[tuple[str, str]]:
        """Sections of its page behind the tables, each a heading and its HTML."""
        return []

    def draw(self, figure: Figure, ink: str, quiet: str) -> None:
        """Draws it: by default bars of the numbers of the main table.

        Args:
            figure: to draw in.   ink, quiet: colours of words and of what is less important.
        Raises:
            ArmwrightError: nothing to draw.
        """
        draw_bars(figure, self.tables()[0], ink)

    def rows(self) -> list[dict[str, Any]]:
        """The main table: a dict for each row, as `pandas.DataFrame` takes them; numbers with all digits, None if not known."""
        return self.tables()[0].rows()

    @overload
    def plot(self, path: None = None) -> Figure: ...

    @overload
    def plot(self, path: str | os.PathLike[str]) -> None: ...

    def plot(self, path: str | os.PathLike[str] | None = None) -> Figure | None:
        """Picture of the result.

        Args:
            path: .png, .svg or .pdf to write; None: the figure is returned, which notebooks show.
        Raises:
            ArmwrightError: nothing to draw.   OutputError: it cannot be written.
        """
        from armwright.results.inline_figure import InlineFigure

        target = None if path is None else check_destination(path, PICTURES)
        figure = InlineFigure(figsize=(WIDTH, self.height), dpi=150, layout="constrained", facecolor="white")
        self.draw(figure, *ON_PAPER)
        if target is None:
            return figure
        return write_figure(figure, target)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Writes a page: verdict, tables, picture; one file that needs no network.

        Args:
            path: ending in .html.
        Returns:
            path: of the page.
        Raises:
            OutputError: the file cannot be written.
        """
        body = [section("Result", said(self.sentences(), self.good))] if self.sentences() else []
        body += [
            section("Numbers" if each.title in (None, self.heading) else each.title, shown_table(each))
            for each in self.tables()
            if each.cells
        ]
        body += [section(heading, html) for heading, html in (*self._picture(), *self.sections())]
        return write_page(path, self.heading, body)

    def _picture(self) -> list[tuple[str, str]]:
        """Its own picture as a section; none where it only repeats the table."""
        if type(self).draw is Result.draw:
            return []
        draw = lambda figure: self.draw(figure, INK, QUIET)  # noqa: E731
        return [("Picture", plotted(page_svg(draw, (WIDTH, self.height), "constrained")))]

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the main table as .csv, or all tables and sentences as .json.

        Args:
            path: of the file.
        Returns:
            path: of the file.
        Raises:
            OutputError: the file cannot be written.
        """
        target = check_destination(path, ENDINGS)
        tables = self.tables()
        if target.suffix.lower() == ".csv":
            rows, columns = tables[0].rows(), zip(tables[0].heads, tables[0].names, strict=True)
            write_table(target, {head: [each[name] for each in rows] for head, name in columns})
            return target
        found = [{"title": each.title, "units": each.units, "rows": each.rows()} for each in tables]
        document = {"kind": type(self).__name__, "tables": found, "sentences": self.sentences()}
        text = json.dumps(document, indent=1, ensure_ascii=False, default=str)
        write_whole(target, re.sub(r"\b-?(?:NaN|Infinity)\b", "null", text) + "\n", ENDINGS)
        return target

    def __str__(self) -> str:
        """Tables of at most 24 rows, and sentences."""
        tables = [str(each) for each in self.tables() if each.cells]
        return "\n\n".join(filter(None, [*tables, "\n".join(self.sentences())]))

    def _repr_html_(self) -> str:
        tables = (f"<b>{escape(each.title or '')}</b>{shown_table(each)}" for each in self.tables() if each.cells)
        return "".join(tables) + said(self.sentences(), None)


def bars_height(table: Table) -> float:
    """Height of the picture that `draw_bars` makes of a table [inch]."""
    _, parts = _drawn(table)
    return max(3.6, 1.0 + AXIS * (len(parts) - 1) + LABEL * min(len(table.cells), LABELS))


def draw_bars(figure: Figure, table: Table, ink: str) -> None:
    """Draws the columns of numbers of a table as bars over its first column; values in different units have axes of their own.

    Raises:
        ArmwrightError: no column of numbers.
    """
    names, parts = _drawn(table)
    if not parts:
        raise ArmwrightError("nothing to draw", place=table.title or "plot", expected="a result with numbers")
    words = list(takewhile(lambda k: k in table.words and table.names[k] != "unit", range(len(table.names))))
    share = {"height_ratios": [len(rows) for rows in parts.values()]}
    grid = figure.subplots(len(parts), len(names), sharey="row", squeeze=False, gridspec_kw=share)
    every = ceil(sum(map(len, parts.values())) / LABELS)
    for places, (unit, rows) in zip(grid, parts.items(), strict=True):
        cells = ([row[table.names[k]] for k in words] for row in rows)
        labels = [" ".join(str(cell) for k, cell in enumerate(row) if k == 0 or isinstance(cell, str)) for row in cells]
        for axes, name in zip(places, names, strict=True):
            values = [row[name] if isinstance(row[name], (int, float)) else np.nan for row in rows]
            axes.barh(range(len(labels)), np.where(np.isfinite(values), values, 0.0), color=BLUE)
            axes.set_yticks(range(0, len(labels), every), labels[::every])
            stated = table.units.get(name, unit)
            axes.set_xlabel(f"{name} [{stated}]" if stated else name, color=ink)
            ink_axes(axes, ink)
        places[0].invert_yaxis()


def _drawn(table: Table) -> tuple[list[str], dict[str, list[dict[str, Any]]]]:
    """Names of the columns that are drawn as bars, and their rows: all as one, or by the unit that a column states of each."""
    cells, names = table.rows(), table.names
    columns = {name for k, name in enumerate(names) if k not in table.words}
    numbers = {name for name in columns for row in cells if isinstance(row[name], (int, float))}
    units = {str(row["unit"] or "") for row in cells} if "unit" in names else set()
    if len(units) > 1 and numbers & set(table.units):
        numbers &= set(table.units)  # of shares of limits and the like one axis serves all rows
    parts: dict[str, list[dict[str, Any]]] = {}
    for row in cells:
        if any(isinstance(row[name], (int, float)) for name in numbers):
            by_row = "unit" in names and not numbers & set(table.units)
            parts.setdefault(str(row["unit"] or "") if by_row else "", []).append(row)
    return [name for name in names if name in numbers][:BARS], parts


def _fields(found: Any) -> list[list[Any]]:
    """Rows of name, value and unit: the public fields that are numbers, short arrays or words."""
    about = inspect.getdoc(type(found)) or ""
    rows: list[list[Any]] = []
    for each in fields(found) if is_dataclass(found) else ():
        value = getattr(found, each.name)
        stated = re.search(rf"\b{each.name}\b[^:\n]*: [^\[\n]*\[([^\]\n]+)\]", about)
        unit = "" if stated is None or stated[1] == "-" else stated[1]
        rows += [[name, cell, unit] for name, cell in _cells(each.name.replace("_", " "), value)]
    return rows


def _cells(name: str, value: Any) -> list[tuple[str, Any]]:
    """A value as cells by name: numbers, words, a short array one by one, the ends of a long one; nothing of other things."""
    if isinstance(value, (bool, str, os.PathLike)):
        return [(name, str(value))]
    if isinstance(value, (int, float, np.number)):
        return [(name, number(value))]
    if isinstance(value, dict):
        return [cell for key, inner in value.items() for cell in _cells(f"{name} {key}", inner)]
    if isinstance(value, (tuple, list)) and all(isinstance(each, (str, os.PathLike)) for each in value):
        return [(name, ", ".join(map(str, value)))] if value else []
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return []
    if value is None or not array.size:
        return []
    if array.size <= LONGEST:
        places = (" ".join(str(k + 1) for k in place) for place in np.ndindex(array.shape))
        return [(f"{name} {place}".strip(), number(each)) for place, each in zip(places, array.flat, strict=True)]
    known = array[np.isfinite(array)]
    of = f"of {' × '.join(map(str, array.shape))}"
    ends = (known.min(), known.max()) if known.size else (None, None)
    return [(f"{name}, {which} {of}", number(end)) for which, end in zip(("lowest", "highest"), ends, strict=True)]

"""Output of commands: lines, tables of numbers with units and drawings, on the screen or in the open output file."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import floor, isfinite, log10
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armwright import terminal
from armwright.errors import SessionError
from armwright.output import write_whole
from armwright.printable import printable
from armwright.results.csv_tables import write_rows

if TYPE_CHECKING:
    import xarray as xr
    from rich.console import Console
    from rich.table import Table

DIGITS = 6  # that the largest number of a column shows
MOST_DECIMALS = 8  # smaller numbers are shown with an exponent
NOTHING = 1e-12  # of any unit: less is rounding, and shown as 0


@dataclass(frozen=True)
class TextLine:
    """A sentence; `style` is "plain", "good", "note", "dim" or "head"."""

    text: str
    style: str = "plain"


@dataclass(frozen=True)
class Sheet:
    """A table: a title, the heads of its columns, and cells as text.

    Attributes:
        words: how many columns from the left hold words and not numbers.
    """

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: int = 1


@dataclass(frozen=True, eq=False)
class Drawing:
    """A run to draw on the screen or into a picture; joints, quantities: selections, as for `plot`."""

    run: xr.Dataset
    joints: Sequence[str] | None = None
    quantities: Sequence[str] | None = None


Output = TextLine | Sheet | Drawing


@dataclass(frozen=True, eq=False)
class Listing:
    """Numbers for the screen or a file: sheets that people read, and all of it as columns of CSV, `tau_elbow [N m]` → (rows,)."""

    sheets: tuple[Sheet, ...]
    columns: dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class OutputFile:
    """The open output file: path, text printed so far, and names of its columns.

    Every printing writes the whole file again, or nothing, so that it is complete at every moment.
    """

    path: Path
    text: str = ""
    head: tuple[str, ...] = field(default=())

    @property
    def is_csv(self) -> bool:
        """True for a name that ends in .csv."""
        return self.path.suffix.lower() == ".csv"

    def printed(self, listing: Listing) -> OutputFile:
        """The file with a listing added at its end, written to disk.

        Raises:
            SessionError: a CSV file with other columns.   OutputError: the file cannot be written.
        """
        head = tuple(listing.columns)
        if self.is_csv:
            if self.head and self.head != head:
                value, before = (f"{', '.join(heads[:3])}, …" for heads in (head, self.head))
                expected = f"{before} as before, or close-output-file and another file"
                raise SessionError(place="columns", value=value, expected=expected, file=self.path)
            stream = io.StringIO()
            write_rows(stream, listing.columns, with_head=not self.head)
            text = self.text + stream.getvalue()
        else:
            text = self.text + "".join(plain(sheet) + "\n" for sheet in listing.sheets)
        write_whole(self.path, text)
        return OutputFile(self.path, text, head)


def plain(sheet: Sheet) -> str:
    """A sheet as aligned text."""
    rows = [sheet.heads, *sheet.rows]
    widths = [max(len(row[k]) for row in rows) for k in range(len(sheet.heads))]
    lines = [sheet.title] if sheet.title else []
    for row in rows:
        cells = [
            cell.ljust(w) if k < sheet.words else cell.rjust(w)
            for k, (cell, w) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines) + "\n"


def significant(value: float) -> str:
    """A number on its own, in six digits; — if unknown."""
    if not isfinite(value):
        return "—" if value != value else "∞" if value > 0 else "-∞"
    return f"{_without_rounding(value):.{DIGITS}g}"


def _without_rounding(value: float) -> float:
    """The number; 0 if it is nothing but rounding, never -0."""
    return 0.0 if abs(value) < NOTHING else float(value)


def aligned(values: Sequence[float] | np.ndarray) -> list[str]:
    """Numbers of one column, all with the decimals that give the largest of them six digits."""
    sizes = [abs(float(v)) for v in values if isfinite(v) and _without_rounding(v) != 0.0]
    decimals = DIGITS - 1 - floor(log10(max(sizes))) if sizes else 0
    if decimals > MOST_DECIMALS or decimals < -1:
        return [f"{_without_rounding(v):.{DIGITS - 1}e}" if isfinite(v) else significant(v) for v in values]
    decimals = max(decimals, 0)
    return [_no_minus_zero(f"{float(v):.{decimals}f}") if isfinite(v) else significant(v) for v in values]


def _no_minus_zero(text: str) -> str:
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def shortest(values: Sequence[float] | np.ndarray) -> list[str]:
    """Times and the like, aligned: with the fewest decimals that distinguish them."""
    texts = [f"{float(v) + 0.0:.9f}".rstrip("0").rstrip(".") for v in values]
    decimals = max((len(text.partition(".")[2]) for text in texts), default=0)
    return [f"{float(v) + 0.0:.{decimals}f}" for v in values]


def by_joint(title: str, names: Sequence[str], columns: Sequence[tuple[str, Sequence[str], np.ndarray]]) -> Sheet:
    """One row a joint; columns are (name, units, values (n,)). A unit of all joints stands in the head, others in the cells."""
    heads, cells = ["joint"], [list(names)]
    for name, units, values in columns:
        kinds = list(dict.fromkeys(units))
        texts = [significant(value) for value in values]
        heads.append(f"{name} [{kinds[0]}]" if len(kinds) == 1 else name)
        if len(kinds) > 1:
            texts = [f"{text} {unit}" for text, unit in zip(texts, units, strict=True)]
        cells.append(texts)
    return Sheet(title, tuple(heads), tuple(zip(*cells, strict=True)))


def by_row(title: str, key: str, keys: list[str], names: list[str], units: list[str], values: np.ndarray) -> Sheet:
    """One row a time or set, one column a joint; a unit that all joints share stands in the title."""
    kinds = list(dict.fromkeys(units))
    heads = names if len(kinds) == 1 else [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
    title = f"{title} [{kinds[0]}]" if len(kinds) == 1 else title
    cells = [keys, *(aligned(column) for column in values.T)]
    return Sheet(title, (key, *heads), tuple(zip(*cells, strict=True)), words=0)


STYLES = {"plain": "", "good": "green", "note": "yellow", "bad": "bold red", "dim": "dim", "head": "bold"}


class Screen:
    """Shows output on a terminal in colour, or as plain text where there is none."""

    def __init__(self, console: Console | None = None):
        """Args:
        console: by default standard output.
        """
        self.console = terminal.console() if console is None else console

    def __call__(self, output: Output) -> None:
        """Shows one line, table or drawing."""
        if isinstance(output, TextLine):
            from rich.text import Text

            self.console.print(Text(output.text, STYLES[output.style]), soft_wrap=not self.console.is_terminal)
        elif isinstance(output, Drawing):
            from armwright.pictures.terminal import show_runs

            show_runs(output.run, self.console, joints=output.joints, quantities=output.quantities)
        elif self.console.is_terminal:
            self.console.print(_table(output, self.console.width))
            self.console.print()
        else:
            self.console.file.write(printable(plain(output)) + "\n")

    def error(self, message: object) -> None:
        """Shows an error in one line."""
        self(TextLine(f"error: {' '.join(str(message).split())}", "bad"))


def _table(sheet: Sheet, width: int) -> Table:
    """A table for the terminal: words wrap, numbers never do, and a table too wide for the screen is shown in parts."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    parts = []
    for columns in _parts(sheet, width):
        table = Table(box=None, header_style="dim", pad_edge=False, padding=(0, 2, 0, 0))
        for k in columns:
            words = k < sheet.words
            table.add_column(
                Text(sheet.heads[k]),
                justify="left" if words else "right",
                style="cyan" if words and k == 0 else "",
                no_wrap=not words or k == 0,
                overflow="fold",
            )
        for row in sheet.rows:
            table.add_row(*(Text(row[k]) for k in columns))
        parts.append(table)
    title = [Text(sheet.title, "bold")] if sheet.title else []
    return Group(*title, *parts)  # type: ignore[return-value]


def _parts(sheet: Sheet, width: int) -> list[list[int]]:
    """Groups of columns that fit beside each other; the first column is in each of them."""
    if sheet.words > 1:
        return [list(range(len(sheet.heads)))]
    widths = [max(len(row[k]) for row in (sheet.heads, *sheet.rows)) + 2 for k in range(len(sheet.heads))]
    parts = [[0]]
    for k in range(1, len(widths)):
        if sum(widths[j] for j in parts[-1]) + widths[k] > width and len(parts[-1]) > 1:
            parts.append([0])
        parts[-1].append(k)
    return parts

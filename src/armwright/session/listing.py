"""What commands show: lines and sheets of numbers with units, for the screen and for the open output file."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import floor, isfinite, log10
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armwright.errors import SessionError
from armwright.output import whole_file

if TYPE_CHECKING:
    import xarray as xr

DIGITS = 6  # that the largest number of a column shows
MOST_DECIMALS = 8  # smaller numbers are shown with an exponent
NOTHING = 1e-12  # of any unit: less is rounding, and shown as 0


@dataclass(frozen=True)
class Line:
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
    """A run, to be drawn where it is shown; joints, quantities: which, as `plot` takes them."""

    run: xr.Dataset
    joints: Sequence[str] | None = None
    quantities: Sequence[str] | None = None


Shown = Line | Sheet | Drawing


@dataclass(frozen=True, eq=False)
class Listing:
    """Numbers for the screen or a file: sheets that people read, and all of it as columns of CSV, `tau_elbow [N m]` → (rows,)."""

    sheets: tuple[Sheet, ...]
    columns: dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Output:
    """The open output file: where it is, and all that was printed into it so far.

    Every printing writes the file anew, whole or not at all, so that it is complete at every moment.
    """

    path: Path
    text: str = ""
    head: tuple[str, ...] = field(default=())

    @property
    def is_csv(self) -> bool:
        """Whether its ending asks for CSV."""
        return self.path.suffix.lower() == ".csv"

    def printed(self, listing: Listing) -> Output:
        """The output with a listing behind what there is, written to disk.

        Raises:
            SessionError: a CSV file whose columns are others.   OutputError: the file cannot be written.
        """
        head = tuple(listing.columns)
        if self.is_csv:
            if self.head and self.head != head:
                raise SessionError(
                    f"{self.path}: holds the columns {', '.join(self.head[:3])}, …; these are {', '.join(head[:3])}, …: "
                    "expected the same ones, or close-output-file and another file"
                )
            text = self.text + _csv(listing, with_head=not self.head)
        else:
            text = self.text + "".join(plain(sheet) + "\n" for sheet in listing.sheets)
        with whole_file(self.path) as temporary:
            temporary.write_bytes(text.encode("utf-8"))
        return Output(self.path, text, head)


def _csv(listing: Listing, *, with_head: bool) -> str:
    """Floats in the fewest digits that read back to the same number."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    if with_head:
        writer.writerow(listing.columns)
    writer.writerows(zip(*(np.asarray(values).tolist() for values in listing.columns.values()), strict=True))
    return stream.getvalue()


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
    """A number by itself, in six digits; — where it is not known."""
    if not isfinite(value):
        return "—" if value != value else "∞" if value > 0 else "-∞"
    return f"{_settled(value):.{DIGITS}g}"


def _settled(value: float) -> float:
    """The number without rounding about 0, and without -0."""
    return 0.0 if abs(value) < NOTHING else float(value)


def aligned(values: Sequence[float] | np.ndarray) -> list[str]:
    """Numbers of one column, all with as many decimals as give the largest of them six digits."""
    sizes = [abs(float(v)) for v in values if isfinite(v) and _settled(v) != 0.0]
    decimals = DIGITS - 1 - floor(log10(max(sizes))) if sizes else 0
    if decimals > MOST_DECIMALS or decimals < -1:
        return [f"{_settled(v):.{DIGITS - 1}e}" if isfinite(v) else significant(v) for v in values]
    decimals = max(decimals, 0)
    return [_no_minus_zero(f"{float(v):.{decimals}f}") if isfinite(v) else significant(v) for v in values]


def _no_minus_zero(text: str) -> str:
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def shortest(values: Sequence[float] | np.ndarray) -> list[str]:
    """Times and the like: as few decimals as tell all of them, aligned."""
    texts = [f"{float(v) + 0.0:.9f}".rstrip("0").rstrip(".") for v in values]
    decimals = max((len(text.partition(".")[2]) for text in texts), default=0)
    return [f"{float(v) + 0.0:.{decimals}f}" for v in values]


def by_joint(title: str, names: Sequence[str], columns: Sequence[tuple[str, Sequence[str], np.ndarray]]) -> Sheet:
    """A row a joint; columns are (name, units, values (n,)). A unit of all joints stands in the head, else in the cells."""
    heads, cells = ["joint"], [list(names)]
    for name, units, values in columns:
        kinds = list(dict.fromkeys(units))
        told = [significant(value) for value in values]
        heads.append(f"{name} [{kinds[0]}]" if len(kinds) == 1 else name)
        if len(kinds) > 1:
            told = [f"{text} {unit}" for text, unit in zip(told, units, strict=True)]
        cells.append(told)
    return Sheet(title, tuple(heads), tuple(zip(*cells, strict=True)))

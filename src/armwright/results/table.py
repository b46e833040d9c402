"""A titled table of texts and numbers, as results give it: for a terminal, a page, a notebook, and with all digits as rows."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isnan
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult

UNIT = re.compile(r"\s*\[(?P<unit>[^\]]*)\]\s*$")
SHOWN, WIDEST = 24, 90  # rows of a table in a text, and letters of a cell; `rows` has all


class Cell(str):
    """Text of a number together with the number, so that rows and --json keep all digits.

    Attributes:
        value: the number, or the ends of a range; None if not known.
    """

    value: float | list[float] | None

    def __new__(cls, text: str, value: float | list[float] | None = None) -> Cell:
        """A cell of this text and value; copies and pickles give the text alone, and set the value then."""
        made = super().__new__(cls, text)
        made.value = value
        return made


def number(value: Any, form: str = ".5g") -> Cell:
    """A number as text; — if unknown, ∞ for an absent limit.

    Args:
        value: the number.   form: of the text, as `format` has it.
    """
    exact = None if value is None or isnan(float(value)) else float(value) + 0.0  # no -0
    text = "—" if exact is None else f"{exact:{form}}".replace("inf", "∞")
    return Cell(f"−{text[1:]}" if text.startswith("-") else text, exact)  # exponents keep the minus that programs read


@dataclass(frozen=True, eq=False)
class Table:
    """A title over rows of cells.

    Attributes:
        title: above it, if any.   heads: of the columns, with units in brackets.   cells: rows of them, texts or `number`s.
        left: heads of the columns that hold words, the first beside them.
    """

    title: str | None
    heads: Sequence[str]
    cells: Sequence[Sequence[Any]]
    left: Sequence[str] = ()

    @property
    def words(self) -> frozenset[int]:
        """Numbers of the columns that hold words."""
        return frozenset(k for k in range(len(self.heads)) if k == 0 or self.heads[k] in self.left)

    @property
    def used(self) -> list[int]:
        """Numbers of the columns with any entry."""
        return [k for k in range(len(self.heads)) if k == 0 or any(row[k] not in ("", "—") for row in self.cells)]

    @property
    def names(self) -> list[str]:
        """Names of the columns, without units; of those that have the same one, numbered."""
        names = [UNIT.sub("", head).strip() for head in self.heads]
        return [
            each if names.count(each) == 1 else f"{each} {names[:k].count(each) + 1}" for k, each in enumerate(names)
        ]

    @property
    def units(self) -> dict[str, str]:
        """Units by the names of their columns."""
        pairs = zip(self.names, map(UNIT.search, self.heads), strict=True)
        return {name: found["unit"] for name, found in pairs if found}

    def rows(self) -> list[dict[str, Any]]:
        """A dict for each row, name of the column → number, the two of a range, text, or None for an empty cell."""
        rows: list[dict[str, Any]] = []
        for row in self.cells:
            values = [_value(cell, k in self.words) for k, cell in enumerate(row)]
            if values[0] is None and rows:  # shown once for several rows
                values[0] = rows[-1][self.names[0]]
            rows.append(dict(zip(self.names, values, strict=True)))
        return rows

    def __str__(self) -> str:
        """Columns side by side, at most `SHOWN` rows and `WIDEST` letters of a cell."""
        used, shown = self.used, [[*map(_clipped, row)] for row in (self.heads, *self.cells[:SHOWN])]
        wide = {k: max(len(row[k]) for row in shown) for k in used}
        lines = [
            "  ".join(f"{row[k]:{'<' if k in self.words else '>'}{wide[k]}}" for k in used).rstrip() for row in shown
        ]
        more = len(self.cells) - SHOWN
        return "\n".join([*filter(None, [self.title]), *lines, *([f"… {more} more rows"] if more > 0 else [])])

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        from rich import table
        from rich.text import Text

        shown = table.Table(box=None, header_style="dim", pad_edge=False, padding=(0, 2, 0, 0))
        wide = sum(2 + max(map(len, [self.heads[k], *(str(row[k]) for row in self.cells)])) for k in self.used)
        for k in self.used:
            head = self.heads[k].replace(" [", "\n[") if wide > options.max_width else self.heads[k]  # the unit below
            shown.add_column(Text(head), justify="left" if k in self.words else "right", overflow="fold")
        for row in self.cells:
            shown.add_row(*(Text(str(row[k])) for k in self.used))
        if self.title is not None:
            yield Text(self.title, style="bold")
        yield shown


def table(
    title: str | None, heads: Sequence[str], rows: Iterable[Sequence[Any]], left: Sequence[str] = ()
) -> Table | None:
    """A table to show; None where only its first column has any entry.

    Args:
        title: above it, if any.   heads: of the columns.   rows: their cells.   left: heads of columns that hold words.
    """
    found = Table(title, heads, [list(row) for row in rows], left)
    return found if len(found.used) > 1 else None


def _clipped(cell: Any) -> str:
    text = str(cell)
    return text if len(text) <= WIDEST else f"{text[: WIDEST - 1].rstrip()}…"


def _value(cell: Any, word: bool) -> Any:
    """A number with all its digits, a word, or None for an empty cell."""
    if isinstance(cell, Cell):
        return cell.value
    if not isinstance(cell, str):
        return cell
    if cell in ("", "—"):
        return None
    try:
        return cell if word else int(cell) if cell.isdecimal() else float(cell.replace("−", "-").replace("∞", "inf"))
    except ValueError:
        return cell

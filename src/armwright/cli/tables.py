"""Tables that commands show: numbers to the right, units in the head."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from typing import TYPE_CHECKING, Any

from armwright.terminal import PrintableStream, console, gathering

if TYPE_CHECKING:
    import xarray as xr
    from rich.console import Console, ConsoleOptions, Group, RenderResult

WIDTH = 140  # columns, where no terminal says how many
MOTION = ("q", "qd", "tau", "voltage", "current")  # of a run, that an end state is told with
OVER_LANES = ("mean", "min", "max")


class Cell(str):
    """Text of a number together with the number, so that --json keeps all digits.

    Attributes:
        value: the number; None if not known.
    """

    value: float | None


def number(value: Any) -> Cell:
    """A number as text; — if unknown, ∞ for an absent limit."""
    exact = None if value is None or isnan(float(value)) else float(value) + 0.0  # no -0
    cell = Cell("—" if exact is None else f"{exact:.5g}".replace("inf", "∞").replace("-", "−"))
    cell.value = exact
    return cell


def console_for_tables() -> Console:
    """Standard output; where no terminal sets a width, wide enough for every table."""
    screen = console()
    if not screen.is_terminal:
        screen.width = WIDTH
    return screen


@dataclass(frozen=True, eq=False)
class Table:
    """A title over a table of texts.

    Attributes:
        title: above it, if any.   heads: of the columns, with units in brackets.   rows: their cells.
        words: numbers of the columns that hold words.   used: numbers of the columns with any entry.
    """

    title: str | None
    heads: Sequence[str]
    rows: Sequence[Sequence[Any]]
    words: frozenset[int]
    used: Sequence[int]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        from rich import table
        from rich.text import Text

        shown = table.Table(box=None, header_style="dim", pad_edge=False, padding=(0, 2, 0, 0))
        for k in self.used:
            shown.add_column(Text(self.heads[k]), justify="left" if k in self.words else "right", overflow="fold")
        for row in self.rows:
            shown.add_row(*(Text(row[k]) for k in self.used))
        if self.title is not None:
            yield Text(self.title, style="bold")
        yield shown


def table(
    title: str | None, heads: Sequence[str], rows: Iterable[Sequence[str]], left: Sequence[str] = ()
) -> Table | None:
    """Table with a title; the first column, and those named in `left`, are words and stand left.

    Columns without any entry are left out, and the whole of it where only the first column would be left.
    """
    rows = [list(row) for row in rows]
    used = [k for k in range(len(heads)) if k == 0 or any(row[k] not in ("", "—") for row in rows)]
    if len(used) == 1:
        return None
    words = frozenset(k for k in range(len(heads)) if k == 0 or heads[k] in left)
    return Table(title, heads, rows, words, used)


def show_columns(path: str | os.PathLike[str] | None, columns: Mapping[str, Any]) -> None:
    """Writes columns of equal length as CSV, to a file or, without a path, to standard output.

    Raises:
        OutputError: the file cannot be written.
    """
    from armwright.results.tables import write_table

    things = gathering()
    if path is None and things is not None:
        rows = list(zip(*(list(values) for values in columns.values()), strict=True))
        things.append(Table(None, list(columns), rows, frozenset(), range(len(columns))))
    else:
        write_table(path, columns, PrintableStream(sys.stdout))


def end_state(run: xr.Dataset) -> Group | None:
    """Joint positions and motor values at the end of a run, and the reducers' results; of lanes, statistics."""
    from rich.console import Group

    from armwright.results.recording import run_units

    parts = []
    if "time" in run.coords:
        last = run.isel(time=-1)
        shown = {name: run_units(run, name) for name in MOTION if name in run}
        parts.append(_of_joints(last, shown, f"at the end, t = {float(last['time']):g} s"))
    reduced = [str(name) for name, v in run.data_vars.items() if v.dims in (("joint",), ("lane", "joint"))]
    if reduced:
        shown = {name: [str(run[name].attrs.get("units", "-"))] for name in reduced}
        parts.append(_of_joints(run, shown, "of the whole run"))
    return Group(*(part for part in parts if part is not None)) if parts else None


def lanes_that_stopped(run: xr.Dataset) -> int:
    """Number of lanes that diverged or ran out of steps."""
    return sum(int(run[name].notnull().sum()) for name in ("diverged_at", "stalled_at") if name in run)


def _of_joints(run: xr.Dataset, shown: Mapping[str, Sequence[str]], title: str) -> Table | Group | None:
    """A row for each joint of variables (joint,), with their units; of (lane, joint), a row for each of some statistics."""
    from rich.console import Group
    from rich.text import Text

    from armwright.results.statistics import statistics

    heads = [f"{name} [{' | '.join(dict.fromkeys(units))}]" for name, units in shown.items()]
    joints = [str(joint) for joint in run["joint"].values]
    if "lane" not in run.dims:
        rows = [[joint, *(number(run[name].values[k]) for name in shown)] for k, joint in enumerate(joints)]
        return table(title, ["joint", *heads], rows)
    lanes, stopped = run.sizes["lane"], lanes_that_stopped(run)
    if stopped == lanes:
        return Group(Text(f"{title}: none of the {lanes} lanes came to its end", style="bold"))
    figures = statistics(run[[*shown, *({"diverged_at", "stalled_at"} & set(run.data_vars))]], ()).sel(
        statistic=list(OVER_LANES)
    )
    rows = [
        [joint if k == 0 else "", name, *(number(figures[each].values[k][j]) for each in shown)]
        for j, joint in enumerate(joints)
        for k, name in enumerate(OVER_LANES)
    ]
    over = (
        f"over {lanes} lanes" if not stopped else f"over the {lanes - stopped} of {lanes} lanes that came to their end"
    )
    return table(f"{title}, {over}", ["joint", "over lanes", *heads], rows, left=["over lanes"])

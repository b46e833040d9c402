"""Tables that commands show: numbers to the right, units in the head."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from armwright.results.table import Table, number, table
from armwright.terminal import PrintableStream, console, gathering, result, say

if TYPE_CHECKING:
    import xarray as xr
    from rich.console import Console, Group

    from armwright.results.result import Result

WIDTH = 140  # columns, where no terminal says how many
MOTION = ("q", "qd", "tau", "voltage", "current")  # of a run, that an end state is told with
OVER_LANES = ("mean", "min", "max")


def console_for_tables() -> Console:
    """Standard output; where no terminal sets a width, wide enough for every table."""
    screen = console()
    if not screen.is_terminal:
        screen.width = WIDTH
    return screen


def show(found: Result) -> None:
    """Shows a result: its tables, then its sentences; all of it with --json."""
    screen, tables = console_for_tables(), [each for each in found.tables() if len(each.used) > 1]
    for each in tables:
        screen.print(each)
    result(found)
    if tables:
        say("")
    for each in found.sentences():
        say(each)


def show_columns(path: str | os.PathLike[str] | None, columns: Mapping[str, Any]) -> None:
    """Writes columns of equal length as CSV, to a file or, without a path, to standard output.

    Raises:
        OutputError: the file cannot be written.
    """
    from armwright.results.csv_tables import write_table

    things = gathering()
    if path is None and things is not None:
        rows = list(zip(*(list(values) for values in columns.values()), strict=True))
        things.append(Table(None, list(columns), rows))
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

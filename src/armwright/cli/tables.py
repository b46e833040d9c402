"""Tables that commands show: numbers to the right, units in the head."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isnan
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr
    from rich.console import Console, Group

WIDTH = 140  # columns, where no terminal says how many


def number(value: Any) -> str:
    """A number as people read it; — for one that is not known, ∞ for a limit that there is not."""
    if value is None or isnan(float(value)):
        return "—"
    value = float(value) + 0.0  # no -0
    return f"{value:.5g}".replace("inf", "∞").replace("-", "−")


def console_for_tables() -> Console:
    """Standard output; where no terminal sets a width, wide enough for every table."""
    from rich.console import Console

    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console.width = WIDTH
    return console


def table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]], left: Sequence[str] = ()) -> Group | None:
    """A title and a table whose first column, and those named in `left`, hold words.

    Columns without any entry are left out, and the whole of it where only the first column would be left.
    """
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    rows = [list(row) for row in rows]
    used = [k for k in range(len(heads)) if k == 0 or any(row[k] not in ("", "—") for row in rows)]
    if len(used) == 1:
        return None
    shown = Table(box=None, header_style="dim", pad_edge=False, padding=(0, 2, 0, 0))
    for k in used:
        words = k == 0 or heads[k] in left
        shown.add_column(Text(heads[k]), justify="left" if words else "right", overflow="fold")
    for row in rows:
        shown.add_row(*(Text(row[k]) for k in used))
    return Group(Text(title, style="bold"), shown)


def end_state(run: xr.Dataset) -> Group | None:
    """Where every joint is at the end of a run, and what its motor does there."""
    from armwright.simulation.recording import run_units

    if "time" not in run.coords:
        return _reduced(run)
    last = run.isel(time=-1)
    shown = [name for name in ("q", "qd", "tau", "voltage", "current") if name in run]
    units = {name: list(dict.fromkeys(run_units(run, name))) for name in shown}
    heads = ["joint", *(f"{name} [{' | '.join(units[name])}]" for name in shown)]
    rows = [
        [str(joint), *(number(last[name].values[k]) for name in shown)] for k, joint in enumerate(run["joint"].values)
    ]
    return table(f"at the end, t = {float(last['time']):g} s", heads, rows)


def _reduced(run: xr.Dataset) -> Group | None:
    """What the reducers of a run without a record came to: of every joint, the mean of the lanes."""
    means = run.mean(dim="lane") if "lane" in run.dims else run
    shown = [str(name) for name, variable in means.data_vars.items() if variable.dims == ("joint",)]
    heads = ["joint", *(f"{name} [{run[name].attrs.get('units', '-')}]" for name in shown)]
    rows = [
        [str(joint), *(number(means[name].values[k]) for name in shown)] for k, joint in enumerate(run["joint"].values)
    ]
    return table(f"mean of {run.sizes['lane']} lanes" if "lane" in run.dims else "of the whole run", heads, rows)

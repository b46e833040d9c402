"""`armwright plot`: runs as a picture, as a page to explore, or in the terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import armwright as aw
from armwright.cli.arguments import argument, option, output_option
from armwright.errors import RunError
from armwright.terminal import say

if TYPE_CHECKING:
    import xarray as xr


def plot(
    runs: list[Path] = argument("RUN…", "Runs saved as .nc."),
    joints: str | None = option("NAME,…", "Joints to draw, by name or number; default all."),
    quantities: str | None = option(
        "NAME,…",
        "What to draw, such as q,qd,tau or theta,omega,torque; by default positions, velocities, "
        "torques and commands of the drives.",
    ),
    output: Path | None = output_option(
        "FILE", "Where to: .html (zoom, read off values), .png, .svg or .pdf; without it, the terminal."
    ),
) -> None:
    """Draw runs: in the terminal, as a picture, or as an offline page with zoom.

    Runs of the same joints are compared, each with its own line style.

    \b
    Examples:
      armwright plot run.nc
      armwright plot run.nc -o run.html
      armwright plot before.nc after.nc --joints joint2,joint3 --quantities q,tau -o compared.html
    """
    from armwright.cli.tables import console_for_tables
    from armwright.pictures.terminal import show_runs
    from armwright.results.plot import check_plot

    if output is not None:
        check_plot(output)
    named = _by_name(runs)
    chosen = {"joints": _names("--joints", joints), "quantities": _names("--quantities", quantities)}
    if output is None:
        show_runs(named, console_for_tables(), **chosen)
    else:
        aw.plot(named, output, **chosen)
        say(f"wrote {output}")


def _by_name(paths: list[Path]) -> dict[str, xr.Dataset]:
    """Each run by its file's name; where two are alike, by its path.

    Raises:
        RunError: a file that is no run, or is named twice.
    """
    alike = len({path.name for path in paths}) < len(paths)
    runs: dict[str, xr.Dataset] = {}
    for path in paths:
        name = str(path) if alike else path.name
        if name in runs:
            raise RunError("named twice", file=path, expected="different runs")
        runs[name] = aw.load_run(path)
    return runs


def _names(option: str, text: str | None) -> list[str] | None:
    """`"q,tau"` as a list.

    Raises:
        RunError: nothing between two commas.
    """
    if text is None:
        return None
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise RunError("an empty name", place=option, value=text, expected="names with commas between")
    return names

"""Runs beside each other: as a page to explore, zoom into and read off, or as a picture; nothing is fetched."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from armwright.output import check_destination, whole_file
from armwright.pictures.curves import partial_note, plot_data, selected
from armwright.pictures.page import embedded, page
from armwright.pictures.picture import draw_runs
from armwright.simulation.results.plot import BAND, FEW_LANES
from armwright.simulation.results.spoken import variables

if TYPE_CHECKING:
    import xarray as xr

PAGES, PICTURES = (".html",), (".png", ".svg", ".pdf")
ENDINGS = (*PAGES, *PICTURES)


def plot_runs(
    runs: Mapping[str, xr.Dataset],
    path: str | os.PathLike[str],
    *,
    joints: Sequence[str] | None = None,
    quantities: Sequence[str] | None = None,
) -> None:
    """Draws runs of the same joints into one file; whole or not at all.

    A page (.html) has every sample in single precision, so that zooming in shows them all; it works without a network.

    Args:
        runs: what each is called → the run: `{"before": run1, "after": run2}`; of several each has a line style.
        path: the file, ending in .html, .png, .svg or .pdf.
        joints: those to be drawn, by name or by number from 1; None: all.
        quantities: what to draw of them, such as ("q", "tau") or ("theta", "torque");
            None: what `plot` draws, with the references.
    Raises:
        RunError: no run, a joint or a quantity that it has not, runs of arms with different joints.
        OutputError: another ending, a folder that is missing, no permission, a full disk.
    """
    path = check_destination(path, ENDINGS)
    chosen, quantities = selected(runs, joints, quantities), variables(quantities)
    robots = ", ".join(dict.fromkeys(str(run.attrs.get("robot", "run")) for run in chosen.values()))
    if path.suffix.lower() in PICTURES:
        figure = draw_runs(chosen, quantities, robots, _note(chosen))
        with whole_file(path, ENDINGS) as temporary:
            figure.savefig(temporary, format=temporary.suffix[1:].lower())
        return
    plot, numbers = plot_data(chosen, quantities)
    words = {"title": f"{robots}: {', '.join(chosen)}", "heading": robots, "subtitle": ", ".join(chosen)}
    words["note"] = _note(chosen)
    html = page("plot.html", ("unpack.js", "charts.js"), ("page.css",), words, plot=embedded(plot), numbers=numbers)
    with whole_file(path, ENDINGS) as temporary:
        temporary.write_text(html, encoding="utf-8")


def _note(runs: Mapping[str, xr.Dataset]) -> str:
    partial = partial_note(runs)
    return " ".join(filter(None, (_lanes(runs), f"{partial}." if partial else "")))


def _lanes(runs: Mapping[str, xr.Dataset]) -> str:
    lanes = max(run.sizes.get("lane", 1) for run in runs.values())
    if lanes > FEW_LANES:
        return f"{lanes} lanes: median, and the band from {100 * BAND[0]:g} to {100 * BAND[1]:g} %."
    return f"{lanes} lanes." if lanes > 1 else ""

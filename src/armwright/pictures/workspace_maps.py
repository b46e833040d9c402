"""Pictures of a workspace: maps from above and from the side, coloured by manipulability, and histograms."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from armwright.output import check_destination, whole_file
from armwright.results.plot import EDGE, GRID, TEXT, save_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ENDINGS = (".png", ".svg", ".pdf", ".html")
CELLS = 110  # of a map along its longer side
BINS = 120  # of a histogram
COLOURS = "viridis"
BAR = "#3B6EA8"


def draw_workspace(dataset: xr.Dataset, path: str | os.PathLike[str]) -> None:
    """Draws a workspace: a still picture of maps and histograms, or a page (.html) with a cloud of points to turn.

    Args:
        dataset: what `workspace` returned.   path: ending in .png, .svg, .pdf or .html; replaced where it exists.
    Raises:
        OutputError: an unknown ending, a folder that is missing, no permission, a full disk.
    """
    path = check_destination(path, ENDINGS)
    with whole_file(path, ENDINGS) as temporary:
        ending = path.suffix[1:].lower()
        if ending == "html":
            from armwright.pictures.workspace_cloud import cloud_page

            temporary.write_text(cloud_page(dataset), encoding="utf-8")
        else:
            save_figure(draw(dataset), temporary, ending)


def draw(dataset: xr.Dataset) -> Figure:
    """Four panels: mean manipulability from above and from the side, and how often distances and measures occur."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.5, 8.6), dpi=100, layout="constrained", facecolor="white")
    (above, side), (reach, measure) = figure.subplots(2, 2, height_ratios=(2.1, 1.0))
    position, w = dataset.position.values, dataset.manipulability.values
    unit = dataset.manipulability.attrs["units"]
    label = f"mean manipulability [{unit}]"
    _map(above, position[:, 0], position[:, 1], w, ("x [m]", "y [m]", "From above", label))
    radius = np.hypot(position[:, 0], position[:, 1])
    words = ("distance from the base's z axis [m]", "z [m]", "From the side, all directions together", label)
    _map(side, radius, position[:, 2], w, words)
    _histogram(reach, dataset, "reach", "distance from the base's origin [m]", "Reach")
    _histogram(measure, dataset, "manipulability", f"manipulability [{unit}]", "Manipulability")
    a = dataset.attrs
    rows = "" if a["aim"] == "position" else f", 1 rad as {a['length']:g} m"
    note = f"{a['samples']:,} joint positions within the limits, {a['aim']} of {a['frame']}{rows}"
    figure.suptitle(f"{a['arm']}: workspace\n{note}", x=0.012, ha="left", fontsize=13, fontweight="bold", color=TEXT)
    return figure


def _map(axis: Axes, x: np.ndarray, y: np.ndarray, values: np.ndarray, words: tuple[str, str, str, str]) -> None:
    """Mean of values in square cells; cells that no sample reached stay empty."""
    span = max(np.ptp(x), np.ptp(y), 1e-6)
    cells = [max(int(np.ceil(CELLS * np.ptp(each) / span)), 1) for each in (x, y)]
    edges = [each.min() + span / CELLS * np.arange(n + 1) for each, n in zip((x, y), cells, strict=True)]
    counts = np.histogram2d(x, y, edges)[0]
    total = np.histogram2d(x, y, edges, weights=values)[0]
    with np.errstate(invalid="ignore"):
        mean = np.where(counts > 0, total / counts, np.nan)
    mesh = axis.pcolormesh(*edges, mean.T, cmap=COLOURS, vmin=0.0, rasterized=True)
    axis.set_aspect("equal")
    assert axis.figure is not None
    axis.figure.colorbar(mesh, ax=axis, shrink=0.85).set_label(words[3], color=TEXT)
    _style(axis, words[0], words[1], words[2])


def _histogram(axis: Axes, dataset: xr.Dataset, name: str, label: str, title: str) -> None:
    """Share of the samples, with the median and the 1st and 99th percentile."""
    values = dataset[name].values
    axis.hist(values, BINS, weights=np.full(len(values), 100.0 / len(values)), color=BAR)
    percentiles = dataset[f"{name}_percentiles"]
    for share, dash in ((1.0, ":"), (50.0, "--"), (99.0, ":")):
        axis.axvline(float(percentiles.sel(percentile=share)), color=TEXT, linestyle=dash, linewidth=1.0)
    low, middle, high = (float(percentiles.sel(percentile=share)) for share in (1.0, 50.0, 99.0))
    _style(axis, label, "samples [%]", f"{title}: median {middle:.3g}, 98 % in {low:.3g} … {high:.3g}")


def _style(axis: Axes, x: str, y: str, title: str) -> None:
    axis.set_xlabel(x, color=TEXT)
    axis.set_ylabel(y, color=TEXT)
    axis.set_title(title, loc="left", fontsize=10.5, color=TEXT, fontweight="bold")
    axis.set_axisbelow(True)
    axis.grid(color=GRID, linewidth=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    axis.spines[["left", "bottom"]].set_color(EDGE)
    axis.tick_params(color=EDGE, labelcolor=TEXT, labelsize=9)

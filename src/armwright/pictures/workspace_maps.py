"""Pictures of a workspace: maps from above and from the side, coloured by manipulability, and histograms."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from armwright.entry import AnyRun, as_run
from armwright.output import check_destination, whole_file
from armwright.pictures.workspace_cloud import cloud_page
from armwright.results.plot import ENDINGS, TEXT, frame, write_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CELLS, FEWEST, EACH = 110, 20, 20  # of a map along its longer side, at most and at least; samples of a cell on average
FLAT = 1e-3  # of the largest extent: a smaller one is none
SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
BINS = 120  # of a histogram
COLOURS = "viridis"
BAR = "#3B6EA8"


def draw_workspace(dataset: AnyRun, path: str | os.PathLike[str]) -> None:
    """Draws a workspace: a still picture of maps and histograms, or a page (.html) with a rotatable point cloud.

    Args:
        dataset: what `workspace` returned.   path: ending in .png, .svg, .pdf or .html; replaced where it exists.
    Raises:
        OutputError: an unknown ending, a folder that is missing, no permission, a full disk.
    Example:
        >>> reach = aw.kinematics.workspace("two-link", samples=2000)
        >>> aw.pictures.draw_workspace(reach, "reach.png")
    """
    dataset = as_run(dataset, "dataset")
    path = check_destination(path, ENDINGS)
    if path.suffix.lower() != ".html":
        return write_figure(draw(dataset), path)
    flat = bool(flat_axes(dataset.position.values))
    with whole_file(path, ENDINGS) as temporary:
        temporary.write_text(cloud_page(dataset, readable_unit(dataset), flat), encoding="utf-8")


def draw(dataset: xr.Dataset) -> Figure:
    """Four panels: mean manipulability from above and from the side, and how often distances and measures occur.

    Tips that stay in a plane are seen from in front of it, and instead of a second map the manipulability over their distance.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.5, 8.6), dpi=100, layout="constrained", facecolor="white")
    (left, right), (reach, measure) = figure.subplots(2, 2, height_ratios=(2.1, 1.0))
    position, w = dataset.position.values, dataset.manipulability.values
    unit = readable_unit(dataset)
    label = f"mean manipulability [{unit}]"
    flat = flat_axes(position)
    seen = "xyz".translate(str.maketrans("", "", flat[-1:]))  # of a line in space two axes all the same
    across, up = (position[:, "xyz".index(axis)] for axis in seen[:2])
    from_where = "From above" if seen == "xyz" or flat == "z" else f"From in front of the {seen} plane"
    _map(left, across, up, w, (f"{seen[0]} [m]", f"{seen[1]} [m]", from_where, label))
    if flat:
        where = " and ".join(f"{axis} = {np.median(position[:, 'xyz'.index(axis)]):.3g} m" for axis in flat)
        _profile(
            right,
            dataset.reach.values,
            w,
            ("distance from the base's origin [m]", label, f"All tips at {where}: mean and range"),
        )
    else:
        radius = np.hypot(position[:, 0], position[:, 1])
        words = ("distance from the base's z axis [m]", "z [m]", "From the side, turned together", label)
        _map(right, radius, position[:, 2], w, words)
    _histogram(reach, dataset, "reach", "distance from the base's origin [m]", "Reach")
    _histogram(measure, dataset, "manipulability", f"manipulability [{unit}]", "Manipulability")
    a = dataset.attrs
    rows = "" if a["aim"] == "position" else f", 1 rad as {a['length']:g} m"
    note = f"{a['samples']:,} joint positions within the limits, {a['aim']} of {a['frame']}{rows}"
    figure.suptitle(f"{a['arm']}: workspace\n{note}", x=0.012, ha="left", fontsize=13, fontweight="bold", color=TEXT)
    return figure


def readable_unit(dataset: xr.Dataset) -> str:
    """Unit of the manipulability, with a raised exponent."""
    base, _, exponent = dataset.manipulability.attrs["units"].partition("^")
    return base + exponent.translate(SUPERSCRIPTS)


def flat_axes(position: np.ndarray) -> str:
    """Names of the base's axes along which positions (k, 3) do not extend."""
    extent = np.ptp(position, axis=0)
    return "".join(axis for axis, each in zip("xyz", extent, strict=True) if each <= FLAT * extent.max())


def _profile(axis: Axes, x: np.ndarray, values: np.ndarray, words: tuple[str, str, str]) -> None:
    """Mean of values over x, and the least and largest of each bin."""
    edges = np.linspace(x.min(), x.max() if np.ptp(x) > 0.0 else x.min() + 1e-6, _cells(len(x)) + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    middle = 0.5 * (edges[1:] + edges[:-1])
    counts = np.bincount(place, minlength=len(middle))
    least, most = np.full(len(middle), np.inf), np.full(len(middle), -np.inf)
    np.minimum.at(least, place, values)
    np.maximum.at(most, place, values)
    some = counts > 0
    mean = np.bincount(place, values, len(middle))[some] / counts[some]
    axis.fill_between(middle[some], least[some], most[some], color=BAR, alpha=0.25, linewidth=0.0)
    axis.plot(middle[some], mean, color=BAR)
    axis.set_ylim(0.0, 1.1 * max(float(values.max()), np.finfo(float).tiny))
    _style(axis, *words)


def _cells(samples: int) -> int:
    """Cells along the longer side of a map: few samples would leave holes in many."""
    return int(np.clip(np.sqrt(samples / EACH), FEWEST, CELLS))


def _map(axis: Axes, x: np.ndarray, y: np.ndarray, values: np.ndarray, words: tuple[str, str, str, str]) -> None:
    """Mean of values in square cells; cells that no sample reached stay empty."""
    span = max(np.ptp(x), np.ptp(y), 1e-6)
    longest = _cells(len(x))
    cells = [max(int(np.ceil(longest * np.ptp(each) / span)), 1) for each in (x, y)]
    edges = [each.min() + span / longest * np.arange(n + 1) for each, n in zip((x, y), cells, strict=True)]
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
    frame(axis, title)

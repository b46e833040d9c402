"""Pictures of gain regions: gains of a joint that keep the margins, for several delays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from armwright.control.analysis.regions import GainRegion

COLOURS = ("#9ec9ee", "#4f8fce", "#1f4e8c")  # from the smallest to the largest delay
# of the loop's own gains: seen on all of these, on light pages and on dark ones
OWN: Any = {"color": "#e8590c", "marker": "x", "markersize": 8, "markeredgewidth": 2.5, "linestyle": "none"}
COLUMNS = 3
NEAREST = 0.05  # steps of the grid: so near to a point the drawn edge may pass


def edge_distance(keeps: np.ndarray) -> np.ndarray:
    """Distance from the edge of a region in steps of the grid, above 0 inside, smoothed: its contour at 0 has no stairs.

    Args:
        keeps: (rows, columns) true inside. The contour separates these points from the others exactly as they are.
    """
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    framed = np.pad(keeps, 1, mode="edge")
    if framed.all() or not framed.any():
        return np.where(keeps, 1.0, -1.0)
    inside, outside = (np.asarray(distance_transform_edt(each)) for each in (framed, ~framed))
    smooth = gaussian_filter(inside - outside, 1.0, mode="nearest")[1:-1, 1:-1]
    return np.where(keeps, np.maximum(smooth, NEAREST), np.minimum(smooth, -NEAREST))


def draw_regions(figure: Figure, regions: Sequence[Sequence[GainRegion]], delays: Sequence[float], ink: str) -> None:
    """Draws a panel for each joint: the region for each delay, the larger delay inside the smaller, and the loop's own gains.

    Args:
        figure: to draw in.   regions: for each joint those of the delays, in their order.   delays: [s] of the loop.
        ink: colour of words and axes.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.ticker import LogLocator, NullFormatter

    rows = -(-len(regions) // COLUMNS)
    axes = np.atleast_1d(figure.subplots(rows, min(COLUMNS, len(regions)), squeeze=False)).ravel()
    for axis in axes[len(regions) :]:
        axis.set_visible(False)
    for axis, each in zip(axes, regions, strict=False):
        first, second = each[0].values
        for region, colour in zip(each, COLOURS, strict=False):
            axis.contourf(second, first, edge_distance(region.keeps), levels=[0.0, np.inf], colors=[colour])
        axis.plot(each[0].own[1], each[0].own[0], **OWN)
        axis.set(xscale="log", yscale="log", xlim=(second[0], second[-1]), ylim=(first[0], first[-1]))
        for which in (axis.xaxis, axis.yaxis):
            which.set_major_locator(LogLocator(numticks=5))
            which.set_minor_formatter(NullFormatter())
        axis.set_title(each[0].joint, loc="left", fontsize=10, color=ink)
        labels = [f"{name} [{unit}]" if unit else name for name, unit in zip(each[0].names, each[0].units, strict=True)]
        axis.set_ylabel(labels[0], color=ink, fontsize=9)
        axis.set_xlabel(labels[1], color=ink, fontsize=9)
        axis.tick_params(colors=ink, which="both", labelsize=8)
        axis.set_facecolor("none")
        for spine in axis.spines.values():
            spine.set_color(ink)
    marks: list[Any] = [
        Patch(color=colour, label=f"{1e3 * delay:.3g} ms of delay")
        for colour, delay in zip(COLOURS, delays, strict=False)
    ]
    marks.append(Line2D([], [], label="the scenario's gains", **OWN))
    figure.legend(
        handles=marks, loc="outside lower center", ncols=len(marks), frameon=False, fontsize=9, labelcolor=ink
    )

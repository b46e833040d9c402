"""Picture of compared controllers: the tool's distance from its path, and the joints' errors over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.results.plot_curves import COLOURS

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

MOST_ROWS = 12  # panels below each other that can still be read


def draw_comparison(figure: Figure, data: xr.Dataset, ink: str) -> None:
    """Draws a row for each motion and payload and a curve for each controller.

    Args:
        figure: to draw in.   data: of a comparison, of which at most `MOST_ROWS` rows are drawn.   ink: colour of words.
    """
    cases = [(m, p) for m in range(data.sizes["motion"]) for p in range(data.sizes["payload"])][:MOST_ROWS]
    units = [unit for unit in ("rad", "m") if (data["unit"] == unit).any()]
    tool = bool(data["deviation"].notnull().any())
    axes = figure.subplots(len(cases), len(units) + tool, squeeze=False)
    for row, (m, p) in zip(axes, cases, strict=True):
        case = data.isel(motion=m, payload=p)
        payload = "" if data.sizes["payload"] == 1 else f", {data['payload'].values[p]}"
        row[0].set_title(f"{data['motion'].values[m]}{payload}", loc="left", fontsize=10, color=ink)
        for c, name in enumerate(data["controller"].values):
            _draw_case(row, case.isel(controller=c), units, tool, str(name), COLOURS[c % len(COLOURS)], ink)
        for axis in row:
            axis.set_ylim(bottom=0.0)
            axis.grid(color="#dddddd", linewidth=0.6)
            axis.tick_params(colors=ink, labelsize=8)
            axis.spines[["top", "right"]].set_visible(False)
            axis.set_facecolor("none")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=min(len(labels), 4),
        frameon=False,
        fontsize=9,
        labelcolor=ink,
    )


def _draw_case(row: Any, case: Any, units: list[str], tool: bool, name: str, colour: str, ink: str) -> None:
    """A controller's curves in the panels of a motion and payload."""
    if tool:
        row[0].plot(100.0 * case["point"], 1e3 * case["deviation"], color=colour, label=name, linewidth=1.4)
        row[0].set_xlabel("along the path [%]", fontsize=9, color=ink)
        row[0].set_ylabel("tool off its path [mm]", fontsize=9, color=ink)
    for axis, unit in zip(row[int(tool) :], units, strict=True):
        worst = np.max(case["error"].values[:, case["unit"].values == unit], axis=1)
        axis.plot(case["instant"] * float(case["watched"]), worst, color=colour, label=name, linewidth=1.4)
        axis.set_xlabel("time [s]", fontsize=9, color=ink)
        axis.set_ylabel(f"largest joint error [{unit}]", fontsize=9, color=ink)

"""Pictures in pages, as SVG whose colours are those of the page, light or dark."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Stand-ins that matplotlib draws with; the page's own colours take their place.
INK, QUIET, GRID, PREDICTED, RESIDUAL = "#010101", "#020202", "#030303", "#040404", "#050505"
VARIABLES = {INK: "--ink", QUIET: "--quiet", GRID: "--faint", PREDICTED: "--accent", RESIDUAL: "--residual"}
POINTS = 1200  # of a curve: of more rows the lowest and the highest of each group
SIZE = 9.0
MARGINS = (0.75, 0.5, 0.12, 0.3)  # left (at least), below, right, above [inch]
BESIDE, CHARACTER = 0.35, 0.082  # [inch] of the left margin: an axis's name, and each character of its numbers


def curve(axis: Axes, t: np.ndarray, values: np.ndarray, colour: str, label: str | None) -> None:
    """Draws values (k,) over times t (k,), of many rows the lowest and the highest of each group."""
    group = -(-len(t) // (POINTS // 2))
    if group > 1:
        rows = len(t) // group * group
        groups = np.where(np.isfinite(values[:rows]), values[:rows], 0.0).reshape(-1, group)
        both = np.sort(np.stack([groups.argmin(1), groups.argmax(1)]), axis=0) + np.arange(0, rows, group)
        t, values = t[both.T.ravel()], values[both.T.ravel()]
    axis.plot(t, values, color=colour, linewidth=1.0, label=label)


def ink_axes(axis: Axes, ink: str) -> None:
    """Draws axes in the colour of words, without a box and a background."""
    axis.tick_params(colors=ink)
    axis.set_facecolor("none")
    axis.spines[["top", "right"]].set_visible(False)
    axis.spines[["left", "bottom"]].set_color(ink)


def words(axis: Axes, below: str, left: str) -> None:
    """Writes the axes' names in the page's colours, with a grid and without a box."""
    axis.set_xlabel(below, color=QUIET, fontsize=SIZE)
    axis.set_ylabel(left, color=QUIET, fontsize=SIZE)
    axis.tick_params(which="both", colors=QUIET, labelsize=SIZE)
    axis.grid(color=GRID, linewidth=0.7)
    axis.set_facecolor("none")
    axis.spines[["top", "right"]].set_visible(False)
    axis.spines[["left", "bottom"]].set_color(QUIET)


def _longest_number(figure: Figure) -> int:
    """Characters of the longest number beside the vertical axes on the left."""
    from matplotlib.axes import Axes

    longest = 0
    for axis in figure.axes:
        if isinstance(axis, Axes) and axis.get_ylabel():
            low, high = sorted(axis.get_ylim())
            places = [place for place in axis.yaxis.get_majorticklocs() if low <= place <= high]
            longest = max([longest, *map(len, axis.yaxis.get_major_formatter().format_ticks(places))])
    return longest


def page_svg(draw: Callable[[Figure], None], size: Sequence[float], layout: str | None = None) -> str:
    """The picture as an SVG element with the page's colours and its font.

    Args:
        draw: draws it, with the stand-ins of this file for the page's colours.   size: width and height [inch].
        layout: of matplotlib; None: fixed margins, since a computed layout takes most of the time.
    """
    import matplotlib
    from matplotlib.figure import Figure

    style: Any = {
        "svg.fonttype": "none",
        "svg.hashsalt": "armwright",
        "font.family": "sans-serif",
        "path.simplify_threshold": 0.5,
    }
    with matplotlib.rc_context(style):
        figure = Figure(figsize=(size[0], size[1]), facecolor="none", layout=layout)  # type: ignore[arg-type]
        left, below, right, above = (inches / size[k % 2] for k, inches in enumerate(MARGINS))
        if layout is None:
            figure.subplots_adjust(left, below, 1.0 - right, 1.0 - above, wspace=0.12, hspace=0.12)
        draw(figure)
        if layout is None:
            figure.subplots_adjust(left=max(left, (BESIDE + CHARACTER * _longest_number(figure)) / size[0]))
        file = io.StringIO()
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    text = file.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    for colour, variable in VARIABLES.items():
        text = text.replace(colour, f"var({variable})")
    return text

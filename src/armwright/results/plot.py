"""Plots of runs over time, as a matplotlib figure or a file.

| ending            | content                                                                                      |
|-------------------|----------------------------------------------------------------------------------------------|
| .png, .svg, .pdf  | a still picture                                                                              |
| .html             | a page to zoom into, to read values from and to hide curves in; it needs no network          |
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from armwright.entry import AnyRun
from armwright.output import check_destination, whole_file, write_whole
from armwright.results.plot_curves import BAND_OPACITY, Curve, Panel, Plot, Style, describe
from armwright.results.plot_page import plot_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Runs = AnyRun | Mapping[str, AnyRun] | Sequence[AnyRun]
    Names = str | Sequence[str] | None

PICTURES = (".png", ".svg", ".pdf")
ENDINGS = (*PICTURES, ".html")
TEXT, GRID, EDGE = "#222222", "#D9D9D9", "#888888"
LEVEL = 1e-9  # relative: curves that differ by less are level, and their rounding is not blown up to the panel's height
UNDATED = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {"Software": None}}  # equal runs: equal bytes
LEGEND_ROWS = 24
WIDE_LEGEND = 24  # letters: longer names stand below the panels and not beside them


@overload
def plot(runs: Runs, path: None = None, *, joints: Names = None, quantities: Names = None) -> Figure: ...


@overload
def plot(
    runs: Runs,
    path: str | os.PathLike[str],
    *,
    joints: Names = None,
    quantities: Names = None,
) -> None: ...


def plot(
    runs: Runs,
    path: str | os.PathLike[str] | None = None,
    *,
    joints: Names = None,
    quantities: Names = None,
) -> Figure | None:
    """Figure of one run or of several beside each other; with a path it is written to that file, whole or not at all.

    A colour is a joint and a dash pattern a run; of a single joint of several runs, a colour is a run. Up to twelve lanes are
    drawn as a curve each, more as their median and the bands that hold half and nine out of ten of them. A page (.html) has
    every sample in single precision, so that zooming in shows them all.

    Args:
        runs: what `simulate` returned, its file, or a part of it such as `run.isel(joint=0)`; or several by name,
            `{"before": run1, "after": run2}`; or a list of runs. Several must have the same joints.
        path: file ending in .png, .svg, .pdf or .html; None: the figure is returned.
        joints: one or several names, or numbers from 1; None: all.
        quantities: one or several variables of the run, or the session's names of them, such as ("q", "tau") or
            ("theta", "torque"); None: positions, velocities, torques and the drives' voltages or currents, with their references.
    Returns:
        figure: a matplotlib figure that does not belong to pyplot and that notebooks show by themselves; None if it was written
            to a file.
    Raises:
        RunError: no run, an unknown joint or quantity, runs of arms with different joints, nothing finite to draw.
        OutputError: an unknown ending, a folder that is missing, no permission, a full disk.
    Example:
        >>> run = aw.simulate(aw.Scenario("two-link", 0.2, command=[0.0, 0.0]))
        >>> aw.plot(run, "fall.png")
    """
    path = None if path is None else check_plot(path)
    described = describe(runs, joints, quantities)
    return draw(described) if path is None else write_plot(described, path)


def write_plot(described: Plot, path: Path) -> None:
    """Writes a description as a page or a still picture, whole or not at all.

    Raises:
        OutputError: as `plot`.
    """
    if path.suffix.lower() != ".html":
        return write_figure(draw(described), path)
    write_whole(path, plot_page(described), ENDINGS)


def write_figure(figure: Figure, path: Path) -> None:
    """Writes a still picture, whole or not at all; without the time of writing, and with names of its parts that depend on the
    drawing alone.

    Raises:
        OutputError: an unknown ending, a folder that is missing, no permission, a full disk.
    """
    import matplotlib

    ending = path.suffix[1:].lower()
    with whole_file(path, PICTURES) as temporary, matplotlib.rc_context({"svg.hashsalt": "armwright"}):
        figure.savefig(temporary, format=ending, metadata=UNDATED[ending])


def check_plot(path: str | os.PathLike[str]) -> Path:
    """The path, if `plot` can write there; to be called before a long simulation.

    Raises:
        OutputError: as `plot`.
    """
    return check_destination(path, ENDINGS)


def draw(plot: Plot) -> Figure:
    """Matplotlib figure of a description, made without pyplot and so without its list of open figures."""
    from matplotlib.lines import Line2D
    from matplotlib.text import Text

    from armwright.results.inline_figure import InlineFigure

    count = len(plot.panels)
    columns = 2 if count % 2 == 0 or count > 3 else 1
    rows = -(-count // columns)
    size = ((5.6 if columns == 2 else 8.0) * columns + 1.2, (2.9 if rows > 1 else 4.0) * rows + 0.9)
    figure = InlineFigure(figsize=size, dpi=150, layout="constrained", facecolor="white")
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for panel, axis in zip(plot.panels, axes, strict=False):
        _draw_panel(panel, plot, axis)
    for axis in axes[count:]:
        axis.set_visible(False)
    for axis in axes[max(count - columns, 0) : count]:
        axis.set_xlabel("time [s]", color=TEXT)
        axis.tick_params(labelbottom=True)
    figure.align_ylabels(axes)
    names = [entry.name for entry in plot.legend]
    below = max(map(len, names)) > WIDE_LEGEND
    figure.legend(
        [Line2D([], [], **_matplotlib_style(entry.style)) for entry in plot.legend],
        names,
        loc="outside lower left" if below else "outside right center",
        ncols=columns if below else -(-len(names) // LEGEND_ROWS),
        frameon=False, fontsize=9.5, labelcolor=TEXT, handlelength=2.4, labelspacing=0.7,
    )  # fmt: skip
    title = "\n".join(filter(None, (plot.title, plot.note)))
    figure.suptitle(title, x=0.012, ha="left", fontsize=13, fontweight="bold", color=TEXT)
    for text in figure.findobj(Text):
        text.set_parse_math(False)  # a name with two $ is a name, not a formula
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.08, wspace=0.03, hspace=0.04)  # type: ignore[union-attr]
    return figure


def blank_figure(width: float, height: float, title: str, **style: Any) -> Figure:
    """A white figure of a width and a height [inch], with nothing but its title on the left; `style` of the title."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=110, layout="constrained", facecolor="white")
    figure.suptitle(title, x=0.012, ha="left", color=TEXT, **style)
    return figure


def open_axes(axis: Axes) -> None:
    """Draws a grid, and no lines above and to the right."""
    axis.grid(color=GRID, linewidth=0.6)
    axis.spines[["top", "right"]].set_visible(False)


def frame(axis: Axes, title: str) -> None:
    """Draws the frame of a panel: a title on the left, a grid below the curves, grey axes."""
    axis.set_title(title, loc="left", fontsize=10.5, color=TEXT, fontweight="bold")
    axis.set_axisbelow(True)
    open_axes(axis)
    axis.spines[["left", "bottom"]].set_color(EDGE)
    axis.tick_params(color=EDGE, labelcolor=TEXT, labelsize=9)


def _matplotlib_style(style: Style) -> dict[str, Any]:
    """Matplotlib's words for a style."""
    line = (0, style.dash) if style.dash else "-"
    return {"color": style.colour, "linestyle": line, "linewidth": style.width, "alpha": style.opacity}


def _draw_panel(panel: Panel, plot: Plot, axis: Axes) -> None:
    for curve in panel.curves:
        _draw_curve(curve, plot, panel.stepped, axis)
    axis.set_ylabel(f"{panel.symbol} [{panel.unit}]", color=TEXT)
    frame(axis, panel.title)
    axis.margins(y=0.08)
    begin, end = min(t[0] for t in plot.times), max(t[-1] for t in plot.times)
    if end > begin:
        axis.set_xlim(begin, end)
    low, high = axis.get_ylim()
    if high - low < LEVEL * max(abs(low), abs(high), 1.0):
        middle, room = 0.5 * (low + high), 0.05 * max(abs(low), abs(high), 1.0)
        axis.set_ylim(middle - room, middle + room)


def _draw_curve(curve: Curve, plot: Plot, stepped: bool, axis: Axes) -> None:
    t, colour = plot.times[curve.run], curve.style.colour
    for low, high in curve.bands:
        step = "post" if stepped else None
        axis.fill_between(t, low, high, color=colour, alpha=BAND_OPACITY, linewidth=0, step=step)
    axis.plot(t, curve.values, drawstyle="steps-post" if stepped else "default", **_matplotlib_style(curve.style))

"""Runs beside each other as a matplotlib figure, in the colours of the picture of one run.  [OkabeIto2008]"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.pictures.curves import Curve, CurvePanel, curve_panels, places
from armwright.simulation.results.plot import COLOURS, FAINT, INK, LINES

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EDGE = "#888888"
DOTTED = ((0, (3, 2)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))  # of the first run's references, of the second's, …
LEVEL = 1e-9  # of its size: a panel whose values differ by less is level


def draw_runs(runs: Mapping[str, xr.Dataset], quantities: Sequence[str] | None, title: str, note: str) -> Figure:
    """The picture: a panel a quantity and unit, a colour a joint, a line style a run; of one joint a colour a run too.

    Args:
        runs: what each is called → the run, as `selected` returns them.   quantities: as `curve_panels`.
        title, note: above it, the note in small letters.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    panels = curve_panels(runs, quantities)
    columns = 2 if len(panels) % 2 == 0 or len(panels) > 3 else 1
    rows = -(-len(panels) // columns)
    size = ((5.6 if columns == 2 else 8.0) * columns + 1.2, (2.9 if rows > 1 else 4.0) * rows + 0.9)
    figure = Figure(figsize=size, dpi=150, layout="constrained", facecolor="white")
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    times = [run["time"].values for run in runs.values()]
    joints = [str(joint) for joint in next(iter(runs.values()))["joint"].values]
    by_run = len(joints) == 1 and len(runs) > 1
    at = places(next(iter(runs.values())))
    for panel, axis in zip(panels, axes, strict=False):
        _draw(panel, times, axis, by_run, at)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    for axis in axes[max(len(panels) - columns, 0) : len(panels)]:
        axis.set_xlabel("time [s]", color=INK)
        axis.tick_params(labelbottom=True)
    names, lines = _legend(joints, list(runs), by_run, at)
    for k in sorted({curve.run for panel in panels for curve in panel.curves if curve.kind == "reference"}):
        names.append(f"reference of {list(runs)[k]}" if len(runs) > 1 else "reference")
        colour = _style(at[0], k, by_run)["color"] if by_run else INK
        lines.append({"linewidth": 0.9, "color": colour, "linestyle": DOTTED[k % len(DOTTED)]})
    figure.legend(
        [Line2D([], [], **line) for line in lines], names, loc="outside right center", frameon=False, fontsize=9.5,
        labelcolor=INK, handlelength=2.2, labelspacing=0.7, ncols=-(-len(names) // 24),
    )  # fmt: skip
    title = f"{title}, {joints[0]}" if by_run else title
    words = f"{title}   ·   {note.rstrip('.')}" if note else title
    figure.suptitle(words, x=0.012, ha="left", fontsize=13, fontweight="bold", color=INK)
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.08, wspace=0.03, hspace=0.04)  # type: ignore[union-attr]
    return figure


def _legend(joints: list[str], runs: list[str], by_run: bool, at: list[int]) -> tuple[list[str], list[dict[str, Any]]]:
    """What colours and lines mean: names, and how each is drawn."""
    if by_run:
        return list(runs), [{"linewidth": 2.0, **_style(0, k, by_run)} for k in range(len(runs))]
    names, lines = list(joints), [{"linewidth": 2.0, **_style(k, 0, by_run)} for k in at]
    if len(runs) > 1:
        names += runs
        lines += [{"linewidth": 1.6, "color": INK, "linestyle": LINES[k % len(LINES)]} for k in range(len(runs))]
    return names, lines


def _style(joint: int, run: int, by_run: bool) -> dict[str, Any]:
    line = LINES[(joint // len(COLOURS) + run) % len(LINES)]
    return {"color": COLOURS[(run if by_run else joint) % len(COLOURS)], "linestyle": line}


def _draw(panel: CurvePanel, times: Sequence[np.ndarray], axis: Axes, by_run: bool, at: list[int]) -> None:
    for curve in panel.curves:
        _draw_curve(curve, times[curve.run], panel.held, axis, _style(at[curve.joint], curve.run, by_run))
    axis.set_title(panel.title, loc="left", fontsize=10.5, color=INK, fontweight="bold")
    axis.set_ylabel(f"{panel.symbol} [{panel.unit}]", color=INK)
    axis.set_axisbelow(True)
    axis.grid(color=FAINT, linewidth=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    axis.spines[["left", "bottom"]].set_color(EDGE)
    axis.tick_params(color=EDGE, labelcolor=INK, labelsize=9)
    axis.margins(y=0.08)
    begin, end = min(t[0] for t in times), max(t[-1] for t in times)
    if end > begin:
        axis.set_xlim(begin, end)
    low, high = axis.get_ylim()
    if high - low < LEVEL * max(abs(low), abs(high), 1.0):  # rounding is not blown up to the height of the panel
        middle, room = 0.5 * (low + high), max(abs(low), abs(high), 1.0) * 0.05
        axis.set_ylim(middle - room, middle + room)


def _draw_curve(curve: Curve, t: np.ndarray, held: bool, axis: Axes, style: dict[str, Any]) -> None:
    if curve.low is not None and curve.high is not None:
        step = "post" if held else None
        axis.fill_between(t, curve.low, curve.high, color=style["color"], alpha=0.18, linewidth=0, step=step)
    width = {"line": 1.6, "band": 1.6, "lane": 0.8, "reference": 0.9}[curve.kind]
    if curve.kind == "reference":
        style["linestyle"] = DOTTED[curve.run % len(DOTTED)]
    steps = "steps-post" if held else "default"
    axis.plot(t, curve.values, linewidth=width, alpha=0.7 if curve.kind == "lane" else 1.0, drawstyle=steps, **style)

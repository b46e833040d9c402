"""Runs beside each other as a matplotlib figure, in the colours of the picture of one run.  [OkabeIto2008]"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.pictures.curves import Curve, CurvePanel, curve_panels
from armwright.simulation.plot import COLOURS, FAINT, INK, LINES

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EDGE = "#888888"
LEVEL = 1e-9  # of its size: a panel whose values differ by less is level


def draw_runs(runs: Mapping[str, xr.Dataset], quantities: Sequence[str] | None, title: str, note: str) -> Figure:
    """The picture: a panel a quantity and unit, a colour a joint, a line style a run.

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
    for panel, axis in zip(panels, axes, strict=False):
        _draw(panel, times, axis)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    for axis in axes[max(len(panels) - columns, 0) : len(panels)]:
        axis.set_xlabel("time [s]", color=INK)
        axis.tick_params(labelbottom=True)
    joints = [str(joint) for joint in next(iter(runs.values()))["joint"].values]
    lines = [Line2D([], [], linewidth=2.0, **_style(k, 0)) for k in range(len(joints))]
    if len(runs) > 1:
        joints += list(runs)
        lines += [Line2D([], [], linewidth=1.6, color=INK, linestyle=LINES[k % len(LINES)]) for k in range(len(runs))]
    if any(curve.kind == "reference" for panel in panels for curve in panel.curves):
        joints.append("reference")
        lines.append(Line2D([], [], linewidth=0.9, color=INK, linestyle=(0, (3, 2))))
    figure.legend(
        lines, joints, loc="outside right center", frameon=False, fontsize=9.5, labelcolor=INK, handlelength=2.2,
        labelspacing=0.7, ncols=-(-len(joints) // 24),
    )  # fmt: skip
    words = f"{title}   ·   {note.rstrip('.')}" if note else title
    figure.suptitle(words, x=0.012, ha="left", fontsize=13, fontweight="bold", color=INK)
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.08, wspace=0.03, hspace=0.04)  # type: ignore[union-attr]
    return figure


def _style(joint: int, run: int) -> dict[str, Any]:
    line = LINES[(joint // len(COLOURS) + run) % len(LINES)]
    return {"color": COLOURS[joint % len(COLOURS)], "linestyle": line}


def _draw(panel: CurvePanel, times: Sequence[np.ndarray], axis: Axes) -> None:
    for curve in panel.curves:
        _draw_curve(curve, times[curve.run], panel.held, axis)
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


def _draw_curve(curve: Curve, t: np.ndarray, held: bool, axis: Axes) -> None:
    style = _style(curve.joint, curve.run)
    if curve.low is not None and curve.high is not None:
        step = "post" if held else None
        axis.fill_between(t, curve.low, curve.high, color=style["color"], alpha=0.18, linewidth=0, step=step)
    width = {"line": 1.6, "band": 1.6, "lane": 0.8, "reference": 0.9}[curve.kind]
    if curve.kind == "reference":
        style["linestyle"] = (0, (3, 2))
    steps = "steps-post" if held else "default"
    axis.plot(t, curve.values, linewidth=width, alpha=0.7 if curve.kind == "lane" else 1.0, drawstyle=steps, **style)

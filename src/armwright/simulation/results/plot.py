"""A run as a picture: positions, velocities, torques and what the drives were given, against time.

Colours are those of Okabe and Ito, which colour-blind people tell apart too [OkabeIto2008]; after the seventh joint the
line changes. Of a few lanes each is drawn; of many the median and the bands that hold half and nine out of ten.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.output import check_destination, whole_file
from armwright.simulation.results.recording import in_order, run_units

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ENDINGS = (".png", ".svg", ".pdf")
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
LINES = ("-", "--", ":", "-.")
INK, FAINT = "#222222", "#D9D9D9"
FEW_LANES = 12  # more are drawn as median and band
BAND, HALF = (0.05, 0.95), (0.25, 0.75)
POINTS_OF_A_BAND = 1000  # quantiles are worked out at about as many times as the picture has columns
TITLES = {  # quantity → of revolute, of prismatic joints
    "q": ("Joint angles", "Joint positions"),
    "qd": ("Joint velocities", "Joint velocities"),
    "tau": ("Motor torques", "Motor forces"),
    "voltage": ("Motor voltages", "Motor voltages"),
    "current": ("Motor currents", "Motor currents"),
    "u": ("Drive commands", "Drive commands"),
}
HELD = {"tau": "torque", "voltage": "voltage", "current": "current"}  # what a drive command of that kind holds still


@dataclass(frozen=True)
class Panel:
    """One set of axes: a quantity of those joints that share its unit."""

    quantity: str
    title: str
    unit: str
    joints: tuple[int, ...]
    held: bool  # drawn as steps: a command that is held


def panels(run: xr.Dataset) -> list[Panel]:
    """What is drawn of a run: each quantity, joints in radians and in metres apart."""
    commands = [str(command) for command in run["command"].values]
    found = []
    for quantity in ("q", "qd", "tau", *_drives(run)):
        if quantity not in run:
            continue
        units = run_units(run, quantity)
        known = [np.isfinite(own).any() for own in run[quantity].values.reshape(-1, len(commands)).T]
        for unit in dict.fromkeys(units):
            joints = tuple(k for k, own in enumerate(units) if own == unit and known[k])
            if joints:
                linear = str(run["kind"].values[joints[0]]) == "prismatic"
                held = all(quantity == "u" or commands[k] == HELD.get(quantity) for k in joints)
                found.append(Panel(quantity, TITLES[quantity][linear], unit, joints, held))
    return found


def _drives(run: xr.Dataset) -> list[str]:
    """What is drawn of the drives: voltages; currents too, or instead, where voltages are not known of every motor."""
    known = [name for name in ("voltage", "current") if name in run]
    if known and np.isfinite(run[known[0]].values).any(axis=tuple(range(run[known[0]].ndim - 1))).all():
        return known[:1]
    return known or ["u"] * ("tau" not in run)


def draw(run: xr.Dataset) -> Figure:
    """The picture of a run as a matplotlib figure, touching nothing of pyplot's.

    Args:
        run: what `simulate` returned, or a part of it.
    Raises:
        RunError: no run.
    """
    from matplotlib.figure import Figure

    run = in_order(run)
    drawn = panels(run)
    columns = 2 if len(drawn) % 2 == 0 or len(drawn) > 3 else 1
    rows = -(-len(drawn) // columns)
    figure = Figure(
        figsize=((5.6 if columns == 2 else 8.0) * columns + 1.0, (2.9 if columns == 2 else 2.3) * rows + 0.9),
        dpi=150,
        layout="constrained",
        facecolor="white",
    )
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for panel, axis in zip(drawn, axes, strict=False):
        _draw_panel(run, panel, axis)
    for axis in axes[len(drawn) :]:
        axis.set_visible(False)
    for axis in axes[max(len(drawn) - columns, 0) : len(drawn)]:
        axis.set_xlabel("time [s]", color=INK)
        axis.tick_params(labelbottom=True)
    _legend(run, figure)
    _title(run, figure)
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.08, wspace=0.03, hspace=0.04)  # type: ignore[union-attr]
    return figure


def plot(run: xr.Dataset, path: str | os.PathLike[str]) -> None:
    """Draws a run into a PNG, SVG or PDF file; whole or not at all.

    Args:
        run: what `simulate` returned, or a part of it such as `run.isel(joint=0)`.
        path: the file; its ending says which format.
    Raises:
        RunError: no run.
        OutputError: an unknown ending, a folder that is missing, no permission, a full disk.
    """
    check_picture(path)
    figure = draw(run)
    with whole_file(path, ENDINGS) as temporary:
        figure.savefig(temporary, format=temporary.suffix[1:].lower())


def check_picture(path: str | os.PathLike[str]) -> None:
    """Refuses what `plot` could not write; to be asked before a long simulation.

    Raises:
        OutputError: as `plot`.
    """
    check_destination(path, ENDINGS)


def _style(joint: int) -> dict[str, Any]:
    return {"color": COLOURS[joint % len(COLOURS)], "linestyle": LINES[joint // len(COLOURS) % len(LINES)]}


def _draw_panel(run: xr.Dataset, panel: Panel, axis: Axes) -> None:
    times, values = run["time"].values, run[panel.quantity].values
    lanes = values if values.ndim == 3 else values[None]
    drawstyle = "steps-post" if panel.held else "default"
    for joint in panel.joints:
        own = lanes[:, :, joint]
        if len(own) > FEW_LANES:
            _draw_band(times, own, joint, axis, held=panel.held)
            continue
        thin = {"linewidth": 0.8, "alpha": 0.7} if len(own) > 1 else {"linewidth": 1.6}
        axis.plot(times, own.T, drawstyle=drawstyle, **thin, **_style(joint))
    axis.set_title(panel.title, loc="left", fontsize=10.5, color=INK, fontweight="bold")
    axis.set_ylabel(f"{_symbol(panel.quantity)} [{panel.unit}]", color=INK)
    axis.set_axisbelow(True)
    axis.grid(color=FAINT, linewidth=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    axis.spines[["left", "bottom"]].set_color("#888888")
    axis.tick_params(color="#888888", labelcolor=INK, labelsize=9)
    axis.margins(y=0.08)
    if len(times) > 1:
        axis.set_xlim(times[0], times[-1])
    _show_no_rounding(axis)


def _draw_band(times: np.ndarray, own: np.ndarray, joint: int, axis: Axes, *, held: bool) -> None:
    every = max(len(times) // POINTS_OF_A_BAND, 1)
    times, own = times[::every], own[:, ::every]
    low, lower, middle, upper, high = np.nanquantile(own, (BAND[0], HALF[0], 0.5, HALF[1], BAND[1]), axis=0)
    for bottom, top in ((low, high), (lower, upper)):
        axis.fill_between(
            times, bottom, top, color=_style(joint)["color"], alpha=0.16, linewidth=0, step="post" if held else None
        )
    axis.plot(times, middle, linewidth=1.6, drawstyle="steps-post" if held else "default", **_style(joint))


def _show_no_rounding(axis: Axes) -> None:
    """A line that is level but for rounding stays level: its 1e-17 is not blown up to the height of the panel."""
    low, high = axis.get_ylim()
    if high - low < 1e-9 * max(abs(low), abs(high), 1.0):
        middle = 0.5 * (low + high)
        room = max(abs(middle), 1.0) * 0.05
        axis.set_ylim(middle - room, middle + room)


def _symbol(quantity: str) -> str:
    return {"q": "q", "qd": "q̇", "tau": "τ", "voltage": "V", "current": "i", "u": "u"}[quantity]


def _legend(run: xr.Dataset, figure: Figure) -> None:
    from matplotlib.lines import Line2D

    names = [str(name) for name in run["joint"].values]
    lines = [Line2D([], [], linewidth=2.0, **_style(k)) for k in range(len(names))]
    figure.legend(
        lines, names, loc="outside right center", frameon=False, fontsize=9.5, labelcolor=INK, handlelength=1.8,
        labelspacing=0.7, ncols=-(-len(names) // 24),
    )  # fmt: skip


def _title(run: xr.Dataset, figure: Figure) -> None:
    words = str(run.attrs.get("robot", "run"))
    lanes = run.sizes.get("lane", 1)
    if lanes > FEW_LANES:
        words += f"   ·   {lanes} lanes: median, half of them, nine out of ten"
    elif lanes > 1:
        words += f"   ·   {lanes} lanes"
    figure.suptitle(words, x=0.012, ha="left", fontsize=13, fontweight="bold", color=INK)

"""Picture of a run of a log: every signal over time and its spectrum, as logged and as prepared."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from armwright.entry import AnyLog, as_log
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import Preparation, choose_preparation
from armwright.identification.logs.prepared import prepare_log
from armwright.identification.logs.spectrum import longest_finite, spectrum
from armwright.output import check_destination
from armwright.results.plot import PICTURES, TEXT, blank_figure, open_axes, write_figure
from armwright.results.plot_curves import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS = 20_000  # of a curve: more do not show
ROUNDING = 1e-12  # of the largest value: what filters leave of a constant
FAINT = 0.35  # opacity of what was logged, behind what was prepared


def plot_log(
    log: AnyLog, path: str | os.PathLike[str], run: str | None = None, preparation: Preparation | None = None
) -> None:
    """Writes a picture of a run: every signal over time on the left, its spectrum on the right; pale as logged, dark as prepared.

    The spectra are those of the excerpt with the most motion. A dashed line is the cut-off.

    Args:
        log: what `read_log` returned.   path: ending in .png, .svg or .pdf.   run: its name; None: the first.
        preparation: None: what `choose_preparation` says.
    Raises:
        LogError: no such run, or no stretch that is long enough.   OutputError: the file cannot be written.
    Example:
        >>> log = aw.identification.read_log("examples/logs/dc_motor/dc_motor.log.toml")
        >>> aw.identification.plot_log(log, "log.png")
    """
    log = as_log(log)
    target = check_destination(path, PICTURES)
    figure = draw_log(log, run, preparation)
    write_figure(figure, target)


def draw_log(log: Log, run: str | None = None, preparation: Preparation | None = None) -> Figure:
    """The picture as a matplotlib figure; see `plot_log`."""
    from matplotlib.lines import Line2D

    chosen = log.run(run)
    preparation = preparation or choose_preparation(log, chosen.name)
    raw, prepared = log.dataset(chosen.name), prepare_log(log, chosen.name, preparation)
    names = [str(name) for name in prepared.data_vars]
    title = f"{log.title}, run {chosen.name}: faint as logged, full as prepared"
    figure = blank_figure(12.0, 2.6 * len(names) + 1.2, title)
    axes = figure.subplots(len(names), 2, squeeze=False)
    for name, (left, right) in zip(names, axes, strict=True):
        for k in range(len(log.joints)):
            colour = COLOURS[k % len(COLOURS)]
            if name in raw:
                _over_time(left, raw["time"].values, raw[name].values[:, k], colour, FAINT)
                _spectrum(right, raw[name].values[:, k], preparation.rate, colour, FAINT)
            _over_time(left, prepared["time"].values, prepared[name].values[:, k], colour, 1.0)
            _spectrum(right, prepared[name].values[:, k], preparation.rate / preparation.decimate, colour, 1.0)
        unit = prepared[name].attrs["units"]
        left.set_ylabel(f"{name} [{unit}]", color=TEXT)
        right.set_ylabel(f"{name} [{unit}/√Hz]", color=TEXT)
        drawn = bool(right.lines)
        if not drawn:
            right.text(0.5, 0.5, "constant", transform=right.transAxes, ha="center", color=TEXT)
            right.set(yticks=[])
        right.axvline(preparation.cutoff, color=TEXT, linestyle="--", linewidth=0.8)
        for axis in (left, right):
            open_axes(axis)
        right.set(xscale="log", yscale="log" if drawn else "linear")
    axes[-1][0].set_xlabel("time [s]", color=TEXT)
    axes[-1][1].set_xlabel("frequency [Hz]", color=TEXT)
    figure.legend(
        [Line2D([], [], color=COLOURS[k % len(COLOURS)]) for k in range(len(log.joints))],
        log.joints, loc="outside right upper", frameon=False, labelcolor=TEXT,
    )  # fmt: skip
    return figure


def _over_time(axis: Axes, t: np.ndarray, values: np.ndarray, colour: str, opacity: float) -> None:
    every = max(len(t) // POINTS, 1)
    axis.plot(t[::every], values[::every], color=colour, alpha=opacity, linewidth=0.9)


def _spectrum(axis: Axes, values: np.ndarray, rate: float, colour: str, opacity: float) -> None:
    column = longest_finite(values)
    if len(column) < 16 or column.std() <= ROUNDING * np.abs(column).max():
        return
    f, power = spectrum(column, rate)
    axis.plot(f, np.sqrt(power), color=colour, alpha=opacity, linewidth=0.9)

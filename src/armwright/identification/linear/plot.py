"""Picture of a black-box model of a log: measured and simulated outputs of every run, and its frequency response."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import LogError
from armwright.identification.linear.frequency import FrequencyResponse, frequency_response
from armwright.identification.linear.model import LinearModel
from armwright.identification.linear.records import LogSignals, Records, records_of
from armwright.identification.logs.log import Log
from armwright.output import check_destination
from armwright.results.plot import PICTURES, TEXT, blank_figure, open_axes, write_figure
from armwright.results.plot_curves import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS = 20_000  # of a curve: more do not show
MOST_RUNS = 8  # that are drawn
MEASURED, MODEL = COLOURS[0], COLOURS[1]


def plot_linear(
    log: Log,
    found: LinearModel | FrequencyResponse,
    path: str | os.PathLike[str],
    joint: str | Sequence[str] | None = None,
) -> None:
    """Writes a picture: the free simulation over what was measured, run by run, and the frequency response beside Welch's.

    Args:
        log: that was fitted.   found: the model or the response.   path: ending in .png, .svg or .pdf.
        joint: name of the fitted joint, where the log has several.
    Raises:
        LogError: signals of the model that the log does not have.   OutputError: the file cannot be written.
    """
    target = check_destination(path, PICTURES)
    figure = draw_linear(log, found, joint)
    write_figure(figure, target)


def draw_linear(log: Log, found: LinearModel | FrequencyResponse, joint: str | Sequence[str] | None = None) -> Figure:
    """The picture as a matplotlib figure; see `plot_linear`."""
    title = f"{log.title}: {found.method}"
    if isinstance(found, FrequencyResponse):
        figure = blank_figure(9.0, 7.0, title, fontsize=10)
        _bode(list(figure.subplots(3, 1, sharex=True)), found, None)
        return figure
    inputs, outputs = (
        list(dict.fromkeys(name.partition("/")[0] for name in names)) for names in (found.inputs, found.outputs)
    )
    joints = joint or list(dict.fromkeys(name.partition("/")[2] for name in found.inputs if "/" in name)) or None
    records = records_of(log, signals=LogSignals(inputs, outputs, joints))
    single = len(found.inputs) == len(found.outputs) == 1
    stretches = [*records.fit, *records.hold_out][:MOST_RUNS]
    rows = len(stretches) * len(found.outputs)
    figure = blank_figure(13.0, 2.2 * max(rows, 3) + 1.0, title, fontsize=10)
    parts: Any = figure.subfigures(1, 2, width_ratios=(1.6, 1.0)) if single else [figure]
    left, right = parts[0], parts[1] if single else None
    axes = left.subplots(rows, 1, squeeze=False)[:, 0]
    _runs(list(axes), records, found, stretches)
    if right is not None:
        try:
            welch = frequency_response(log, signals=LogSignals(found.inputs[0], found.outputs[0], joint))
        except LogError:  # stretches too short for a spectrum
            welch = None
        _bode(list(right.subplots(3, 1, sharex=True)), welch, found)
    return figure


def _runs(axes: list[Axes], records: Records, model: LinearModel, stretches: list) -> None:
    """Measured and simulated outputs of every stretch."""
    held = {id(each) for each in records.hold_out}
    places = iter(axes)
    for each in stretches:
        simulated = np.reshape(model.simulate(each.u, each.y), each.y.shape)
        t = records.period * np.arange(len(each.y))
        every = max(len(t) // POINTS, 1)
        for k, name in enumerate(records.outputs):
            axis = next(places)
            axis.plot(t[::every], each.y[::every, k], color=MEASURED, linewidth=0.8, alpha=0.6, label="measured")
            axis.plot(t[::every], simulated[::every, k], color=MODEL, linewidth=1.1, label="free simulation")
            axis.set_ylabel(f"{name} [{records.output_units[k]}]", color=TEXT)
            axis.set_title(
                f"{each.run}, {'hold-out' if id(each) in held else 'fit'}", loc="left", fontsize=9, color=TEXT
            )
            open_axes(axis)
    axes[-1].set_xlabel("time [s]", color=TEXT)
    axes[0].legend(frameon=False, labelcolor=TEXT, loc="upper right", ncols=2)


def _bode(axes: list[Axes], measured: FrequencyResponse | None, model: LinearModel | None) -> None:
    """Magnitude, phase and coherence over frequency, with 95 % bands."""
    size, phase, coherence = axes
    if measured is not None:
        f, h = measured.frequency, measured.response
        low, high = measured.band()
        size.fill_between(f, np.maximum(low, 1e-3 * np.abs(h)), high, color=MEASURED, alpha=0.25, linewidth=0)
        size.plot(f, np.abs(h), color=MEASURED, linewidth=1.0)
        phase.plot(f, np.degrees(np.angle(h)), ".", color=MEASURED, markersize=3)
        coherence.plot(f, measured.coherence, color=MEASURED, linewidth=1.0)
    if model is not None:
        top = 0.5 / model.period
        f = np.geomspace(1e-3 * top, top, 400) if measured is None else np.geomspace(measured.frequency[0], top, 400)
        h = model.response(f)
        size.plot(f, np.abs(h), color=MODEL, linewidth=1.2)
        phase.plot(f, np.degrees(np.angle(h)), color=MODEL, linewidth=1.2)
    size.set(xscale="log", yscale="log")
    phase.set(yticks=[-180, -90, 0, 90, 180])
    coherence.set(ylim=(0, 1.02))
    for axis, name in ((size, "|H|"), (phase, "phase [deg]"), (coherence, "coherence")):
        axis.set_ylabel(name, color=TEXT)
        open_axes(axis)
    coherence.set_xlabel("frequency [Hz]", color=TEXT)

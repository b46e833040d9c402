"""Pictures of experiments: a designed motion with its limits, a motor's command with its spectrum."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from armwright.identification.experiments.excitation import Excitation
from armwright.identification.experiments.motor import MotorExperiment
from armwright.output import check_destination
from armwright.results.plot import PICTURES, TEXT, blank_figure, open_axes, write_figure
from armwright.results.plot_curves import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_experiment(experiment: Excitation | MotorExperiment, path: str | os.PathLike[str]) -> None:
    """Writes a picture: for a motion every quantity relative to its limit; for a command its values and its spectrum.

    Args:
        experiment: of `design_excitation` or `motor_experiment`.   path: ending in .png, .svg or .pdf.
    Raises:
        OutputError: the file cannot be written.
    Example:
        >>> guess = aw.identification.MotorGuess(gain=5.0, time_constant=0.05, most=10.0)
        >>> test = aw.identification.motor_experiment("step", guess)
        >>> aw.identification.plot_experiment(test, "step.png")
    """
    target = check_destination(path, PICTURES)
    figure = draw_motion(experiment) if isinstance(experiment, Excitation) else draw_command(experiment)
    write_figure(figure, target)


def draw_motion(excitation: Excitation) -> Figure:
    """Positions, then speeds, accelerations, torques and voltages, relative to their limits if they have any."""
    from matplotlib.lines import Line2D

    arm, limits = excitation.arm, excitation.limits
    t, q, qd, qdd = excitation.states()
    values = {"velocity": qd, "acceleration": qdd}
    if limits.bounded("torque").any() or limits.bounded("voltage").any():
        values["torque"] = limits.dyn.inverse_dynamics(q, qd, qdd)
    if limits.bounded("voltage").any():
        values["voltage"] = limits.dyn.motor_voltage(qd, values["torque"])
    rows: dict[str, np.ndarray] = {"position": (q - limits.middle) / (0.5 * (limits.high - limits.low))}
    rows |= {name: each / limits.most[name] for name, each in values.items() if limits.bounded(name).any()}
    figure = blank_figure(9.0, 1.9 * len(rows) + 1.2, f"{arm.name}: condition number {excitation.condition:.3g}")
    axes = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (name, parts) in zip(axes, rows.items(), strict=True):
        for k in range(arm.n):
            if np.isfinite(parts[:, k]).all():
                axis.plot(t, parts[:, k], color=COLOURS[k % len(COLOURS)], linewidth=1.0)
        for edge in (-1.0, 1.0):
            axis.axhline(edge, color=TEXT, linestyle="--", linewidth=0.8)
        axis.set_ylabel(f"{name} / limit", color=TEXT)
        axis.set_ylim(-1.12, 1.12)
        open_axes(axis)
    axes[-1].set_xlabel("time [s]", color=TEXT)
    lines = [Line2D([], [], color=COLOURS[k % len(COLOURS)]) for k in range(arm.n)]
    figure.legend(lines, arm.names, loc="outside right upper", frameon=False, labelcolor=TEXT)
    return figure


def draw_command(experiment: MotorExperiment) -> Figure:
    """The command over time, and its amplitude spectrum with the motor's corner frequency."""
    figure = blank_figure(9.0, 5.0, f"{experiment.kind}: crest {experiment.crest:.3g}")
    over_time, spectrum = figure.subplots(2, 1)
    ends = np.append(experiment.times, experiment.duration)
    over_time.stairs(experiment.values, ends, baseline=None, color=COLOURS[0], linewidth=1.0)
    over_time.set_ylabel(f"command [{experiment.guess.unit}]", color=TEXT)
    over_time.set_xlabel("time [s]", color=TEXT)
    # steps have a spectrum beyond their own rate
    fine = np.repeat(experiment.values, max(1, 4096 // len(experiment.values)))
    period = experiment.duration / len(fine)
    amplitudes = 2.0 * np.abs(np.fft.rfft(fine)) / len(fine)
    frequencies = np.fft.rfftfreq(len(fine), period)
    shown = (frequencies > 0) & (amplitudes > 1e-6 * amplitudes.max())
    spectrum.loglog(frequencies[shown], amplitudes[shown], ".", color=COLOURS[0], markersize=3)
    spectrum.axvline(experiment.guess.corner_hz, color=TEXT, linestyle="--", linewidth=0.8)
    spectrum.text(experiment.guess.corner_hz, amplitudes[shown].min(), " corner", color=TEXT, va="bottom")
    spectrum.set_ylabel(f"amplitude [{experiment.guess.unit}]", color=TEXT)
    spectrum.set_xlabel("frequency [Hz]", color=TEXT)
    for axis in (over_time, spectrum):
        open_axes(axis)
    return figure

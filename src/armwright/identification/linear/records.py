"""Inputs and outputs of a plant as evenly sampled stretches, from a log or from arrays, checked before any fit."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright.entry import as_log, expect
from armwright.errors import LogError, check_known
from armwright.fitting.measures import runs_of_true
from armwright.fitting.stretch import LogStretch
from armwright.identification.logs.blocks import LARGEST
from armwright.identification.logs.log import Log, LogRun

INPUTS, OUTPUTS = ("voltage", "current", "tau"), ("qd", "q", "qdd", "tau_link")  # of a log, the likeliest first
UNEVEN = 0.05  # of a period: rows further from even times are no sampled signal
SAME_PERIOD = 1e-3  # relative difference of two clocks that count as one
CONSTANT = 1e-12  # range of a signal, as a share of its size


@dataclass(frozen=True, eq=False)
class RecordedStretch(LogStretch):
    """A stretch's inputs u (rows, inputs) and outputs y (rows, outputs)."""

    u: np.ndarray
    y: np.ndarray


@dataclass(frozen=True)
class LogSignals:
    """Signals of a log that are the inputs and outputs of a model.

    Args:
        input: name, or names; None: the log's voltage, current or torque.   output: likewise; None: its speed or position.
        joint: name, or names; needed where several joints have both.
    Example:
        >>> aw.identification.LogSignals(input="voltage", output="speed")
        LogSignals(input='voltage', output='speed', joint=None)
    """

    input: str | Sequence[str] | None = None
    output: str | Sequence[str] | None = None
    joint: str | Sequence[str] | None = None


LIKELIEST = LogSignals()


@dataclass(frozen=True, eq=False)
class Records:
    """Inputs and outputs for fit and validation.

    Attributes:
        fit, hold_out: stretches.   period: [s] from row to row.   inputs, outputs: names.   input_units, output_units: of each.
        sha256: of the log; "" of arrays.   notes: sentences about the data.
    """

    fit: tuple[RecordedStretch, ...]
    hold_out: tuple[RecordedStretch, ...]
    period: float
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    sha256: str = ""
    notes: tuple[str, ...] = ()

    @property
    def rows(self) -> int:
        """Number of rows of the fit."""
        return sum(len(each.y) for each in self.fit)

    def changed(self, change: Callable[[RecordedStretch], RecordedStretch]) -> Records:
        """The records with another stretch in the place of each."""
        return replace(self, fit=tuple(map(change, self.fit)), hold_out=tuple(map(change, self.hold_out)))

    def delayed(self, delay: int) -> Records:
        """The records with inputs `delay` rows later; rows before the first such input are dropped."""
        return self.changed(lambda each: RecordedStretch(each.run, each.u[: len(each.u) - delay], each.y[delay:]))


def records_of(data: Any, y: Any = None, period: Any = None, signals: LogSignals = LIKELIEST) -> Records:
    """Checked records from a log, or from arrays.

    Args:
        data: a log or its path, or u: (rows,) or (rows, inputs), or a list of such, one a run.   y: outputs in the same form.
        period: [s], or times (rows,) [s] of one run.   signals: of a log.
    Raises:
        LogError: names the signal, run and row: not a number, constant, unevenly sampled, two clocks, too short.
    """
    expect(signals, LogSignals, "signals", "LogSignals(input=…, output=…, joint=…)", LogError)
    data = as_log(data) if isinstance(data, (str, os.PathLike)) else data
    if isinstance(data, Log):
        if y is not None or period is not None:
            raise LogError("a log has its outputs and its clock", place="y" if y is not None else "period")
        return _of_log(data, signals)
    if signals != LIKELIEST:
        named = [name for name, value in vars(signals).items() if value is not None]
        raise LogError("names signals of a log, not of arrays", place=named[0])
    if y is None or period is None:
        raise LogError("missing", place="y" if y is None else "period", expected="u, y and period, or a log")
    return _of_arrays(data, y, period)


def _of_arrays(u: Any, y: Any, period: Any) -> Records:
    runs_u, runs_y = ([values] if not _is_list_of_runs(values) else list(values) for values in (u, y))
    if len(runs_u) != len(runs_y):
        raise LogError(f"{len(runs_u)} runs of u and {len(runs_y)} of y", place="y", expected="as many")
    fit = []
    for k, (one_u, one_y) in enumerate(zip(runs_u, runs_y, strict=True)):
        name = f"run{k + 1}" if len(runs_u) > 1 else "run"
        columns_u, columns_y = _columns(one_u, "u"), _columns(one_y, "y")
        if len(columns_u) != len(columns_y):
            raise LogError(f"{len(columns_u)} rows of u and {len(columns_y)} of y", place=name, expected="as many")
        for place, values in (("u", columns_u), ("y", columns_y)):
            if not np.isfinite(values).all():
                row = int(np.argmax(~np.isfinite(values).all(axis=1)))
                raise LogError(
                    "not a finite number", place=f"{place}[{row}]", value=float(values[row][~np.isfinite(values[row])][0]),
                    expected="runs that end at a gap and begin again behind it: lists of arrays",
                )  # fmt: skip
            if np.abs(values).max() > LARGEST:
                raise LogError(place=place, value=float(np.abs(values).max()), expected=f"at most {LARGEST:g}")
        fit.append(RecordedStretch(name, columns_u, columns_y))
    step = _period(period, fit)
    inputs = tuple(f"u{k + 1}" for k in range(fit[0].u.shape[1])) if fit[0].u.shape[1] > 1 else ("u",)
    outputs = tuple(f"y{k + 1}" for k in range(fit[0].y.shape[1])) if fit[0].y.shape[1] > 1 else ("y",)
    records = Records(tuple(fit), (), step, inputs, outputs, ("",) * len(inputs), ("",) * len(outputs))
    check_variation(records)
    return records


def _is_list_of_runs(values: Any) -> bool:
    """True for a list of arrays, one a run; a list of numbers is one run."""
    return isinstance(values, (list, tuple)) and len(values) > 0 and np.ndim(values[0]) > 0


def _columns(values: Any, place: str) -> np.ndarray:
    try:
        array = np.asarray(values)
        if np.iscomplexobj(array):
            raise TypeError
        array = array.astype(float)
    except (TypeError, ValueError):
        raise LogError(place=place, value=values, expected="numbers (rows,) or (rows, signals)") from None
    if array.ndim not in (1, 2) or array.size == 0:
        raise LogError(f"shape {array.shape}", place=place, expected="(rows,) or (rows, signals)")
    return array[:, None] if array.ndim == 1 else array


def _period(period: Any, runs: Sequence[RecordedStretch]) -> float:
    """The period [s] from a number or from times."""
    times = np.asarray(period, dtype=float) if not isinstance(period, str) else np.full(1, np.nan)
    if times.ndim == 0:
        if not 0.0 < times < np.inf:
            raise LogError(place="period", value=period, expected="a number above 0 [s], or times (rows,)")
        return float(times)
    if len(runs) != 1 or times.shape != (len(runs[0].y),) or len(times) < 2 or not np.isfinite(times).all():
        raise LogError(
            f"shape {times.shape}", place="period", expected="a number above 0 [s], or finite times of every row"
        )
    step = float((times[-1] - times[0]) / (len(times) - 1))
    off = np.abs(times - times[0] - step * np.arange(len(times)))
    if step <= 0.0 or off.max() > UNEVEN * step:
        what = f"rows are not evenly spaced: row {int(off.argmax())} is {off.max():.3g} s off a clock of {step:.4g} s"
        raise LogError(
            what, place="period", expected="one clock without gaps; runs that end at a gap, as lists of arrays"
        )
    return step


def _of_log(log: Log, signals: LogSignals) -> Records:
    inputs, outputs = _chosen(log, signals.input, INPUTS, "input"), _chosen(log, signals.output, OUTPUTS, "output")
    both = [name for name in inputs if name in outputs]
    if both:
        raise LogError("is both input and output", place="output", value=both[0])
    joints = [signals.joint] if isinstance(signals.joint, str) else list(signals.joint or ())
    for name in joints:
        check_known(LogError, name, log.joints, "no joint of the log", place="joint")
    if not joints:
        of_signals = [log.layout[signal].joints or () for signal in (*inputs, *outputs)]
        joints = [name for k, name in enumerate(log.joints) if all(k in own for own in of_signals)]
        if len(joints) != 1:
            choices = joints or log.joints
            expected = f"one of {', '.join(choices)}" if joints else "a joint with both signals"
            raise LogError("missing", place="joint", expected=expected)
    pick_u, pick_y = ([(s, _column(log, s, name)) for s in signals for name in joints] for signals in (inputs, outputs))
    fit, hold_out, periods = [], [], {}
    notes = [str(each) for each in log.warnings]
    for run in log.runs:
        stretches = _stretches(log, run, pick_u, pick_y)
        if len(stretches) > 1:
            notes.append(
                f"run {run.name!r} has gaps: {len(stretches)} stretches, each with an initial state of its own"
            )
        (fit if run.use == "fit" else hold_out).extend(stretches)
        periods[run.name] = run.period
    first = log.runs[0].name
    for name, period in periods.items():
        if abs(period - periods[first]) > SAME_PERIOD * periods[first]:
            what = (
                f"two clocks: a row every {periods[first]:.6g} s in run {first!r}, every {period:.6g} s in run {name!r}"
            )
            raise LogError(what, place=f"run {name!r}", expected="one rate; prepare_log decimates", file=log.path)
    if not fit:
        raise LogError("no run to fit", place="runs", expected='a run with use = "fit"', file=log.path)
    many = len(joints) > 1
    names = [tuple(f"{s}/{joint}" if many else s for s in signals for joint in joints) for signals in (inputs, outputs)]
    units = [tuple(log.layout[s].units[k] for s, k in pick) for pick in (pick_u, pick_y)]
    records = Records(
        tuple(fit), tuple(hold_out), periods[first], names[0], names[1], units[0], units[1], log.sha256, tuple(notes)
    )
    try:
        check_variation(records)
    except LogError as error:
        raise error.within(file=log.path) from None
    return records


def _chosen(log: Log, names: Any, likeliest: Sequence[str], place: str) -> list[str]:
    """Signals of a log by name, or the likeliest that it has."""
    if names is None:
        there = [name for name in likeliest if name in log.layout]
        if not there:
            raise LogError("missing", place=place, expected=f"one of {', '.join(log.layout.names)}", file=log.path)
        return there[:1]
    chosen = [names] if isinstance(names, str) else list(names)
    for name in chosen:
        if name not in log.layout:
            raise LogError("no signal of the log", place=place, value=name, choices=log.layout.names, file=log.path)
    return chosen


def _column(log: Log, signal: str, joint: str) -> int:
    """Number of a joint's column in a signal."""
    joints = log.layout[signal].joints or ()
    number = log.joints.index(joint)
    if number not in joints:
        raise LogError(
            f"joint {joint!r} has no {signal}", place="joint", value=joint, choices=[log.joints[j] for j in joints]
        )
    return joints.index(number)


def _stretches(log: Log, run: LogRun, inputs: Any, outputs: Any) -> list[RecordedStretch]:
    """Parts of a run without gap and without empty cells."""
    blocks = list(log.blocks(run.name))
    t = np.concatenate([block.t for block in blocks])
    u, y = (
        np.stack([np.concatenate([b.values[s][:, k] for b in blocks]) for s, k in pick], axis=1)
        for pick in (inputs, outputs)
    )
    found = []
    for part in run.stretches:
        rows = slice(part.begin, part.end)
        off = np.abs(t[rows] - t[part.begin] - run.period * np.arange(part.rows))
        if off.max(initial=0.0) > max(UNEVEN, 1e-4 * part.rows) * run.period:
            what = f"rows are not evenly spaced: {off.max():.3g} s off a clock of {run.period:.4g} s"
            raise LogError(what, place=f"run {run.name!r}", expected="one clock", file=log.path)
        finite = np.isfinite(u[rows]).all(axis=1) & np.isfinite(y[rows]).all(axis=1)
        for begin, end in part.begin + runs_of_true(np.asarray(finite)):
            found.append(RecordedStretch(run.name, u[begin:end], y[begin:end]))
    return found


def check_variation(records: Records) -> None:
    """Refuses constant signals.

    Raises:
        LogError: names the signal.
    """
    for place, names, what, expected in (
        ("u", records.inputs, "nothing answers to it", "an input that moves: steps, PRBS, multisine, chirp"),
        ("y", records.outputs, "there is nothing to explain", "an output that moves"),
    ):
        if len({getattr(each, place).shape[1] for each in records.fit}) > 1:
            raise LogError("runs with different numbers of signals", place=place)
        for k, name in enumerate(names):
            values = np.concatenate([getattr(each, place)[:, k] for each in records.fit])
            if np.ptp(values) <= CONSTANT * max(float(np.abs(values).max()), 1e-300):
                raise LogError(f"is constant: {what}", place=name, value=float(values[0]), expected=expected)


def check_rows(records: Records, parameters: int, lost: int) -> None:
    """Refuses records that are too short for a model's order.

    Args:
        parameters: number of the model's parameters.   lost: rows that each stretch loses at its beginning.
    Raises:
        LogError: too few rows.
    """
    left = sum(max(len(each.y) - lost, 0) for each in records.fit)
    if left < 5 * parameters:
        what = f"{records.rows} rows leave {left} equations for {parameters} parameters"
        raise LogError(what, place="order", expected=f"at least {5 * parameters}: a lower order, or longer runs")

"""Rows of a log filtered, differentiated and decimated, in memory or in blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy import signal as sp

from armwright.entry import AnyLog, as_log, expect
from armwright.errors import LogError
from armwright.fitting.residuals import parts_of
from armwright.identification.logs.blocks import ROWS, Block
from armwright.identification.logs.even_rows import EvenStretch, sampled_rows
from armwright.identification.logs.findings import number_of
from armwright.identification.logs.log import Log, LogRun
from armwright.identification.logs.merged_speeds import LOWEST, merged
from armwright.identification.logs.preparation import (
    EDGE,
    FIRST_DIFFERENCE,
    SAVGOL,
    SECOND_DIFFERENCE,
    Preparation,
    choose_preparation,
    settling,
)
from armwright.identification.logs.spikes import without_spikes

if TYPE_CHECKING:
    import xarray as xr

SEAM = 1e-9  # what is left of a disturbance where windows of rows meet
RATES = {"q": ("qd", "qdd"), "qd": ("qdd",)}  # what follows from a signal by differentiation, in order


def prepare_log(log: AnyLog, run: str | None = None, preparation: Preparation | None = None) -> xr.Dataset:
    """A run filtered, differentiated and decimated, in memory.

    Args:
        log: what `read_log` returned.   run: its name; None: the first.   preparation: None: what `choose_preparation` says.
    Returns:
        data: coordinates time [s], joint and, along time, stretch (its number); the log's signals, and where they are not logged
            velocities and accelerations. Attribute `preparation` has the choices in words.
    Raises:
        LogError: no stretch is long enough.
    Example:
        >>> log = aw.identification.read_log("examples/logs/dc_motor/dc_motor.log.toml")
        >>> even = aw.identification.prepare_log(log)  # filtered, in even rows
        >>> sorted(even.data_vars)
        ['qd', 'qdd', 'voltage']
    """
    import xarray as xr

    log = as_log(log)
    expect(preparation, Preparation | None, "preparation", "an aw.identification.Preparation", LogError)
    chosen = log.run(run)
    preparation = preparation or choose_preparation(log, chosen.name)
    parts = list(prepared_blocks(log, chosen.name, preparation))
    if not parts:
        raise too_short(log, chosen, preparation)
    time = ("time", np.concatenate([block.t for _, block in parts]), {"units": "s", "long_name": "time"})
    stretches = np.concatenate([np.full(len(block.t), k) for k, block in parts])
    number = ("time", stretches, {"long_name": "stretch without gaps"})
    variables = {}
    for name in parts[0][1].values:
        source = _source(log, name)
        unit = log.layout[name].unit if source == name else _rate_unit(log.layout[source].unit, name)
        values = np.concatenate([block.values[name] for _, block in parts])
        variables[name] = (("time", "joint"), values, {"units": unit})
    about = {
        "log": log.path.name, "run": chosen.name, "use": chosen.use, "log_sha256": log.sha256,
        "preparation": "\n".join(preparation.reasons),
    }  # fmt: skip
    return xr.Dataset(variables, {"time": time, "joint": ("joint", list(log.joints)), "stretch": number}, about)


def _rate_unit(unit: str, name: str) -> str:
    """Unit of a derivative: of q in rad, or of qd in rad/s, qdd has rad/s²."""
    ending = "/s²" if name == "qdd" else "/s"
    return " | ".join(each.removesuffix("/s") + ending for each in unit.split(" | "))


@dataclass(frozen=True, eq=False)
class LoggedMotion:
    """Motion of a run behind a wide low-pass, at which a model is evaluated; what it gives then passes the preparation's.

    Attributes:
        run: of the log.   preparation: with the narrow low-pass.   data: every row behind the wide one, as of `prepare_log`.
        parts: rows of each stretch.   kept: numbers of the rows that are left after the narrow low-pass and its decimation.
    """

    run: LogRun
    preparation: Preparation
    data: xr.Dataset
    parts: list[slice]
    kept: np.ndarray


def logged_motion(log: Log, run: str | None, preparation: Preparation) -> LoggedMotion:
    """The motion of a run behind the wide low-pass of a preparation.

    Args:
        log: what `read_log` returned.   run: its name; None: the first.   preparation: of it.
    Raises:
        LogError: neither position nor speed, or no stretch is long enough.
    """
    chosen = log.run(run)
    first = preparation.of_motion
    data = prepare_log(log, chosen.name, replace(first, decimate=1))
    if "qdd" not in data:
        raise LogError("neither position nor speed logged", place="signals", expected="one of them", file=log.path)
    parts, spoilt = parts_of(data["stretch"].values), preparation.edge - first.edge
    kept = np.concatenate([np.arange(part.start + spoilt, part.stop - spoilt, preparation.decimate) for part in parts])
    if not len(kept):
        expected = f"more than {2 * preparation.edge} rows without a gap; or a higher cut-off"
        raise LogError("no stretch is long enough", place=f"run {chosen.name!r}", expected=expected, file=log.path)
    return LoggedMotion(chosen, preparation, data, parts, kept)


def too_short(log: Log, run: LogRun, preparation: Preparation) -> LogError:
    """The error of a run whose stretches are all shorter than what its low-pass spoils at their ends."""
    longest = number_of(max((each.rows for each in run.even), default=0), "row")
    expected = f"more than {2 * preparation.edge} rows without a gap; or a higher cut-off"
    return LogError(f"the longest stretch has {longest}", place=f"run {run.name!r}", expected=expected, file=log.path)


def _source(log: Log, name: str) -> str:
    """The logged signal that a prepared one is, or is derived from."""
    return name if name in log.layout else next(s for s, rates in RATES.items() if name in rates and s in log.layout)


def prepared_blocks(log: Log, run: str, preparation: Preparation, rows: int = ROWS) -> Iterator[tuple[int, Block]]:
    """Prepared rows of a run with the number of their stretch, block by block in bounded memory.

    Signals are (rows, joints of the log), NaN for joints that do not have them. Windows of rows overlap by what the
    filter needs to settle to 1e-9, so that their seams do not show.
    """
    chosen, first = log.run(run), 0
    reader = sampled_rows(log, chosen)
    seam = settling(preparation.sections, SEAM) + SAVGOL
    window = max(rows // preparation.decimate, 1) * preparation.decimate
    for number, stretch in enumerate(chosen.even):
        low, high = preparation.edge, stretch.rows - preparation.edge
        if high <= low:
            continue
        for begin in range(low, high, window):
            end = min(begin + window, high)
            before, behind = max(begin - seam, 0), min(end + seam, stretch.rows)  # the filter settles beyond the window
            even, period, values = reader.even(stretch, before, behind)
            kept = slice(begin - before, end - before, preparation.decimate)
            yield number, _block(log, first, even, filtered(log, values, period, preparation), kept)
            first += len(range(begin, end, preparation.decimate))


def prepared_excerpt(
    log: Log, run: str, preparation: Preparation, changed: Callable[[EvenStretch], EvenStretch] | None = None
) -> Iterator[tuple[int, Block, Block]]:
    """Prepared rows of a run's excerpt, stretch by stretch: its number, the rows, and the same ones as they were measured.

    Args:
        changed: what to do with the even rows first, such as adding noise; None: nothing.
    """
    for number, even in enumerate(log.run(run).census.even):
        rows = even if changed is None else changed(even)
        kept = slice(preparation.edge, max(len(rows.t) - preparation.edge, 0), preparation.decimate)
        if len(rows.t[kept]):
            measured = without_spikes(rows.values, preparation.spikes)
            prepared = filtered(log, measured, rows.period, preparation)
            yield number, _block(log, 0, rows.t, prepared, kept), _block(log, 0, rows.t, measured, kept)


def _block(log: Log, row: int, t: np.ndarray, values: Mapping[str, np.ndarray], kept: slice) -> Block:
    """The kept ones of some rows as a block that begins at a row, signals for all joints of the log."""
    return Block(row, t[kept], {name: of_all_joints(log, name, each[kept]) for name, each in values.items()})


def filtered(
    log: Log, values: Mapping[str, np.ndarray], period: float, preparation: Preparation
) -> dict[str, np.ndarray]:
    """Signals (rows, joints) of even rows, this period [s] apart, behind the low-pass, and those that are their derivatives."""
    values = without_spikes(values, preparation.spikes)
    values = {name: _around_rows(each) if name in log.held else each for name, each in values.items()}
    found = {name: zero_phase(preparation, each) for name, each in values.items()}
    if {"q", "qd"} <= set(found):
        slope, curvature = (partial(_derivative, period=period, order=k, preparation=preparation) for k in (1, 2))
        limits = np.maximum(preparation.corners, LOWEST * preparation.cutoff)
        found["qd"], found["qdd"] = merged(log, found["q"], found["qd"], 1.0 / period, limits, slope, curvature)
    for source, rates in RATES.items():
        if source in found:
            for order, name in enumerate(rates, start=1):
                found.setdefault(name, _derivative(found[source], period, order, preparation))
    return found


def of_all_joints(log: Log, name: str, values: np.ndarray) -> np.ndarray:
    """A prepared signal (rows, joints of the log), NaN for joints that do not have it."""
    if values.shape[1] == len(log.joints):
        return values
    full = np.full((len(values), len(log.joints)), np.nan)
    full[:, list(log.layout[_source(log, name)].joints or ())] = values
    return full


def _around_rows(values: np.ndarray) -> np.ndarray:
    """Means (rows, joints) over a period around each row of values held until the next one: (u(k - 1) + u(k)) / 2.

    Differences of positions say as much of the motion: the second one of x is T² (ẍ(k - 1) + ẍ(k)) / 2 where ẍ is held.
    """
    return np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1])])


def zero_phase(preparation: Preparation, values: np.ndarray) -> np.ndarray:
    """A signal (rows, joints) of one stretch filtered forward and backward, its ends continued by point reflection."""
    most = len(values) - 1
    pad = min(3 * settling(preparation.sections, EDGE), most)
    return np.asarray(sp.sosfiltfilt(preparation.sections, values, axis=0, padlen=pad))


def _derivative(values: np.ndarray, period: float, order: int, preparation: Preparation) -> np.ndarray:
    """First or second derivative (rows, joints), by central differences as of [Fornberg1988]."""
    if preparation.differentiation == "savgol" and len(values) >= SAVGOL:
        return np.asarray(sp.savgol_filter(values, SAVGOL, 3, deriv=order, delta=period, axis=0))
    half = np.array((FIRST_DIFFERENCE if order == 1 else SECOND_DIFFERENCE)[preparation.differentiation])
    result, beside = np.zeros_like(values), len(half)
    if len(values) <= 2 * beside:  # too few rows: they are dropped at a stretch's ends
        for _ in range(order if len(values) > 1 else 0):
            values = np.asarray(np.gradient(values, period, axis=0))
        return values if len(values) > 1 else result
    windows = np.lib.stride_tricks.sliding_window_view(values, 2 * beside + 1, axis=0)
    middle = 0.0 if order == 1 else -2.0 * half.sum()
    weights = np.concatenate([(-1) ** order * half[::-1], [middle], half])
    result[beside:-beside] = windows @ weights / period**order
    result[:beside], result[-beside:] = result[beside], result[-beside - 1]
    return result

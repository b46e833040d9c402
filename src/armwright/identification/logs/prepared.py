"""Rows of a log filtered, differentiated and decimated, in memory or in blocks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import signal as sp
from scipy.interpolate import CubicSpline

from armwright.entry import AnyLog, as_log, expect
from armwright.errors import LogError
from armwright.fitting.residuals import parts_of
from armwright.identification.logs.blocks import ROWS, Block, run_blocks
from armwright.identification.logs.findings import number_of
from armwright.identification.logs.log import Log, LogRun
from armwright.identification.logs.preparation import (
    EDGE,
    FIRST_DIFFERENCE,
    SAVGOL,
    SECOND_DIFFERENCE,
    Preparation,
    choose_preparation,
    settling,
    shared_preparations,
)
from armwright.identification.logs.stretches import EvenRows

if TYPE_CHECKING:
    import xarray as xr

SEAM = 1e-9  # what is left of a disturbance where windows of rows meet
ROUNDED = 2.0  # digits that times are off even ones, where a clock was rounded, in the row and where the stretch begins
UNEVEN = 1e-3  # of a period: rows further from even times are interpolated
BESIDE_GAP = 8  # rows beyond a window that a spline goes through
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
    number = (
        "time",
        np.concatenate([np.full(len(block.t), k) for k, block in parts]),
        {"long_name": "stretch without gaps"},
    )
    variables = {}
    for name in parts[0][1].values:
        source = _source(log, name)
        unit = log.layout[name].unit if source == name else _rate_unit(log.layout[source].unit, source, name)
        values = np.concatenate([block.values[name] for _, block in parts])
        variables[name] = (("time", "joint"), values, {"units": unit})
    about = {
        "log": log.path.name, "run": chosen.name, "use": chosen.use, "log_sha256": log.sha256,
        "preparation": "\n".join(preparation.reasons),
    }  # fmt: skip
    return xr.Dataset(variables, {"time": time, "joint": ("joint", list(log.joints)), "stretch": number}, about)


def _rate_unit(unit: str, source: str, name: str) -> str:
    """Unit of a derivative: of q in rad, qdd has rad/s²."""
    ending = "/s²" if name == "qdd" else "/s"
    return (
        " | ".join(each.removesuffix("/s") + ending for each in unit.split(" | "))
        if source == "qd"
        else " | ".join(each + ending for each in unit.split(" | "))
    )


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


def logged_motion(log: Log, run: str | None = None, preparation: Preparation | None = None) -> LoggedMotion:
    """The motion of a run behind the wide low-pass of a preparation.

    Args:
        log: what `read_log` returned.   run: its name; None: the first.
        preparation: None: that with the highest cut-off that any run needs.
    Raises:
        LogError: neither position nor speed, or no stretch is long enough.
    """
    chosen = log.run(run)
    preparation = preparation or shared_preparations(log, [chosen.name])[chosen.name]
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
    reader = _Rows(log, chosen)
    seam = settling(preparation.sections, SEAM) + SAVGOL
    window = max(rows // preparation.decimate, 1) * preparation.decimate
    for number, stretch in enumerate(chosen.even):
        low, high = preparation.edge, stretch.rows - preparation.edge
        if high <= low:
            continue
        for begin in range(low, high, window):
            end = min(begin + window, high)
            yield number, _window(reader, stretch, preparation, begin, end, seam, first)
            first += len(range(begin, end, preparation.decimate))


def _window(
    reader: _Rows, stretch: EvenRows, preparation: Preparation, begin: int, end: int, seam: int, first: int
) -> Block:
    """Prepared rows `begin` to `end` of a stretch, from rows beyond them either way."""
    low, high = max(begin - seam, 0), min(end + seam, stretch.rows)
    even = stretch.start + stretch.period * np.arange(low, high)
    if stretch.has_gaps:
        times, values = even, reader.between(stretch, even)
    else:
        times, values = reader.rows(stretch.begin + low, stretch.begin + high)
    if np.abs(times - even).max() > max(UNEVEN * stretch.period, ROUNDED * reader.resolution):
        even = np.clip(even, times[0], times[-1])
        values = {n: np.stack([np.interp(even, times, c) for c in v.T], axis=1) for n, v in values.items()}
    values = {name: _around_rows(each) if name in reader.log.held else each for name, each in values.items()}
    filtered = {name: zero_phase(preparation, each) for name, each in values.items()}
    for source, rates in RATES.items():
        if source in filtered:
            for order, name in enumerate(rates, start=1):
                filtered.setdefault(name, _derivative(filtered[source], stretch.period, order, preparation))
    kept = slice(begin - low, end - low, preparation.decimate)
    return Block(
        first, even[kept], {name: _of_all_joints(reader.log, name, each[kept]) for name, each in filtered.items()}
    )


def _of_all_joints(log: Log, name: str, values: np.ndarray) -> np.ndarray:
    """A prepared signal (rows, joints of the log), NaN for joints that do not have it."""
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


class _Rows:
    """Rows of a run by number; rows long before the last request are dropped."""

    def __init__(self, log: Log, run: LogRun):
        self.log = log
        self.resolution = 0.0 if run.census is None else run.census.resolution
        self._blocks = run_blocks(log, run, ROWS)
        self._begin = 0
        self._t = np.zeros(0)
        self._values: dict[str, np.ndarray] = {}

    def between(self, stretch: EvenRows, times: np.ndarray) -> dict[str, np.ndarray]:
        """Signals at some times of a stretch with short gaps, by cubic splines through the cells that are there."""
        while self._begin + len(self._t) < stretch.end and not (len(self._t) and self._t[-1] > times[-1]):
            late = self._begin + int(np.searchsorted(_increasing(self._t), times[0])) - BESIDE_GAP
            self._add(next(self._blocks), late)
        first, end = (min(max(row - self._begin, 0), len(self._t)) for row in (stretch.begin, stretch.end))
        low, high = np.searchsorted(_increasing(self._t[first:end]), times[[0, -1]])
        part = slice(first + max(int(low) - BESIDE_GAP, 0), min(first + int(high) + BESIDE_GAP, end))
        t = self._t[part]
        newer = np.isfinite(t) & (np.diff(_increasing(t), prepend=-np.inf) > 0)
        found = {}
        for name, values in self._values.items():
            columns = []
            for column in values[part].T:
                known = newer & np.isfinite(column)
                columns.append(CubicSpline(t[known], column[known])(np.clip(times, t[known][0], t[known][-1])))
            found[name] = np.stack(columns, axis=1)
        return found

    def rows(self, begin: int, end: int) -> tuple[np.ndarray, Mapping[str, np.ndarray]]:
        """Times and signals of rows `begin` to `end`; `begin` may go back only a limited distance."""
        while self._begin + len(self._t) < end:
            self._add(next(self._blocks), begin)
        part = slice(begin - self._begin, end - self._begin)
        return self._t[part], {name: each[part] for name, each in self._values.items()}

    def _add(self, block: Block, begin: int) -> None:
        """Adds rows and forgets those before `begin`."""
        count = min(max(begin - self._begin, 0), len(self._t))
        self._begin += count
        self._t = self._t[count:]
        self._values = {name: each[count:] for name, each in self._values.items()}
        self._t = np.concatenate([self._t, block.t])
        self._values = {
            name: np.concatenate([self._values[name], each]) if name in self._values else each
            for name, each in block.values.items()
        }


def _increasing(t: np.ndarray) -> np.ndarray:
    """Times (rows,), those that are missing or go back as the latest before them."""
    return np.maximum.accumulate(np.where(np.isfinite(t), t, -np.inf))

"""Preparation of logs for fitting: zero-phase low-pass, differentiation, decimation, with the choices in words.

All signals of a run pass the same filter, a Butterworth low-pass run forward and backward: it shifts
nothing in time, and a linear relation between signals (torque = regressor · parameters) holds between the filtered ones too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import ceil, log
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy import signal as sp

from armwright.errors import LogError
from armwright.identification.logs.log import ROWS, Block, Log, LogRun, Stretch
from armwright.identification.logs.quantisation import quantisation_step

if TYPE_CHECKING:
    import xarray as xr

ABOVE = 4.0  # times the noise floor: below it noise is a quarter of the power and more
HIGHEST, LOWEST = 0.4, 1e-3  # cut-off as a share of the rate
ROOM = 2.5  # rate after decimation by the cut-off: its half, Nyquist's frequency, is a quarter above the cut-off
EDGE, SEAM = 1e-3, 1e-9  # what is left of a disturbance at a stretch's edge, and where windows of rows meet
UNEVEN = 1e-3  # of a period: rows further from even times are interpolated
FASTEST = 0.1  # as a share of the rate: where motion has its largest accelerations, at most
RISE = 3.0  # times the lowest power: behind such a rise it was a valley
VALLEY = 1.5  # times the lowest power: still the valley
OCTAVE = 2**0.5
LINE, LOBE = 30.0, 3  # times its surroundings: a line; bins to either side over which the window spreads it
PART = 0.01  # of the power of the line with the largest acceleration: of less a fit knows nothing
BEYOND_LINES = 1.5  # cut-off by the highest line, of whose amplitude 96 % are left
SHORTEST = 32  # rows of a signal that has a spectrum
SEGMENT = 4096  # rows of a spectrum's segment
RATES = {"q": ("qd", "qdd"), "qd": ("qdd",)}  # what follows from a signal by differentiation, in order
SAVGOL = 9  # rows of the Savitzky-Golay window, of third order


@dataclass(frozen=True)
class Preparation:
    """Choices of `prepare_log`, made by `choose_preparation` or by hand.

    Attributes:
        cutoff: of the low-pass, where amplitudes are halved, in Hz.   order: of the Butterworth filter, which runs twice.
        decimate: every how many rows are kept.   differentiation: "central" differences, or "savgol", a cubic through 9 rows.
        edge: rows that are dropped at either end of a stretch.   rate: of the log, in Hz.   reasons: the choices in words.
    """

    cutoff: float
    order: int
    decimate: int
    differentiation: Literal["central", "savgol"]
    edge: int
    rate: float
    reasons: tuple[str, ...] = ()

    @property
    def sections(self) -> np.ndarray:
        """The filter as second-order sections."""
        return low_pass(self.order, self.cutoff, self.rate)


def choose_preparation(
    log: Log,
    run: str | None = None,
    *,
    cutoff: float | None = None,
    order: int = 4,
    decimate: int | None = None,
    differentiation: Literal["central", "savgol"] = "central",
) -> Preparation:
    """A low-pass, a way of differentiation and a decimation that fit a run, each with its reason.

    The cut-off is the end of the motion's band as `motion_band` has it, of the joint with the widest: accelerations above it
    would be noise for the most part.

    Args:
        log: a checked log.   run: its name; None: the first.   cutoff: in Hz, instead of the choice.   order: of the filter.
        decimate: every how many rows to keep, instead of the choice.   differentiation: "central" or "savgol".
    Returns:
        preparation: for `prepare_log`; its `reasons` are the choices in words.
    Raises:
        LogError: no such run, or a choice that the log's rate does not allow.
    """
    chosen = log.run(run)
    if chosen.census is None:
        raise LogError("was not checked", place="log", expected="what read_log returns")
    rate = 1.0 / chosen.period
    reasons: list[str] = []
    if cutoff is None:
        cutoff, reason = _cutoff(log, chosen, rate)
        reasons.append(reason)
    elif not 0 < cutoff < 0.5 * rate:
        raise LogError(
            place="cutoff", value=cutoff, expected=f"a frequency above 0, below half the rate, {0.5 * rate:.4g} Hz"
        )
    else:
        reasons.append(f"cut-off {cutoff:.4g} Hz: as asked for")
    if not isinstance(order, int) or not 1 <= order <= 10:
        raise LogError(place="order", value=order, expected="a whole number from 1 to 10")
    if differentiation not in ("central", "savgol"):
        raise LogError(place="differentiation", value=differentiation, expected='"central" or "savgol"')
    most = max(int(rate / (ROOM * cutoff)), 1)
    if decimate is not None and (
        not isinstance(decimate, int) or not 1 <= decimate <= max(int(rate / (2 * cutoff)), 1)
    ):
        expected = f"1 to {max(int(rate / (2 * cutoff)), 1)}: a rate of twice the cut-off at least"
        raise LogError(place="decimate", value=decimate, expected=expected)
    factor = most if decimate is None else decimate
    sections = low_pass(order, cutoff, rate)
    edge = settling(sections, EDGE) + (1 if differentiation == "central" else SAVGOL // 2)
    x = np.pi * cutoff / rate
    reasons += [
        f"Butterworth of order {order}, forward and backward: no delay; amplitudes halved at the cut-off, "
        f"{_gain(sections, 0.5 * cutoff, rate):.1%} of them left at half of it",
        f"central differences: {1 - np.sin(2 * x) / (2 * x):.1%} too small at the cut-off"
        if differentiation == "central"
        else f"Savitzky-Golay: the derivative of a cubic through {SAVGOL} rows",
        f"every {factor}{_th(factor)} row is kept, {rate / factor:.4g} Hz: filtered rows between say nothing new"
        if factor > 1
        else "all rows are kept: fewer would not carry the signal",
        f"{edge} rows ({1e3 * edge / rate:.3g} ms) at either end of a stretch are dropped: the filter has not settled there",
    ]
    return Preparation(float(cutoff), order, factor, differentiation, edge, rate, tuple(reasons))


def _th(number: int) -> str:
    return {1: "st", 2: "nd", 3: "rd"}.get(number % 10 if number % 100 not in (11, 12, 13) else 0, "th")


def _gain(sections: np.ndarray, frequency: float, rate: float) -> float:
    """Gain of the filter run forward and backward."""
    return float(np.abs(np.asarray(sp.sosfreqz(sections, [frequency], fs=rate)[1])[0]) ** 2)


def low_pass(order: int, cutoff: float, rate: float) -> np.ndarray:
    """A Butterworth filter as second-order sections (k, 6); frequencies in Hz."""
    return np.asarray(sp.butter(order, cutoff, fs=rate, output="sos"))


def settling(sections: np.ndarray, left: float) -> int:
    """Rows after which a share `left` of a disturbance is left: ln(left) / ln(largest pole's magnitude)."""
    poles = np.concatenate([np.roots(section[3:]) for section in sections])
    return ceil(log(left) / log(max(float(np.abs(poles).max()), 1e-3)))


def spectrum(values: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Power density of a signal by Welch's method: f (k,) in Hz and power (k,) [unit²/Hz], without zero frequency.

    Args:
        values: (rows,).   rate: in Hz.

    The spectrum of the differences is divided by their gain: the slow motion, which is far larger, would leak over the rest.
    """
    steps = np.diff(values)
    f, power = sp.welch(steps, rate, nperseg=min(SEGMENT, len(steps)), detrend="constant")
    return f[1:], power[1:] / (2 * np.sin(np.pi * f[1:] / rate)) ** 2


def _cutoff(log: Log, run: LogRun, rate: float) -> tuple[float, str]:
    """The cut-off in Hz that the joint with the fastest motion needs, and the reason for it."""
    assert run.census is not None
    name = next((name for name in ("q", "qd") if name in log.layout), log.layout.names[0])
    signal, values = log.layout[name], run.census.excerpt.values[name]
    best, reason = (
        LOWEST * rate,
        f"cut-off {LOWEST * rate:.4g} Hz: no motion stands above the noise; the lowest that the rate allows",
    )
    for k, joint in enumerate(signal.joints or ()):
        column = longest_finite(values[:, k])
        if len(column) < SHORTEST or column.std() == 0:
            continue
        valley, is_valley = motion_band(column, rate, 2 if name == "q" else 1)
        if valley > best:
            step = quantisation_step(column)
            noise = f"noise (quantised in steps of {step:.3g} {signal.units[k]})" if step else "noise"
            why = (
                f"there the acceleration's spectrum has its valley: below it is motion, above it {noise}"
                if is_valley
                else f"above it the signal is less than {ABOVE:g} times its {noise}"
            )
            best, reason = valley, f"cut-off {valley:.4g} Hz, for {signal.name} of {log.joints[joint]!r}: {why}"
    return best, reason


def motion_band(values: np.ndarray, rate: float, derivatives: int) -> tuple[float, bool]:
    """Frequency in Hz up to which a signal's accelerations are motion, and whether that is a valley of their spectrum.

    Motion fades with frequency, while noise of positions grows with its fourth power in accelerations: the spectrum has a valley
    between the two. Where it has none, the band ends where the signal comes down to its noise floor. Gaps between the lines of a
    multisine are no valleys: the band reaches beyond every line that stands out. 0 Hz for a signal at rest.

    Args:
        values: (rows,).   rate: in Hz.   derivatives: from the signal to accelerations: 2 of positions, 1 of speeds.
    """
    f, power = spectrum(values, rate)
    smooth = _smooth(f, power)
    floor = float(np.median(power[f > 0.25 * rate]))
    above = smooth > ABOVE * floor
    acceleration = smooth * f ** (2 * derivatives)
    peak = int(np.argmax(acceleration * above * (f < FASTEST * rate)))
    if not above[peak]:
        return 0.0, False
    top = int(np.searchsorted(f, HIGHEST * rate))
    acceleration = acceleration[peak:top]
    risen = np.flatnonzero(acceleration > RISE * np.minimum.accumulate(acceleration))
    faded = np.flatnonzero(~above[peak:top])
    end = f[peak + faded[0]] if len(faded) else HIGHEST * rate
    valley = np.inf
    if (
        len(risen) and acceleration[: risen[0]].min() * RISE <= acceleration[0]
    ):  # else it rises from the peak on: motion
        before = acceleration[: risen[0]]
        far_end = np.flatnonzero(before <= VALLEY * before.min())[
            -1
        ]  # of the valley: rather some noise than less motion
        valley = f[peak + int(far_end)]
    # quantisation of a periodic motion has lines too: of less power than a step's variance, and up to the highest frequencies
    noise = (quantisation_step(values) or 0.0) ** 2 / 12.0 / (f[1] - f[0])
    least = max(noise, ABOVE * float(power[f > 0.25 * rate].max()))
    last = BEYOND_LINES * highest_line(f, power, derivatives, least)
    if last > min(valley, end):
        valley, end = np.inf, last
    return float(np.clip(min(valley, end), LOWEST * rate, HIGHEST * rate)), bool(valley <= end)


def highest_line(f: np.ndarray, power: np.ndarray, derivatives: int, least: float) -> float:
    """Highest frequency in Hz of a line of the spectrum, as of a multisine, that has its part in the accelerations; 0: none.

    A line is LINE times as high as the mean of the octave around it without its neighbours, and at least as high as noise.

    Args:
        f, power: (k,) of `spectrum`.   derivatives: from the signal to accelerations.   least: power of a line of noise.
    """
    total = np.concatenate([[0.0], np.cumsum(power)])
    k = np.arange(len(f))

    def inside(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return total[high] - total[low], high - low

    octave = inside(np.searchsorted(f, f / OCTAVE), np.searchsorted(f, f * OCTAVE, side="right"))
    near = inside(np.maximum(k - LOBE, np.searchsorted(f, f / OCTAVE)), np.minimum(k + LOBE + 1, len(f)))
    others, count = np.maximum(octave[0] - near[0], 0.0), octave[1] - near[1]
    lines = (count >= LOBE) & (power * count > LINE * others) & (power > least)
    acceleration = power * f ** (2 * derivatives) * lines
    heard = np.flatnonzero(acceleration > PART * acceleration.max(initial=0.0))
    return float(f[heard[-1]]) if len(heard) else 0.0


def _smooth(f: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Mean of a spectrum over the octave around each frequency: lobes of single moves have valleys of their own."""
    total = np.concatenate([[0.0], np.cumsum(power)])
    low, high = np.searchsorted(f, f / OCTAVE), np.searchsorted(f, f * OCTAVE, side="right")
    return (total[high] - total[low]) / (high - low)


def longest_finite(column: np.ndarray) -> np.ndarray:
    """The longest part of a column without NaN."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.isfinite(column), [False]]).astype(np.int8)))
    if not len(edges):
        return column[:0]
    k = int(np.argmax(edges[1::2] - edges[::2]))
    return column[edges[2 * k] : edges[2 * k + 1]]


def prepare_log(log: Log, run: str | None = None, preparation: Preparation | None = None) -> xr.Dataset:
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

    chosen = log.run(run)
    preparation = preparation or choose_preparation(log, chosen.name)
    parts = list(prepared_blocks(log, chosen.name, preparation))
    if not parts:
        longest = max((stretch.rows for stretch in chosen.stretches), default=0)
        expected = f"more than {2 * preparation.edge} rows without a gap; or a higher cut-off"
        raise LogError(
            f"the longest stretch has {longest} rows", place=f"run {chosen.name!r}", expected=expected, file=log.path
        )
    time = ("time", np.concatenate([block.t for _, block in parts]), {"units": "s", "long_name": "time"})
    number = (
        "time",
        np.concatenate([np.full(len(block.t), k) for k, block in parts]),
        {"long_name": "stretch without gaps"},
    )
    variables = {}
    for name in parts[0][1].values:
        source = (
            name if name in log.layout else next(s for s, rates in RATES.items() if name in rates and s in log.layout)
        )
        values = np.full((len(time[1]), len(log.joints)), np.nan)
        values[:, list(log.layout[source].joints or ())] = np.concatenate([block.values[name] for _, block in parts])
        unit = log.layout[name].unit if name in log.layout else _rate_unit(log.layout[source].unit, source, name)
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


def prepared_blocks(log: Log, run: str, preparation: Preparation, rows: int = ROWS) -> Iterator[tuple[int, Block]]:
    """Prepared rows of a run with the number of their stretch, block by block in bounded memory.

    Windows of rows overlap by what the filter needs to settle to 1e-9, so that their seams do not show.
    """
    reader = _Rows(log, run)
    chosen, first = log.run(run), 0
    seam = settling(preparation.sections, SEAM) + SAVGOL
    window = max(rows // preparation.decimate, 1) * preparation.decimate
    for number, stretch in enumerate(chosen.stretches):
        low, high = preparation.edge, stretch.rows - preparation.edge
        if high <= low:
            continue
        for begin in range(low, high, window):
            end = min(begin + window, high)
            yield number, _window(reader, stretch, preparation, begin, end, seam, first)
            first += len(range(begin, end, preparation.decimate))


def _window(
    reader: _Rows, stretch: Stretch, preparation: Preparation, begin: int, end: int, seam: int, first: int
) -> Block:
    """Prepared rows `begin` to `end` of a stretch, from rows beyond them either way."""
    low, high = max(begin - seam, 0), min(end + seam, stretch.rows)
    times, values = reader.rows(stretch.begin + low, stretch.begin + high)
    even = stretch.start + stretch.period * np.arange(low, high)
    if np.abs(times - even).max() > UNEVEN * stretch.period:
        even = np.clip(even, times[0], times[-1])
        values = {n: np.stack([np.interp(even, times, c) for c in v.T], axis=1) for n, v in values.items()}
    filtered = {name: zero_phase(preparation, each) for name, each in values.items()}
    for source, rates in RATES.items():
        if source in filtered:
            for order, name in enumerate(rates, start=1):
                filtered.setdefault(name, _derivative(filtered[source], stretch.period, order, preparation))
    kept = slice(begin - low, end - low, preparation.decimate)
    return Block(first, even[kept], {name: each[kept] for name, each in filtered.items()})


def zero_phase(preparation: Preparation, values: np.ndarray) -> np.ndarray:
    """A signal (rows, joints) filtered forward and backward, its ends continued by point reflection."""
    most = len(values) - 1
    pad = min(3 * settling(preparation.sections, EDGE), most)
    return np.asarray(sp.sosfiltfilt(preparation.sections, values, axis=0, padlen=pad))


def _derivative(values: np.ndarray, period: float, order: int, preparation: Preparation) -> np.ndarray:
    """First or second derivative (rows, joints)."""
    if preparation.differentiation == "savgol" and len(values) >= SAVGOL:
        return np.asarray(sp.savgol_filter(values, SAVGOL, 3, deriv=order, delta=period, axis=0))
    result = np.zeros_like(values)
    if order == 1:
        result[1:-1] = (values[2:] - values[:-2]) / (2 * period)
    else:
        result[1:-1] = (values[2:] - 2 * values[1:-1] + values[:-2]) / period**2
    if len(values) > 2:
        result[0], result[-1] = result[1], result[-2]
    return result


class _Rows:
    """Rows of a run by number; those before the last ones asked for are forgotten."""

    def __init__(self, log: Log, run: str):
        self._blocks = log.blocks(run)
        self._begin = 0
        self._t = np.zeros(0)
        self._values: dict[str, np.ndarray] = {}

    def rows(self, begin: int, end: int) -> tuple[np.ndarray, Mapping[str, np.ndarray]]:
        """Times and signals of rows `begin` to `end`; `begin` never goes back by more than was asked for before."""
        while self._begin + len(self._t) < end:
            block = next(self._blocks)
            self._drop(begin)
            self._t = np.concatenate([self._t, block.t])
            self._values = {
                name: np.concatenate([self._values[name], each]) if name in self._values else each
                for name, each in block.values.items()
            }
        part = slice(begin - self._begin, end - self._begin)
        return self._t[part], {name: each[part] for name, each in self._values.items()}

    def _drop(self, begin: int) -> None:
        count = min(max(begin - self._begin, 0), len(self._t))
        self._begin += count
        self._t = self._t[count:]
        self._values = {name: each[count:] for name, each in self._values.items()}

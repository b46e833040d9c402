"""Frequency response of a plant from its input and output, with coherence and confidence bands."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import f as f_distribution

from armwright.errors import LogError
from armwright.identification.linear.records import LIKELIEST, LogSignals, Records, records_of
from armwright.identification.linear.residuals import CERTAIN, feedback
from armwright.identification.logs.findings import number_of
from armwright.results.result import BLUE, Result
from armwright.results.table import Table, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REPEATS = 1e-9  # of the input's range: rows a period apart that differ by no more are equal
OVERLAP = 2  # segments begin every 1/OVERLAP of their length
SEGMENTS = 8  # that a record should have at least, by default
EXCITED = 1e-3  # of the largest line of a periodic input: smaller ones are not driven


@dataclass(frozen=True, eq=False)
class FrequencyResponse(Result):
    """H(f) = output / input, with its uncertainty.

    Attributes:
        frequency: (k,), in Hz.   response: (k,) complex.   coherence: (k,) 0 to 1, how much of the output the input explains.
        std: (k,) standard deviation of |H|; that of the phase is std / |H| [rad].   period: [s] of the samples.
        averages: number of independent averages.   method: one line.   remarks: sentences.   units: of output and input.
        sha256: of the log.
    """

    frequency: np.ndarray
    response: np.ndarray
    coherence: np.ndarray
    std: np.ndarray
    period: float
    averages: float
    method: str
    units: tuple[str, str] = ("", "")
    remarks: tuple[str, ...] = ()
    sha256: str = ""

    def radius(self, level: float = 0.95) -> np.ndarray:
        """Radius (k,) of the confidence disc around H at this probability. [BendatPiersol2010], section 9.2."""
        freedom = max(2.0 * self.averages - 2.0, 1.0)
        return self.std * np.sqrt(2.0 * f_distribution.ppf(level, 2, freedom))

    def band(self, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest |H| (k,) of that disc."""
        radius = self.radius(level)
        return np.maximum(np.abs(self.response) - radius, 0.0), np.abs(self.response) + radius

    def to_control(self) -> Any:
        """The response as `control.FrequencyResponseData` of python-control, at angular frequencies.

        Raises:
            LogError: python-control is not installed.
        """
        control = python_control()
        return control.frd(self.response, 2 * np.pi * self.frequency, dt=self.period)

    def sentences(self) -> list[str]:
        """Remarks and method."""
        return [*self.remarks, self.method]

    def tables(self) -> list[Table]:
        """A row for each frequency."""
        columns = (self.frequency, np.abs(self.response), self.std, np.degrees(np.angle(self.response)), self.coherence)
        rows = [[number(value) for value in row] for row in zip(*columns, strict=True)]
        heads = ("frequency [Hz]", "magnitude", "± std", "phase [deg]", "coherence")
        return [Table("frequency response", heads, rows)]

    def draw(self, figure: Figure, ink: str, quiet: str) -> None:
        """Draws magnitude and phase over frequency, with the standard deviation as a band."""
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        size = np.abs(self.response)
        low, high = np.maximum(size - self.std, 1e-3 * size), size + self.std
        above.fill_between(self.frequency, low, high, color=BLUE, alpha=0.3, linewidth=0)
        above.plot(self.frequency, size, color=BLUE)
        below.plot(self.frequency, np.degrees(np.unwrap(np.angle(self.response))), color=BLUE)
        above.set(xscale="log", yscale="log", ylabel="magnitude")
        below.set(xlabel="frequency [Hz]", ylabel="phase [deg]")

    def __str__(self) -> str:
        rows = [f"{'f [Hz]':>10} {'|H|':>11} {'± std':>9} {'phase [deg]':>12} {'coherence':>10}"]
        for k in np.unique(np.linspace(0, len(self.frequency) - 1, 20).astype(int)):
            h = self.response[k]
            rows.append(
                f"{self.frequency[k]:10.4g} {abs(h):11.4g} {self.std[k]:9.2g} {np.degrees(np.angle(h)):12.1f} "
                f"{self.coherence[k]:10.4f}"
            )
        return "\n".join([*rows, *self.remarks, self.method])


def python_control() -> Any:
    """The package python-control.

    Raises:
        LogError: not installed.
    """
    try:
        import control
    except ImportError:
        raise LogError("python-control is not installed", expected="pip install armwright[control]") from None
    return control


def frequency_response(
    data: Any,
    y: Any = None,
    period: Any = None,
    *,
    signals: LogSignals = LIKELIEST,
    segment: int | None = None,
    repeats: int | None = None,
) -> FrequencyResponse:
    """Frequency response from a log or from arrays: H1 = S_yu / S_uu by Welch's method [Welch1967], or averages over periods.

    An input that repeats itself is averaged over its periods, all but the first, and evaluated at the lines it drives: this
    leaves no error of windows, and the spread from period to period is the standard deviation [PintelonSchoukens2012]. Any
    other is cut into segments with Hann's window, half overlapping, and  std² = |H|² (1 - γ²) / (2 γ² n)  [BendatPiersol2010].

    Args:
        data: a `Log`, or u (rows,).   y: (rows,).   period: [s].
        signals: of a log: one input, one output, one joint.
        segment: rows of a Welch segment; default: an eighth of the longest stretch, at most 4096.
        repeats: rows of a period of the input; default: found; 0: not periodic.
    Returns:
        response: with coherence and standard deviation.
    Raises:
        LogError: bad data, several inputs, too few rows for the segment.
    Example:
        >>> u = np.random.default_rng(0).standard_normal(2000)
        >>> found = aw.identification.frequency_response(u, 0.5 * u, 0.01)
        >>> float(abs(found.response[3]).round(3))
        0.5
    """
    records = records_of(data, y, period, signals)
    if len(records.inputs) > 1 or len(records.outputs) > 1:
        raise LogError("several inputs or outputs", place="input", expected="one of each; fit_n4sid has several")
    for place, value, least in (("segment", segment, 4), ("repeats", repeats, 0)):
        if value is not None and (not isinstance(value, (int, np.integer)) or value < least):
            raise LogError(place=place, value=value, expected=f"a whole number from {least} on")
    longest = max(records.fit, key=lambda each: len(each.y))
    rows = _repetition(longest.u[:, 0]) if repeats is None else repeats
    if rows and len(longest.y) < 3 * rows:
        expected = "three periods: one to settle, two to compare"
        raise LogError(f"{len(longest.y)} rows", place="repeats", value=rows, expected=expected)
    found = _periodic(records, rows) if rows else _welch(records, segment)
    test = feedback(records.fit, 1)
    if test.p < CERTAIN:
        found = replace(found, remarks=(*found.remarks, closed_loop("H1 = S_yu / S_uu")))
    return found


def closed_loop(method: str) -> str:
    """The remark on data recorded under feedback."""
    return (
        f"the input follows past disturbances of the output (closed loop): {method} needs an open loop and is biased "
        "here, towards the inverse of the controller; use ARMAX, or log an excitation that is added to the input"
    )


def _repetition(u: np.ndarray) -> int:
    """Rows after which an input repeats itself exactly, three times at least; 0: it does not."""
    n = len(u)
    size = 1 << (2 * n - 1).bit_length()
    centred = u - u.mean()
    r = np.fft.irfft(np.abs(np.fft.rfft(centred, size)) ** 2, size)[: n // 3 + 1]
    share = r / max(r[0], 1e-300) * n / (n - np.arange(len(r)))
    tolerance = REPEATS * np.ptp(u)
    for k in np.flatnonzero(share > 0.95)[1:]:
        if k >= 4 and np.abs(u[k:] - u[: n - k]).max() <= tolerance and np.ptp(u[:k]) > 0:
            return int(k)
    return 0


def _periodic(records: Records, rows: int) -> FrequencyResponse:
    """Average over the periods of all stretches but the first of each."""
    lines_u, lines_y = [], []
    for each in records.fit:
        for k in range(1, len(each.y) // rows):
            part = slice(k * rows, (k + 1) * rows)
            lines_u.append(np.fft.rfft(each.u[part, 0])[1:])
            lines_y.append(np.fft.rfft(each.y[part, 0])[1:])
    u, y = np.array(lines_u), np.array(lines_y)
    count = len(u)
    mean_u, mean_y = u.mean(axis=0), y.mean(axis=0)
    driven = np.abs(mean_u) > EXCITED * np.abs(mean_u).max()
    h = mean_y[driven] / mean_u[driven]
    rest = (y[:, driven] - mean_y[driven]) - h * (u[:, driven] - mean_u[driven])
    variance = (np.abs(rest) ** 2).sum(axis=0) / (count - 1) / count / np.abs(mean_u[driven]) ** 2  # of complex H
    power = (np.abs(y[:, driven]) ** 2).mean(axis=0)
    coherence = np.clip(1.0 - (np.abs(rest) ** 2).mean(axis=0) / np.maximum(power, 1e-300), 0.0, 1.0)
    frequency = np.fft.rfftfreq(rows, records.period)[1:][driven]
    method = f"average over {count} periods of {rows} rows, the first of each stretch left out; {int(driven.sum())} driven lines"
    return FrequencyResponse(
        frequency, h, coherence, np.sqrt(variance / 2), records.period, float(count), method,
        (records.output_units[0], records.input_units[0]), records.notes, records.sha256,
    )  # fmt: skip


def _welch(records: Records, segment: int | None) -> FrequencyResponse:
    longest = max(len(each.y) for each in records.fit)
    rows = segment or int(min(4096, 2 ** np.floor(np.log2(max(2 * longest // (SEGMENTS + 1), 1)))))
    usable = [each for each in records.fit if len(each.y) >= rows]
    if rows < 8 or not usable:
        what = f"the longest stretch has {number_of(longest, 'row')}"
        raise LogError(what, place="segment", value=rows, expected="at most as many, and 8 at least")
    window = np.hanning(rows + 1)[:-1]
    s_uu, s_yy, s_yu, count = 0.0, 0.0, 0.0 + 0.0j, 0
    for each in usable:
        for begin in range(0, len(each.y) - rows + 1, rows // OVERLAP):
            u, y = (_spectrum(column[begin : begin + rows, 0], window) for column in (each.u, each.y))
            s_uu, s_yy, s_yu, count = s_uu + np.abs(u) ** 2, s_yy + np.abs(y) ** 2, s_yu + y * u.conj(), count + 1
    if count < 2:
        raise LogError(
            "one segment alone has no coherence", place="segment", value=rows, expected=f"at most {longest // 2} rows"
        )
    half = float((window[rows // 2 :] @ window[: rows - rows // 2]) / (window @ window)) ** 2
    averages = count / (1.0 + 2.0 * half * (count - 1) / count)  # overlapping segments are correlated
    h = s_yu / np.maximum(s_uu, 1e-300)
    coherence = np.clip(np.abs(s_yu) ** 2 / np.maximum(s_uu * s_yy, 1e-300), 0.0, 1.0)
    std = np.abs(h) * np.sqrt((1.0 - coherence) / np.maximum(2.0 * coherence * averages, 1e-300))
    remarks = list(records.notes)
    low = coherence < 0.5
    if low.any():
        remarks.append(
            f"coherence is below 0.5 at {int(low.sum())} of {len(low)} frequencies: noise, or no excitation there"
        )
    method = f"Welch's H1, {count} Hann segments of {rows} rows, half overlapping ({averages:.1f} independent)"
    return FrequencyResponse(
        np.fft.rfftfreq(rows, records.period)[1:], h, coherence, std, records.period, averages, method,
        (records.output_units[0], records.input_units[0]), tuple(remarks), records.sha256,
    )  # fmt: skip


def _spectrum(values: np.ndarray, window: np.ndarray) -> np.ndarray:
    return np.fft.rfft((values - values.mean()) * window)[1:]

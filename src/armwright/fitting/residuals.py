"""Tests of residuals: whiteness, correlation with the input, and their spectrum. [Ljung1999]"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import signal as sp, stats

LAGS = 25  # samples
CONFIDENCE = 0.99
SEGMENT = 512  # rows of a spectrum's segment
Parts = Sequence[slice]  # rows without gaps


@dataclass(frozen=True, eq=False)
class Correlation:
    """Correlation of residuals over lags, with 99 % bounds for uncorrelated signals.

    Attributes:
        lags: (k,) in samples.   values: (k,) −1 to 1.   bound: 99 % lie within ± this.   outside: share of values beyond.
    """

    lags: np.ndarray
    values: np.ndarray
    bound: float

    @property
    def outside(self) -> float:
        """Share of the values beyond the bounds; 0.01 by chance."""
        return float((np.abs(self.values) > self.bound).mean())

    @property
    def largest(self) -> tuple[int, float]:
        """Lag with the largest correlation, and that."""
        k = int(np.argmax(np.abs(self.values)))
        return int(self.lags[k]), float(self.values[k])


@dataclass(frozen=True)
class ChiSquared:
    """A statistic, χ² under the null hypothesis.

    Attributes:
        q: the statistic.   lags: its degrees of freedom.   p: probability of a larger one by chance.
    """

    q: float
    lags: int
    p: float

    @classmethod
    def of(cls, q: float, lags: int) -> ChiSquared:
        """The test of a statistic."""
        return cls(q, lags, float(stats.chi2.sf(q, lags)))


def parts_of(number: np.ndarray) -> list[slice]:
    """Stretches of rows that carry the same number (k,)."""
    edges = [0, *(np.flatnonzero(np.diff(number)) + 1), len(number)]
    return [slice(int(a), int(b)) for a, b in pairwise(edges) if b > a]


def autocorrelation(residuals: np.ndarray, parts: Parts, lags: int = LAGS) -> Correlation | None:
    """Autocorrelation r_k = Σ e_t e_{t+k} / Σ e_t², k = 1 … lags, over stretches of rows; bound 2.58 / √N.

    Args:
        residuals: (rows,).   parts: their stretches; products never reach from one into another.   lags: at most.
    Returns:
        correlation: None of residuals that are constant, or too few.
    """
    e, n = _centred(residuals, parts), sum(part.stop - part.start for part in parts)
    most = min(lags, max((part.stop - part.start for part in parts), default=0) // 4)
    power = sum(float(each @ each) for each in e)
    if most < 1 or power <= 0:
        return None
    k = np.arange(1, most + 1)
    values = [sum(float(each[lag:] @ each[:-lag]) for each in e if len(each) > lag) / power for lag in k]
    return Correlation(k, np.array(values), _quantile() / n**0.5)


def ljung_box(correlation: Correlation, rows: int) -> ChiSquared:
    """Test of the first h autocorrelations of so many rows at once:  Q = N (N + 2) Σ r_k² / (N − k). [LjungBox1978]"""
    k, r = correlation.lags, correlation.values
    return ChiSquared.of(rows * (rows + 2.0) * float((r**2 / (rows - k)).sum()), len(k))


def cross_correlation(residuals: np.ndarray, inputs: np.ndarray, parts: Parts, lags: int = LAGS) -> Correlation | None:
    """Correlation of residuals with the input, Σ e_{t+k} u_t / (‖e‖ ‖u‖), k = −lags … lags: after the input k > 0.

    The bound is 2.58 √(Σ_k r_e(k) r_u(k) / N), with the autocorrelations of both. [Ljung1999], eq. (16.66)

    Args:
        residuals, inputs: (rows,).   parts: stretches of rows.   lags: at most.
    Returns:
        correlation: None where one of them is constant or not finite, or there are too few rows.
    """
    if not np.isfinite(inputs).all():
        return None
    both = [autocorrelation(each, parts, 4 * lags) for each in (residuals, inputs)]
    if both[0] is None or both[1] is None:
        return None
    e, u = _centred(residuals, parts), _centred(inputs, parts)
    n, size = sum(map(len, e)), np.sqrt(sum(float(a @ a) for a in e) * sum(float(b @ b) for b in u))
    most = min(lags, len(both[0].lags))
    k = np.arange(-most, most + 1)
    values = np.array([sum(lagged(a, b, lag) for a, b in zip(e, u, strict=True)) for lag in k.tolist()])
    spread = 1.0 + 2.0 * float(both[0].values @ both[1].values)
    return Correlation(k, values / size, _quantile() * np.sqrt(max(spread, 1.0) / n))


def residual_spectrum(
    residuals: np.ndarray, measured: np.ndarray, parts: Parts, rate: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Power densities by Welch's method, averaged over stretches: f (k,) in Hz, of the residuals and of the measured signal.

    Args:
        residuals, measured: (rows,).   parts: stretches of rows.   rate: rows in a second, in Hz.
    Returns:
        spectrum: None where no stretch has 16 rows.
    """
    longest = max((part.stop - part.start for part in parts), default=0)
    rows = min(SEGMENT, longest)
    if rows < 16:
        return None
    used = [part for part in parts if part.stop - part.start >= rows]
    weights = np.array([part.stop - part.start for part in used], dtype=float)
    both = [
        [sp.welch(values[part], rate, nperseg=rows, detrend="constant")[1] for part in used]
        for values in (residuals, measured)
    ]
    f = np.fft.rfftfreq(rows, 1.0 / rate)
    e, y = (np.average(each, axis=0, weights=weights) for each in both)
    return f[1:], e[1:], y[1:]


def lagged(later: np.ndarray, earlier: np.ndarray, lag: int) -> float:
    """Σ later(t + lag) earlier(t), of two signals (k,)."""
    if abs(lag) >= len(later):
        return 0.0
    return float(later[lag:] @ earlier[: len(earlier) - lag] if lag >= 0 else later[:lag] @ earlier[-lag:])


def _centred(values: np.ndarray, parts: Parts) -> list[np.ndarray]:
    """Stretches without the mean of all."""
    mean = np.concatenate([values[part] for part in parts]).mean() if parts else 0.0
    return [values[part] - mean for part in parts]


def _quantile() -> float:
    """2.58: 99 % of a normal distribution lie within ± this many standard deviations."""
    return float(stats.norm.ppf(0.5 + CONFIDENCE / 2))

"""Measures of agreement between prediction and measurement, the same in all commands, reports and in Python. [Ljung1999]

With y measured, ŷ predicted, e = y − ŷ and ȳ the mean of y, over N rows:

    RMS = √(Σ e² / N)      R² = 1 − Σ e² / Σ (y − ȳ)²      NRMSE = ‖e‖ / ‖y − ȳ‖      fit = 100 (1 − NRMSE) [%]
    VAF = 100 (1 − Σ (e − ē)² / Σ (y − ȳ)²) [%]

Rows at rest. Dry friction at rest is whatever holds the joint, so no law predicts it. Where torques are compared along a known
motion, a joint is at rest while its speed stays below 0.5 % of its largest one for at least 0.1 s and 20 rows (`at_rest`);
these rows are left out of all measures and given as means. Runs in which a joint does not move at all are left out likewise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

ROUNDING = 1e-9  # of the largest value: what is left of a constant
SLOW = 0.005  # of the joint's largest speed
REST, LEAST = 0.1, 20  # [s] and rows: shorter times below that speed are a reversal


@dataclass(frozen=True)
class Agreement:
    """Agreement of a prediction ŷ with a measured signal y over some rows; e = y − ŷ, ȳ the mean of y.

    Relative measures are NaN where y is constant: there is nothing that a model could explain.

    Attributes:
        rows: how many.   rms: √mean(e²), in the signal's unit.   measured_rms: √mean(y²).
        fit: 100 (1 − ‖e‖ / ‖y − ȳ‖) [%].   nrmse: ‖e‖ / ‖y − ȳ‖.   vaf: 100 (1 − var e / var y) [%], which forgives an offset.
        r2: 1 − ‖e‖² / ‖y − ȳ‖².   bias: mean of e.   gain: slope g of the least squares line y = g ŷ + offset.
        correlation: of y and ŷ, −1 to 1.
    """

    rows: int
    rms: float
    measured_rms: float
    fit: float
    nrmse: float
    vaf: float
    r2: float
    bias: float
    gain: float
    correlation: float

    @property
    def by_name(self) -> dict[str, float]:
        """The measures of a fit's table: fit_percent, r2 and rms."""
        return {"fit_percent": self.fit, "r2": self.r2, "rms": self.rms}


def agreement(measured: np.ndarray, predicted: np.ndarray) -> Agreement:
    """Agreement of two signals (k,) over the rows where both are finite."""
    both = np.isfinite(measured) & np.isfinite(predicted)
    y, p = measured[both], predicted[both]
    if not len(y):
        return Agreement(0, *[np.nan] * 9)
    e = y - p
    varies, predicts = (bool(np.ptp(each) > ROUNDING * np.abs(each).max()) for each in (y, p))
    squares, spread = float(e @ e), float(((y - y.mean()) ** 2).sum()) if varies else np.nan
    covariance = float((y - y.mean()) @ (p - p.mean()))
    power = float(((p - p.mean()) ** 2).sum()) if predicts else np.nan
    return Agreement(
        len(y),
        rms(e),
        rms(y),
        float(fit_percent(squares, spread)),
        float(np.sqrt(squares / spread)),
        float(100.0 * r_squared(float(((e - e.mean()) ** 2).sum()), spread)),
        float(r_squared(squares, spread)),
        float(e.mean()),
        covariance / power,
        covariance / (spread * power) ** 0.5,
    )


def r_squared(squares: Any, spread: Any) -> Any:
    """R² = 1 − Σ e² / Σ (y − ȳ)², from the two sums; NaN where the second is 0.

    Args:
        squares: Σ e², a number or an array.   spread: Σ (y − ȳ)², likewise.
    """
    return 1.0 - _share(squares, spread)


def fit_percent(squares: Any, spread: Any) -> Any:
    """Fit 100 (1 − ‖e‖ / ‖y − ȳ‖) [%], from the squares of the two norms; NaN where the second is 0."""
    return 100.0 * (1.0 - np.sqrt(_share(squares, spread)))


def _share(squares: Any, spread: Any) -> Any:
    """Σ e² / Σ (y − ȳ)², unexplained share of the power; NaN where the signal is constant."""
    return squares / np.where(np.greater(spread, 0.0), spread, np.nan)[()]


def rms(values: np.ndarray, axis: int | tuple[int, ...] | None = None) -> Any:
    """Root mean square √mean(v²) of an array, over all of it or over some axes."""
    found = np.sqrt(np.mean(np.square(values), axis=axis))
    return float(found) if axis is None else found


def at_rest(speed: np.ndarray, largest: float, rate: float) -> np.ndarray:
    """(rows,) True for rows of a period of rest.

    Args:
        speed: (rows,) of one joint in one run.   largest: its speed over all runs, magnitude.   rate: rows in a second.
    """
    return periods_of_rest(np.abs(speed) < SLOW * largest, rate)


def periods_of_rest(slow: np.ndarray, rate: float) -> np.ndarray:
    """(rows,) True for rows of a period of rest: slow (rows,) ones that last a while; a joint that turns back does not rest.

    Args:
        slow: bool, of one joint in one run.   rate: rows in a second.
    """
    mask = np.zeros(len(slow), dtype=bool)
    for begin, end in runs_of_true(slow):
        mask[begin:end] = end - begin >= max(LEAST, REST * rate)
    return mask


def runs_of_true(happens: np.ndarray) -> np.ndarray:
    """(runs, 2) first row of each run of true entries of a column, and the row after its last."""
    return np.flatnonzero(np.diff(happens, prepend=False, append=False)).reshape(-1, 2)

"""Measures of agreement between prediction and measurement: fit, NRMSE, VAF, R², RMS, gain. [Ljung1999]"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ROUNDING = 1e-9  # of the largest value: what is left of a constant


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


def agreement(measured: np.ndarray, predicted: np.ndarray) -> Agreement:
    """Agreement of two signals (k,) over the rows where both are finite."""
    both = np.isfinite(measured) & np.isfinite(predicted)
    y, p = measured[both], predicted[both]
    if not len(y):
        return Agreement(0, *[np.nan] * 9)
    e = y - p
    varies, predicts = (bool(np.ptp(each) > ROUNDING * np.abs(each).max()) for each in (y, p))
    spread = float(np.linalg.norm(y - y.mean())) if varies else np.nan
    nrmse = float(np.linalg.norm(e)) / spread
    covariance = float((y - y.mean()) @ (p - p.mean()))
    power = float(((p - p.mean()) ** 2).sum()) if predicts else np.nan
    return Agreement(
        len(y),
        rms(e),
        rms(y),
        100.0 * (1.0 - nrmse),
        nrmse,
        100.0 * (1.0 - float(((e - e.mean()) ** 2).sum()) / spread**2),
        1.0 - nrmse**2,
        float(e.mean()),
        covariance / power,
        covariance / (spread * power**0.5),
    )


def rms(values: np.ndarray) -> float:
    """Root mean square √mean(v²) of (k,) values."""
    return float(np.sqrt(np.mean(np.square(values))))

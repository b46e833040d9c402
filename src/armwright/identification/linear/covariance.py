"""Covariance of the parameters of a black-box model, with errors of any colour."""

from __future__ import annotations

import numpy as np

from armwright.identification.linear.prediction_error import ONE, Fit, filtered

MOST_PAST = 30  # rows of the past in an autoregressive model of errors


def covariance_of(fit: Fit) -> np.ndarray:
    """Covariance (k, k) of the parameters:  (JᵀJ)⁻¹ Jᵀ R J (JᵀJ)⁻¹,  R the covariance of the errors.

    The errors of an OE model are whatever the plant's noise is: R then follows from an autoregressive model of them, and the
    intervals hold for coloured noise too [Ljung1999], section 9.4.
    """
    rows, count = fit.equations, fit.jacobian.shape[1]
    scale = np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-300)
    weighted = fit.jacobian / scale
    inverse = np.linalg.pinv(weighted.T @ weighted, rcond=1e-14)
    if fit.orders.structure == "oe":
        ar, variance = autoregression(fit.errors)
        coloured = filtered(ONE, ar, weighted[::-1])
        middle = variance * (coloured.T @ coloured) * rows / max(rows - count, 1)
    else:
        middle = fit.cost / max(rows - count, 1) * (weighted.T @ weighted)
    return inverse @ middle @ inverse / np.outer(scale, scale)


def autoregression(errors: np.ndarray, most: int = MOST_PAST) -> tuple[np.ndarray, float]:
    """Autoregressive model of a signal by Levinson's recursion, order by AIC: polynomial (p + 1,), variance of its input."""
    rows = len(errors)
    most = min(most, max(rows // 20, 0))
    size = 1 << (2 * rows - 1).bit_length()
    power = np.abs(np.fft.rfft(errors - errors.mean(), size)) ** 2
    r = np.fft.irfft(power)[: most + 1] / rows
    a, variance = np.ones(1), float(r[0])
    best = (rows * np.log(max(variance, 1e-300)), a, variance)
    for p in range(1, most + 1):
        if variance <= 1e-14 * r[0]:
            break
        reflection = -float(a @ r[p:0:-1][: len(a)]) / variance if variance > 0 else 0.0
        a = np.append(a, 0.0) + reflection * np.append(0.0, a[::-1])
        variance *= 1.0 - reflection**2
        score = rows * np.log(max(variance, 1e-300)) + 2 * p
        if score < best[0]:
            best = (score, a, variance)
    return best[1], best[2]

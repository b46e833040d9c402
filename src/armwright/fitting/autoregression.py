"""Autoregressions by Levinson's recursion, their order by an information criterion. [Ljung1999]"""

from __future__ import annotations

import numpy as np

EXACT = 1e-12  # of the signal's variance: what is left below is rounding
AKAIKE = 2.0  # price of a coefficient; that of Schwarz is the logarithm of the number of rows


def lagged_products(values: np.ndarray, lags: int) -> np.ndarray:
    """Σ_t v_t v_{t+k}, k = 0 … lags, (lags + 1, n) of values (rows, n, …), summed over all axes but the second."""
    values = values.reshape(len(values), values.shape[1], -1)
    rows = len(values)
    return np.array([np.einsum("tjk,tjk->j", values[: max(rows - k, 0)], values[k:]) for k in range(lags + 1)])


def autoregression(autocovariances: np.ndarray, rows: float, price: float | None = None) -> tuple[np.ndarray, float]:
    """Polynomial [1, −a_1, …, −a_p] of the autoregression  v_t = Σ a_k v_{t−k} + ε_t, and the variance of ε.

    The order is the one with the least  rows ln var ε + price · p.

    Args:
        autocovariances: r_0 … r_k, k the highest order.   rows: how many are behind them.
        price: of a coefficient, such as `AKAIKE`; None: the criterion of Schwarz.
    """
    r, price = autocovariances, float(np.log(rows)) if price is None else price
    a, variance = np.ones(1), float(r[0])
    best, least = (a, variance), rows * np.log(max(variance, 1e-300))
    for p in range(1, len(r)):
        if variance <= EXACT * r[0]:
            break
        reflection = -float(a @ r[p:0:-1]) / variance
        if abs(reflection) >= 1.0:  # of autocovariances with gaps, which need be none of any signal
            break
        a = np.append(a, 0.0) + reflection * np.append(0.0, a[::-1])
        variance *= 1.0 - reflection**2
        criterion = rows * np.log(max(variance, 1e-300)) + price * p
        if criterion < least:
            best, least = (a, variance), criterion
    return best

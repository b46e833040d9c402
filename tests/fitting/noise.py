"""Noise with a known correlation, and stated deviations by those of the fits themselves."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

RHOS = (0.0, 0.9, 0.98)
SETTLING = 600  # rows


def ar1(rho: float, rows: int, columns: int = 1, seed: int = 0) -> np.ndarray:
    """(rows, columns) of deviation 1, each row's noise rho times that of the row before, and fresh noise."""
    fresh = np.random.default_rng(seed).normal(size=(rows + SETTLING, columns))
    return np.sqrt(1.0 - rho**2) * np.asarray(lfilter([1.0], [1.0, -rho], fresh, axis=0))[SETTLING:]


def ratios(values, stds) -> np.ndarray:
    """(p,) root mean square of stated deviations (draws, p) by the deviation of the values (draws, p)."""
    return np.sqrt(np.mean(np.square(stds), axis=0)) / np.std(values, axis=0, ddof=1)

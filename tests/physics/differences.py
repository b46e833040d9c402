"""Slopes by differences, of fourth order: the outside truth for derivatives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

STEP = 1e-4  # error: h⁴ of the fifth derivative, and rounding over h


def differences(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """∂f/∂x (*shape of f, n) by  [f(x-2h) - 8 f(x-h) + 8 f(x+h) - f(x+2h)] / 12h."""
    columns = []
    for k in range(len(x)):
        h = STEP * np.eye(len(x))[k]
        columns.append((function(x - 2 * h) - 8 * function(x - h) + 8 * function(x + h) - function(x + 2 * h)) / 12)
    return np.stack(columns, axis=-1) / STEP


def assert_slope(ours: np.ndarray, expected: np.ndarray, tolerance: float = 1e-7) -> None:
    """Within the tolerance of the largest entry, or of 1."""
    assert ours.shape == expected.shape
    assert np.abs(ours - expected).max() <= tolerance * max(1.0, np.abs(expected).max())

"""Recursive least squares in square-root form: parameters while a log is running, with forgetting. [Bierman1977]

Kept is the triangle [R z; 0 r] of all rows so far, RᵀR their information. A block of rows is one QR decomposition,

    [ √λᵏ (R z); √Λ W^½ (Y y) ]  =  Q [ R' z'; 0 r' ],   Λ = diag(λᵏ⁻¹, …, λ, 1),

so that with forgetting λ = 1 the result is that of one batch to rounding, and blocks of any size give what single rows give.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, sqrt

import numpy as np
import scipy.linalg

from armwright.errors import IdentificationError

KNOWN = 1e-12  # of the largest diagonal entry of R, columns scaled: below, the rows do not tell the parameter yet


@dataclass(frozen=True, eq=False)
class RecursiveEstimate:
    """Least squares of the rows so far; frozen, `with_rows` returns the next one.

    Attributes:
        factor: (p + 1, p + 1) upper triangle of [R z; 0 r].   forgetting: λ of each row, 0 < λ ≤ 1.
        rows: number of rows so far.   memory: Σ λᵏ, the number of rows that still count; 1/(1 − λ) in the end.
    """

    factor: np.ndarray
    forgetting: float = 1.0
    rows: int = 0
    memory: float = 0.0

    @classmethod
    def begin(
        cls, parameters: int, forgetting: float = 1.0, start: np.ndarray | None = None, std: np.ndarray | None = None
    ) -> RecursiveEstimate:
        """The estimate before any row.

        Args:
            parameters: p.   forgetting: λ; 1 forgets nothing, 0.999 counts the last 1000 rows.
            start: (p,) values to begin with, and std: (p,) their standard deviations in those of the rows' noise; None: nothing
                is known.
        Raises:
            IdentificationError: a number that cannot stand there.
        """
        if not 0.0 < forgetting <= 1.0:
            raise IdentificationError(place="forgetting", value=forgetting, expected="above 0, at most 1")
        if (start is None) != (std is None):
            raise IdentificationError(place="start and std", expected="both, or neither")
        factor = np.zeros((parameters + 1, parameters + 1))
        if start is not None and std is not None:
            start, std = np.broadcast_to(start, parameters), np.broadcast_to(std, parameters)
            if not (np.isfinite(start).all() and (std > 0).all()):
                raise IdentificationError(place="start and std", expected="numbers, the deviations above 0")
            factor[:-1, :-1] = np.diag(1.0 / std)
            factor[:-1, -1] = start / std
        return cls(factor, forgetting)

    def with_rows(self, Y: np.ndarray, y: np.ndarray, weights: np.ndarray | float = 1.0) -> RecursiveEstimate:
        """The estimate after more rows, in the order in which they were measured.

        Args:
            Y: (k, p) or (p,) rows of the regressor.   y: (k,) or () measurements.   weights: (k,) of the squares, or one.
        Raises:
            IdentificationError: shapes that do not fit, or numbers that are not finite; the estimate so far is as it was.
        """
        Y, y = np.atleast_2d(np.asarray(Y, dtype=float)), np.atleast_1d(np.asarray(y, dtype=float))
        p, k = len(self.factor) - 1, len(y)
        if Y.shape != (k, p):
            raise IdentificationError(f"shapes {Y.shape} and {y.shape}", place="Y and y", expected=f"(k, {p}) and (k,)")
        weight = np.broadcast_to(np.asarray(weights, dtype=float), k)
        if not (np.isfinite(Y).all() and np.isfinite(y).all() and (weight >= 0).all()):
            raise IdentificationError(place="Y, y and weights", expected="finite numbers, weights of 0 or more")
        fading = self.forgetting ** np.arange(k - 1, -1, -1.0)
        block = np.column_stack([Y, y]) * np.sqrt(fading * weight)[:, None]
        stacked = np.concatenate([sqrt(self.forgetting**k) * self.factor, block])
        factor = np.asarray(np.linalg.qr(stacked, mode="r"))
        memory = self.forgetting**k * self.memory + float(fading.sum())
        return replace(self, factor=factor, rows=self.rows + k, memory=memory)

    @property
    def identifiable(self) -> bool:
        """True if the rows so far and the start identify all parameters."""
        R = self.factor[:-1, :-1]
        size = np.linalg.norm(R, axis=0)
        if not (size > 0).all():
            return False
        diagonal = np.abs(np.diag(np.linalg.qr(R / size, mode="r")))
        return bool((diagonal > KNOWN).all())

    @property
    def values(self) -> np.ndarray:
        """(p,) R⁻¹ z; NaN until the rows identify all parameters."""
        if not self.identifiable:
            return np.full(len(self.factor) - 1, np.nan)
        return scipy.linalg.solve_triangular(self.factor[:-1, :-1], self.factor[:-1, -1])

    @property
    def variance(self) -> float:
        """Residual variance r² / (effective rows − p); infinite before there are enough rows."""
        free = self.memory - (len(self.factor) - 1)
        return float(self.factor[-1, -1] ** 2 / free) if free > 0 else inf

    @property
    def covariance(self) -> np.ndarray:
        """(p, p) variance · (RᵀR)⁻¹ for white residuals; NaN as for `values`."""
        p = len(self.factor) - 1
        if not self.identifiable:
            return np.full((p, p), np.nan)
        inverse = scipy.linalg.solve_triangular(self.factor[:-1, :-1], np.eye(p))
        return self.variance * (inverse @ inverse.T)

    @property
    def std(self) -> np.ndarray:
        """(p,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))

"""Information of an experiment: the matrix G = WᵀW of its regressor W, and criteria of it. [SweversEtAl1997], [Armstrong1989]

With noise of variance σ² on the torques the covariance of the parameters is σ² G⁻¹.
"""

from __future__ import annotations

from typing import Literal

import casadi
import numpy as np

Criterion = Literal["condition", "condition_si", "logdet"]
Scaling = Literal["columns", "none"]
POWER = 4  # of eigenvalues: (Σ λ^k Σ λ^-k)^(1/2k) is a smooth bound of the condition number, at most p^(1/k) times it
FLOOR = 1e-13  # of the mean eigenvalue, added to each: information that is singular at a start still has a criterion
SMALLEST = 1e-14  # of the largest eigenvalue: smaller ones are rounding


def column_norms(information: np.ndarray) -> np.ndarray:
    """(p,) lengths of the regressor's columns; 1 for columns that are 0."""
    lengths = np.sqrt(np.maximum(np.diag(information), 0.0))
    return np.where(lengths > 0.0, lengths, 1.0)


def scaled(information: np.ndarray, scaling: Scaling) -> np.ndarray:
    """The information (p, p) of columns of length 1 ("columns"), or as it is ("none")."""
    if scaling == "none":
        return information
    lengths = column_norms(information)
    return information / np.outer(lengths, lengths)


def condition_number(information: np.ndarray, scaling: Scaling = "columns") -> float:
    """Largest by smallest singular value of the regressor; infinite where that is rounding.

    Args:
        information: (p, p) WᵀW.   scaling: "columns": of the regressor with columns of length 1; "none": in its own units.
    """
    values = np.linalg.eigvalsh(scaled(information, scaling))
    return float(np.sqrt(values[-1] / values[0])) if values[0] > SMALLEST * values[-1] else np.inf


def criterion_function(size: int, criterion: Criterion) -> casadi.Function:
    """G (p, p) → what a design minimises, as a smooth function of CasADi.

    "condition":  log (tr C^k tr C^-k)^(1/2k),  C = G of columns of length 1, k = POWER: at least the logarithm of the condition
    number of W, and above it by at most log(p)/k. "condition_si": the same of G as it is, in SI units.
    "logdet":  -log det G / 2p,  the mean logarithm of the half axes of the ellipsoid of confidence; it asks for large motions
    too, and does not depend on the units of the parameters but for a constant.

    Args:
        size: p.   criterion: one of these.
    """
    matrix = casadi.MX.sym("G", size, size)
    lengths = casadi.sqrt(casadi.diag(matrix))
    eye = casadi.DM.eye(size)
    scaled_matrix = matrix / (lengths @ lengths.T) + FLOOR * eye
    if criterion == "logdet":
        symbols = casadi.SX.sym("C", size, size)
        pivots = casadi.Function("pivots", [symbols], [casadi.ldl(symbols, False)[0]])(scaled_matrix)
        value = -(casadi.sum1(casadi.log(pivots)) / 2.0 + casadi.sum1(casadi.log(lengths))) / size
    else:
        if criterion == "condition_si":
            mean = casadi.trace(matrix) / size
            scaled_matrix = matrix / mean + FLOOR * eye
        square = scaled_matrix @ scaled_matrix
        inverse = casadi.solve(scaled_matrix, casadi.MX(eye), "ldl")
        value = casadi.log(casadi.sumsqr(square) * casadi.sumsqr(inverse @ inverse)) / (2 * POWER)
    return casadi.Function("criterion", [matrix], [value])

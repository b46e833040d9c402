"""Least squares by Levenberg and Marquardt's method, with steps that the caller may reject. [Marquardt1963]"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

ROUNDS, STARTED = 60, 1e-3  # steps at most, and the first damping
STEADY = 1e-3  # of a standard deviation: changes the sum of squares by a millionth of the errors' variance
ROUNDING = 1e-13  # relative decrease of the sum of squares that is rounding
LEAST = 1e-12  # damping: what keeps a singular matrix solvable
HARDEST = 1e10  # damping at which no step helps any more
Errors = tuple[np.ndarray, np.ndarray]


def descended(
    errors: Callable[[np.ndarray], Errors | None],
    theta: np.ndarray,
    first: Errors,
    rounds: int = ROUNDS,
    steady: float = STEADY,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Parameters (k,) with the smallest sum of squares, errors (rows,) and derivatives (rows, k) there, True if converged.

    Args:
        errors: of parameters, with their derivatives; None where parameters are forbidden.
        theta: (k,) the start.   first: errors and derivatives there.   rounds: steps at most.
        steady: part of a standard deviation of the parameters: a step that moves them by no more ends the search.
    """
    e, jacobian = first
    damping, cost = STARTED, e @ e
    for _ in range(rounds):
        scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        normal, gradient = (jacobian / scale).T @ (jacobian / scale), (jacobian / scale).T @ e
        while damping < HARDEST:
            step = -np.linalg.solve(normal + damping * np.eye(len(scale)), gradient)
            trial = theta + step / scale
            new = errors(trial)
            if new is not None and new[0] @ new[0] <= cost:
                break
            damping = damping * 4.0
        else:
            return theta, e, jacobian, True  # at a minimum to rounding, or at the edge of what is allowed
        gained, moved = cost - new[0] @ new[0], float(step @ normal @ step)
        theta, (e, jacobian) = trial, new
        cost, damping = e @ e, max(damping * 0.1, LEAST)
        if gained <= ROUNDING * cost or moved <= steady**2 * cost / len(e):
            return theta, e, jacobian, True
    return theta, e, jacobian, False

"""Dormand and Prince's pair of rules of orders 5 and 4: a step, its error, and the path between its ends.

    k_i = f(x + h Σ_j a_ij k_j, u),   x⁺ = x + h Σ b_i k_i,   e = h Σ (b_i - b*_i) k_i          [DormandPrince1980]

The path of order 4 through a step is that of [HairerNorsettWanner1993], II.6.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armwright import scalar
from armwright.scalar import Array, Scalar

STAGES = (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),  # b: the seventh stage is at x⁺
)
ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)
PATH = (
    -12715105075 / 11282082432,
    0.0,
    87487479700 / 32700410799,
    -10690763975 / 1880347072,
    701980252875 / 199316789632,
    -1453857185 / 822651844,
    69997945 / 29380423,
)
ORDER = 5  # of the error in h


def dormand_prince_step(
    f: Callable[[Array, Array], Array], x: Array, u: Array, h: Scalar
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A step of order 5, and how wrong one of order 4 would be.

    Args:
        f: (x, u) → dx/dt.   x: (nx,) state.   u: (nu,) commands, held.   h: () [s].
    Returns:
        x⁺: (nx,).   error: (nx,) in units of x.   path: (4, nx) coefficients of `along`.
    """
    k: list[Array] = []
    at = x
    for weights in STAGES:
        at = x + h * _sum(weights, k) if weights else x
        k.append(f(at, u))
    moved = at - x
    bent = h * k[0] - moved
    path = scalar.stack([moved, bent, moved - h * k[6] - bent, h * _sum(PATH, k)])
    return scalar.array(at), h * _sum(ERROR, k), path


def along(x: Array, path: Array, part: Scalar) -> np.ndarray:
    """The state within a step:  x + θ (p₁ + (1-θ) (p₂ + θ (p₃ + (1-θ) p₄))).  [HairerNorsettWanner1993], II.6

    Args:
        x: (nx,) the state at the step's beginning.   path: (4, nx) from `dormand_prince_step`.   part: () θ in [0, 1].
    Returns:
        x: (nx,) the state after that part of the step, to order 4.
    """
    left = 1.0 - part
    return x + part * (path[0] + left * (path[1] + part * (path[2] + left * path[3])))


def _sum(weights: tuple[float, ...], k: list[Array]) -> Array:
    terms = [weight * slope for weight, slope in zip(weights, k, strict=True) if weight != 0.0]
    return sum(terms[1:], start=terms[0])

"""Dormand and Prince's pair of rules of orders 5 and 4: a trial step, its error, and the path between its ends.

    k_i = f(x + h Σ_j a_ij k_j, u),   x⁺ = x + h Σ b_i k_i,   e = h Σ (b_i - b*_i) k_i          [DormandPrince1980]

The error norm, the next step's length and the path of order 4 through a step are those of [HairerNorsettWanner1993], II.4 and
II.6. A trial is a traced program: lanes that take different steps run the same instructions.
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
SAFETY, SHRINK, GROW = 0.9, 0.2, 5.0  # of the step that would just do; and the most that a step changes
LEAST_ERROR = 1e-10  # in units of the tolerance: below it a step grows as much as it may anyway


def trial_step(
    f: Callable[[Array, Array], Array], x: Array, u: Array, h: Scalar, rtol: float, atol: float
) -> tuple[np.ndarray, Scalar, Scalar, np.ndarray]:
    """A step, how wrong it is, and what the next one should be.

    Args:
        f: (x, u) → dx/dt.   x: (nx,) state.   u: (nu,) commands, held.   h: () [s].
        rtol, atol: of each entry of the state, in its own unit: it may be wrong by atol + rtol max(|x|, |x⁺|).
    Returns:
        x⁺: (nx,).   error: () root mean square of the errors in units of what is allowed; 1 or less is good.
        grow: () by what factor the next step, or another trial of this one, should be longer.
        path: (4, nx) coefficients of `along`.
    """
    k: list[Array] = []
    at = x
    for weights in STAGES:
        at = x + h * _sum(weights, k) if weights else x
        k.append(f(at, u))
    allowed = atol + rtol * scalar.maximum(scalar.abs(x), scalar.abs(at))
    share = h * _sum(ERROR, k) / allowed
    error = scalar.sqrt(sum(entry * entry for entry in share) / len(share))
    grow = SAFETY * scalar.exp(-0.2 * scalar.log(error + LEAST_ERROR))
    moved = at - x
    bent = h * k[0] - moved
    path = scalar.stack([moved, bent, moved - h * k[6] - bent, h * _sum(PATH, k)])
    return scalar.array(at), error, scalar.clip(grow, SHRINK, GROW), path


def along(x: Array, path: Array, part: Scalar) -> np.ndarray:
    """The state within a step:  x + θ (p₁ + (1-θ) (p₂ + θ (p₃ + (1-θ) p₄))).  [HairerNorsettWanner1993], II.6

    Args:
        x: (nx,) the state at the step's beginning.   path: (4, nx) from `trial_step`.   part: () θ in [0, 1].
    Returns:
        x: (nx,) the state after that part of the step, to order 4.
    """
    left = 1.0 - part
    return x + part * (path[0] + left * (path[1] + part * (path[2] + left * path[3])))


def _sum(weights: tuple[float, ...], k: list[Array]) -> Array:
    terms = [weight * slope for weight, slope in zip(weights, k, strict=True) if weight != 0.0]
    return sum(terms[1:], start=terms[0])

"""Rules that take a state one step further. A rule is its numbers; each is written on the first-order form x' = f(x, u)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armwright.scalar import Array, Scalar

Derivative = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Integrator:
    """An explicit rule of fixed step.

    Attributes:
        step: (f, x, u, h) → x one step of h later, u held.
        order: the error of a run shrinks with this power of h.
        amplification: coefficients of R(z), lowest first: what a step multiplies a mode of x' = λ x by, z = h λ.
    """

    step: Callable[[Derivative, Array, Array, Scalar], Array]
    order: int
    amplification: tuple[float, ...]

    def growth(self, z: np.ndarray) -> np.ndarray:
        """|R(z)|: a mode dies away where it is below 1."""
        return np.abs(np.polynomial.polynomial.polyval(z, self.amplification))


def rk3_step(f: Derivative, x: Array, u: Array, h: Scalar) -> Array:
    """Kutta's third-order rule, the CMU report's.  x⁺ = x + h/6 (k1 + 4 k2 + k3).  [Kutta1901]

    Args:
        f: (x, u) → dx/dt.   x: (nx,) state.   u: (nu,) commands, held.   h: () [s] the step.
    Returns:
        x⁺: (nx,) the state h later.
    """
    k1 = f(x, u)
    k2 = f(x + (0.5 * h) * k1, u)
    k3 = f(x + (2.0 * h) * k2 - h * k1, u)
    return x + (h / 6.0) * (k1 + 4.0 * k2 + k3)


INTEGRATORS = {
    "rk3": Integrator(rk3_step, order=3, amplification=(1.0, 1.0, 1 / 2, 1 / 6)),
}

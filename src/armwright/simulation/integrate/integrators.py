"""Rules that take a state one step further. A rule is its numbers; each is written on the first-order form x' = f(x, u)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from armwright.scalar import Array, Scalar
from armwright.simulation.integrate.exponential import (
    Pairs,
    rk3_exponential,
    rk3_exponential_pair,
    rk4_exponential,
    semi_implicit_euler_exponential,
    staggered,
)

Derivative = Callable[[Array, Array], Array]
Growth = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Integrator:
    """An explicit rule of fixed step.

    Attributes:
        step: (f, x, u, h) → x one step of h later, u held.
        order: the error of a run shrinks with this power of h.
        growth: z = h λ → what a step multiplies the size of a mode of x' = λ x by; it dies away where that is below 1.
        stages: how often a step asks for f.
        exponential: (f, x, u, h) → x, the rule with fast linear parts of f, a `Split`, integrated exactly.
        staggered: whether they treat positions by themselves, and take `pairs`.
    """

    step: Callable[..., Array]
    order: int
    growth: Growth
    stages: int
    exponential: Callable[..., Array]
    staggered: bool = False

    def paired(self, pairs: Pairs) -> Integrator:
        """The rule for a state whose positions and speeds stand at those places."""
        if not self.staggered:
            return self
        return replace(
            self,
            step=partial(self.step, pairs=tuple(pairs)),
            exponential=partial(self.exponential, pairs=tuple(pairs)),
        )


def polynomial(*coefficients: float) -> Growth:
    """|R(z)| of a Runge-Kutta rule from the coefficients of R, lowest first."""
    return lambda z: np.abs(np.polynomial.polynomial.polyval(z, coefficients))


def rk3_step(f: Derivative, x: Array, u: Array, h: Scalar) -> Array:
    """Kutta's third-order rule, the CMU report's.  x⁺ = x + h/6 (k1 + 4 k2 + k3).  [Kutta1901]

    Args:
        f: (x, u) → dx/dt.   x: (nx,) state.   u: (nu,) commands, held.   h: () [s] the step.
    Returns:
        x⁺: (nx,) the state h later.
    """
    return rk3_pair(f, x, u, h)[0]


def rk3_pair(f: Derivative, x: Array, u: Array, h: Scalar) -> tuple[Array, Array]:
    """`rk3_step`, and by how much the midpoint rule  x + h k2  of order 2 differs from it:  h/6 (k1 - 2 k2 + k3).

    Args:
        f, x, u, h: as `rk3_step`.
    Returns:
        x⁺: (nx,) the state h later.   error: (nx,) of the rule of order 2.
    """
    k1 = f(x, u)
    k2 = f(x + (0.5 * h) * k1, u)
    k3 = f(x + (2.0 * h) * k2 - h * k1, u)
    return x + (h / 6.0) * (k1 + 4.0 * k2 + k3), (h / 6.0) * (k1 - 2.0 * k2 + k3)


def rk4_step(f: Derivative, x: Array, u: Array, h: Scalar) -> Array:
    """Kutta's fourth-order rule.  x⁺ = x + h/6 (k1 + 2 k2 + 2 k3 + k4).  [Kutta1901]

    Args:
        f: (x, u) → dx/dt.   x: (nx,) state.   u: (nu,) commands, held.   h: () [s] the step.
    Returns:
        x⁺: (nx,) the state h later.
    """
    k1 = f(x, u)
    k2 = f(x + (0.5 * h) * k1, u)
    k3 = f(x + (0.5 * h) * k2, u)
    k4 = f(x + h * k3, u)
    return x + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)


def semi_implicit_euler_step(f: Derivative, x: Array, u: Array, h: Scalar, pairs: Pairs | None = None) -> np.ndarray:
    """Euler's rule with positions moved by the new speeds.  q̇⁺ = q̇ + h q̈(q, q̇),  q⁺ = q + h q̇⁺.  [HairerLubichWanner2006]

    Args:
        f: (x, u) → dx/dt.   x: (nx,) state.   u: (nu,) commands, held.   h: () [s] the step.
        pairs: places in x of positions and their speeds; by default x = (q, q̇).
    Returns:
        x⁺: (nx,) the state h later; what is neither position nor speed as by Euler's own rule.
    """
    return staggered(x, x + h * f(x, u), h, pairs)


def staggered_growth(z: np.ndarray) -> np.ndarray:
    """Growth of an oscillator with poles z and z̄ under the semi-implicit rule, a double pole where z is real.

    From  μ² - (2 + 2 Re z - |z|²) μ + (1 + 2 Re z) = 0. A real pole beside a slower one is damped at least as well.
    """
    half = 1.0 + np.real(z) - 0.5 * np.abs(z) ** 2
    root = np.sqrt((half**2 - (1.0 + 2.0 * np.real(z))).astype(complex))
    return np.abs([half + root, half - root]).max(axis=0)


INTEGRATORS = {
    "rk3": Integrator(rk3_step, 3, polynomial(1.0, 1.0, 1 / 2, 1 / 6), stages=3, exponential=rk3_exponential),
    "rk4": Integrator(rk4_step, 4, polynomial(1.0, 1.0, 1 / 2, 1 / 6, 1 / 24), stages=4, exponential=rk4_exponential),
    "semi_implicit_euler": Integrator(
        semi_implicit_euler_step,
        1,
        staggered_growth,
        stages=1,
        exponential=semi_implicit_euler_exponential,
        staggered=True,
    ),
}

# Steps with errors.
PAIR = Integrator(rk3_pair, 3, INTEGRATORS["rk3"].growth, stages=3, exponential=rk3_exponential_pair)
ORDER_OF_ERROR = 3  # in h, of a pair's

TOLERANCES = {  # (rtol, atol) of rules that choose their own steps, if nothing else is said
    "rk45": (1e-8, 1e-10),
    "rodas3": (1e-5, 1e-7),
    "cvodes": (1e-12, 1e-13),
}
STEPPING = ("rk45", "rodas3")  # of them those whose steps are taken in the compiled loop
RULES = ("auto", *INTEGRATORS, *TOLERANCES)

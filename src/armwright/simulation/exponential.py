"""Exponential Runge-Kutta rules: what is linear and fast in a state is integrated exactly, the rest as ever. [CoxMatthews2002]

A few entries z of the state, such as winding currents, have  ż = λ z + N(x)  with λ(x) ≤ 0 known and perhaps far beyond 1/h.
Variation of constants over a step with N taken as a polynomial through its values at the stages,

    z(h) = e^{λh} z + ∫ e^{λ(h-s)} N(s) ds,

gives weights that are combinations of   φ_k(y) = ∫₀¹ e^{(1-s) y} s^{k-1}/(k-1)! ds,   y = λ h.   With λ = 0 they are those of
the plain rule, which all other entries keep. Where λ varies, each stage splits with the λ of the stage before it: any
splitting is as good to the rule's order, and this one does not overshoot when λ grows from 0 within a step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from armwright import scalar
from armwright.scalar import Array, Scalar

Split = Callable[[Array, Array], tuple[Array, Array]]  # (x, u) → dx/dt, and λ of the stiff entries

NEAR = 0.5  # |y| below which the φ are summed as series: their quotients lose digits there
TERMS = 15  # of the series: the next is below 1e-17


def phi(y: Array) -> tuple[Array, Array, Array, Array]:
    """e^y, φ₁, φ₂, φ₃ of y ≤ 0, a number or an array, to some units in the last place.  φ_{k+1} = (φ_k - 1/k!) / y."""
    near = scalar.less(-NEAR, y)
    small, large = scalar.where(near, y, 0.0), scalar.where(near, -1.0, y)
    series = 0.0
    for factor in _inverse_factorials():
        series = factor + small * series
    exponential = scalar.exp(y)
    one = (exponential - 1.0) / large
    two = (one - 1.0) / large
    third = scalar.where(near, series, (two - 0.5) / large)
    second = scalar.where(near, 0.5 + small * series, two)
    first = scalar.where(near, 1.0 + small * (0.5 + small * series), one)
    return exponential, first, second, third


def _inverse_factorials() -> list[float]:
    """1/(k+3)!, the last first."""
    return (1.0 / np.cumprod(np.arange(1.0, TERMS + 4.0)))[2:][::-1].tolist()


def rk3_exponential(f: Split, stiff: Sequence[int], x: Array, u: Array, h: Scalar) -> Array:
    """`rk3_step` with the entries `stiff` of the state integrated by ETD3RK, whose limit for λ = 0 it is.  [CoxMatthews2002]

    Args:
        f: (x, u) → dx/dt (nx,), λ (k,) [1/s] ≤ 0 of the stiff entries.   stiff: their k places in x.
        x: (nx,) state.   u: (nu,) commands, held.   h: () [s] the step.
    Returns:
        x⁺: (nx,) the state h later.
    """
    where = list(stiff)
    z = x[where]
    k1, rate1 = f(x, u)
    _, half, _, _ = phi(0.5 * h * rate1)
    x2 = _placed(x + (0.5 * h) * k1, where, z + 0.5 * h * half * k1[where])
    k2, rate2 = f(x2, u)
    decay, first, _, _ = phi(h * rate2)
    n1, n2 = k1[where] - rate2 * z, k2[where] - rate2 * x2[where]
    x3 = _placed(x + (2.0 * h) * k2 - h * k1, where, decay * z + h * first * (2.0 * n2 - n1))
    k3, rate3 = f(x3, u)
    rate = _mean(rate1, rate2, rate3).reshape(rate1.shape)
    decay, first, second, third = phi(h * rate)
    n1, n2, n3 = (k[where] - rate * at[where] for k, at in ((k1, x), (k2, x2), (k3, x3)))
    weighted = (
        (first - 3.0 * second + 4.0 * third) * n1 + (4.0 * second - 8.0 * third) * n2 + (4.0 * third - second) * n3
    )
    return _placed(x + (h / 6.0) * (k1 + 4.0 * k2 + k3), where, decay * z + h * weighted)


def rk4_exponential(f: Split, stiff: Sequence[int], x: Array, u: Array, h: Scalar) -> Array:
    """`rk4_step` with the entries `stiff` integrated by ETDRK4, whose limit for λ = 0 it is.  [CoxMatthews2002]

    Of order 4 where λ is constant (windings), of order 3 where it varies (bristles).

    Args:
        f, stiff, x, u, h: as `rk3_exponential`.
    Returns:
        x⁺: (nx,) the state h later.
    """
    where = list(stiff)
    z = x[where]
    k1, rate1 = f(x, u)
    _, first, _, _ = phi(0.5 * h * rate1)
    x2 = _placed(x + (0.5 * h) * k1, where, z + 0.5 * h * first * k1[where])
    k2, rate2 = f(x2, u)
    decay, first, _, _ = phi(0.5 * h * rate2)
    n1, n2 = k1[where] - rate2 * z, k2[where] - rate2 * x2[where]
    x3 = _placed(x + (0.5 * h) * k2, where, decay * z + 0.5 * h * first * n2)
    k3, rate3 = f(x3, u)
    decay, first, _, _ = phi(0.5 * h * rate3)
    n1, n3 = k1[where] - rate3 * z, k3[where] - rate3 * x3[where]
    half = decay * z + 0.5 * h * first * n1
    x4 = _placed(x + h * k3, where, decay * half + 0.5 * h * first * (2.0 * n3 - n1))
    k4, rate4 = f(x4, u)
    rate = _mean(rate1, rate3, rate4).reshape(rate1.shape)
    decay, first, second, third = phi(h * rate)
    n1, n2, n3, n4 = (k[where] - rate * at[where] for k, at in ((k1, x), (k2, x2), (k3, x3), (k4, x4)))
    weighted = (
        (first - 3.0 * second + 4.0 * third) * n1
        + (2.0 * second - 4.0 * third) * (n2 + n3)
        + (4.0 * third - second) * n4
    )
    return _placed(x + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4), where, decay * z + h * weighted)


def _mean(a: Array, b: Array, c: Array) -> np.ndarray:
    """Simpson's mean of λ over the step; a number that does not vary stays that number, and its φ are computed once."""
    rows = zip(a.flat, b.flat, c.flat, strict=True)
    return scalar.array(
        [r if not scalar.is_symbolic(r, s, t) and r == s == t else (r + 4.0 * s + t) / 6.0 for r, s, t in rows]
    )


def _placed(x: Array, where: list[int], z: Array) -> np.ndarray:
    """x with other values at some places."""
    placed = np.array(x, dtype=object)
    placed[where] = z
    return scalar.array(placed)

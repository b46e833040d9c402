"""Exponential Runge-Kutta rules: what is linear and fast in a state is integrated exactly, the rest as ever. [CoxMatthews2002]

A few entries z of the state, such as winding currents, have  ż = λ z + N(x)  with λ(x) ≤ 0 known and perhaps far beyond 1/h.
Variation of constants over a step with N taken as a polynomial through its values at the stages,

    z(h) = e^{λh} z + ∫ e^{λ(h-s)} N(s) ds,

gives weights that are combinations of   φ_k(y) = ∫₀¹ e^{(1-s) y} s^{k-1}/(k-1)! ds,   y = λ h.   With λ = 0 they are those of
the plain rule, which all other entries keep. Where λ varies, what is split off may be any λ near it, but one that does not
overshoot when λ grows from 0 within a step: at order 3 each stage's is that of the stage before it; order 4 asks for one λ
in all stages, and takes that of the middle of the step by Euler's rule.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.scalar import Array, Scalar

Pairs = Sequence[tuple[int, int]]  # places in x of a position and of its speed
Rates = Callable[[Array, Array], tuple[Array, Array]]

NEAR = 0.5  # |y| below which the φ are summed as series: their quotients lose digits there
TERMS = 15  # of the series: the next is below 1e-17


@dataclass(frozen=True)
class Split:
    """x' = f(x, u) with some entries z that are linear in themselves, and fast.

    Attributes:
        slopes: (x, u) → dx/dt (nx,), λ (k,) [1/s] ≤ 0 of the entries z.   fast: (x, u) → ż (k,), λ (k,), at less cost.
        places: of the k entries in x.
    """

    slopes: Rates
    fast: Rates
    places: tuple[int, ...]

    @classmethod
    def of(cls, slopes: Rates, places: Sequence[int]) -> Split:
        """From `slopes` alone."""
        where = list(places)

        def fast(x: Array, u: Array) -> tuple[Array, Array]:
            xd, rates = slopes(x, u)
            return xd[where], rates

        return cls(slopes, fast, tuple(places))


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


def rk3_exponential(f: Split, x: Array, u: Array, h: Scalar) -> Array:
    """`rk3_step` with the entries z of the state integrated by ETD3RK, whose limit for λ = 0 it is.  [CoxMatthews2002]

    Args:
        f: dx/dt, split.   x: (nx,) state.   u: (nu,) commands, held.   h: () [s] the step.
    Returns:
        x⁺: (nx,) the state h later.
    """
    return rk3_exponential_pair(f, x, u, h)[0]


def rk3_exponential_pair(f: Split, x: Array, u: Array, h: Scalar) -> tuple[Array, Array]:
    """`rk3_exponential`, and by how much the rule of order 2 with the weights φ₁ - 2φ₂, 2φ₂, 0 differs from it.

    Args:
        f, x, u, h: as `rk3_exponential`.
    Returns:
        x⁺: (nx,) the state h later.   error: (nx,) of the rule of order 2; h/6 (k1 - 2 k2 + k3) where λ = 0.
    """
    where = list(f.places)
    z = x[where]
    k1, rate1 = f.slopes(x, u)
    _, half, _, _ = phi(0.5 * h * rate1)
    x2 = _placed(x + (0.5 * h) * k1, where, z + 0.5 * h * half * k1[where])
    k2, rate2 = f.slopes(x2, u)
    decay, first, _, _ = phi(h * rate2)
    n1, n2 = k1[where] - rate2 * z, k2[where] - rate2 * x2[where]
    x3 = _placed(x + (2.0 * h) * k2 - h * k1, where, decay * z + h * first * (2.0 * n2 - n1))
    k3, rate3 = f.slopes(x3, u)
    rate = _mean(rate1, rate2, rate3).reshape(rate1.shape)
    decay, first, second, third = phi(h * rate)
    n1, n2, n3 = (k[where] - rate * at[where] for k, at in ((k1, x), (k2, x2), (k3, x3)))
    weighted = (
        (first - 3.0 * second + 4.0 * third) * n1 + (4.0 * second - 8.0 * third) * n2 + (4.0 * third - second) * n3
    )
    error = _placed((h / 6.0) * (k1 - 2.0 * k2 + k3), where, h * (4.0 * third - second) * (n1 - 2.0 * n2 + n3))
    return _placed(x + (h / 6.0) * (k1 + 4.0 * k2 + k3), where, decay * z + h * weighted), error


def rk4_exponential(f: Split, x: Array, u: Array, h: Scalar) -> Array:
    """`rk4_step` with the entries z integrated by ETDRK4, whose limit for λ = 0 it is.  [CoxMatthews2002]

    Args:
        f, x, u, h: as `rk3_exponential`.
    Returns:
        x⁺: (nx,) the state h later.
    """
    where = list(f.places)
    z = x[where]
    k1, _ = f.slopes(x, u)
    _, rate = f.fast(_placed(x + (0.5 * h) * k1, where, z), u)
    decay, first, _, _ = phi(0.5 * h * rate)
    x2 = _placed(x + (0.5 * h) * k1, where, z + 0.5 * h * first * k1[where])
    k2, _ = f.slopes(x2, u)
    n1, n2 = k1[where] - rate * z, k2[where] - rate * x2[where]
    x3 = _placed(x + (0.5 * h) * k2, where, decay * z + 0.5 * h * first * n2)
    k3, _ = f.slopes(x3, u)
    n3 = k3[where] - rate * x3[where]
    x4 = _placed(x + h * k3, where, decay * x2[where] + 0.5 * h * first * (2.0 * n3 - n1))
    k4, _ = f.slopes(x4, u)
    n4 = k4[where] - rate * x4[where]
    decay, first, second, third = phi(h * rate)
    weighted = (
        (first - 3.0 * second + 4.0 * third) * n1
        + (2.0 * second - 4.0 * third) * (n2 + n3)
        + (4.0 * third - second) * n4
    )
    return _placed(x + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4), where, decay * z + h * weighted)


def semi_implicit_euler_exponential(f: Split, x: Array, u: Array, h: Scalar, pairs: Pairs | None = None) -> Array:
    """`semi_implicit_euler_step`, then the entries z by ETD1 under the new speeds:  z⁺ = z + h φ₁(λ h) ż.  [CoxMatthews2002]

    Bristles are bent by speeds as positions are moved, so that friction that sticks swings as it does there, and does not grow.

    Args:
        f, x, u, h: as `rk3_exponential`.   pairs: as `semi_implicit_euler_step`.
    Returns:
        x⁺: (nx,) the state h later.
    """
    where = list(f.places)
    k, _ = f.slopes(x, u)
    moved = staggered(x, x + h * k, h, pairs)
    bent, rate = f.fast(_placed(moved, where, x[where]), u)
    _, first, _, _ = phi(h * rate)
    return _placed(moved, where, x[where] + h * first * bent)


def staggered(x: Array, moved: Array, h: Scalar, pairs: Pairs | None) -> np.ndarray:
    """A state `moved` by Euler's rule from x, with positions moved by their new speeds; by default x = (q, q̇)."""
    half, after = len(x) // 2, list(moved)
    for position, speed in [(k, k + half) for k in range(half)] if pairs is None else pairs:
        after[position] = x[position] + h * after[speed]
    return scalar.array(after)


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

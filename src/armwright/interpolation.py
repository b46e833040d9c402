"""Piecewise linear tables over any scalar: for floats, arrays and traced symbols, table entries included."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

from armwright import scalar
from armwright.scalar import Array, Scalar

Outside = Literal["constant", "linear"]


def piecewise_linear(x: Scalar, at: Array, values: Array, outside: Outside) -> Scalar:
    """Value at x of the broken line through a table's points.  [DeBoor1978]

    As a sum of hinges,  y = c + s₀ x + Σ Δs_k max(x, x_k)  over the inner points, s the slopes and Δs their changes: two
    operations a point and no branch, continuous by construction. The slope jumps at the points; a derivative there is that of
    one of the two sides.

    Args:
        x: where to read.   at: (k,) positions of the points, strictly increasing.   values: (k,) at them.
        outside: "constant": the first and the last value hold beyond the ends; "linear": the first and the last slope.
    Returns:
        y: unit of the values; the table's values at its points to rounding.
    """
    middle = 0.5 * (at[0] + at[-1])  # counted from there, terms stay small and little is lost when they are added
    points = [point - middle for point in at]
    x = x - middle
    if outside == "constant":
        x = scalar.clip(x, points[0], points[-1])
    slopes = _slopes(points, values)
    y = values[0] - slopes[0] * points[0] + slopes[0] * x
    for point, (before, behind) in zip(points[1:-1], pairwise(slopes), strict=True):
        y = y - (behind - before) * point + (behind - before) * scalar.maximum(x, point)
    return y


def piecewise_linear_integral(x: Scalar, at: Array, values: Array, outside: Outside) -> Scalar:
    """Integral of `piecewise_linear` from the first point to x; its slope is continuous.

    Args:
        x, at, values, outside: as in `piecewise_linear`.
    Returns:
        integral: unit of the values times that of the positions, negative before the first point if the values are positive.
    """
    slopes = _slopes(at, values)
    ends = (0.0, 0.0) if outside == "constant" else (slopes[0], slopes[-1])
    way = x - at[0]
    total = values[0] * way + 0.5 * ends[0] * way * way
    for point, (before, behind) in zip(at, pairwise([ends[0], *slopes, ends[1]]), strict=True):
        beyond = scalar.maximum(x - point, 0.0)
        total = total + 0.5 * (behind - before) * beyond * beyond
    return total


def _slopes(at: Array, values: Array) -> list[Scalar]:
    pairs = zip(pairwise(at), pairwise(values), strict=True)
    return [(b - a) / (after - before) for (before, after), (a, b) in pairs]

"""Piecewise polynomials: what joint-space motions are computed to once, and evaluated as."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.scalar import Array, Scalar
from armwright.trajectory.motion import Motion

HALVINGS = 40  # of an interval that holds a root: an extremum's value is then right to rounding


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial(Motion):
    """q(t) = Σ_d coefficients[i, :, d] (t - knots[i])^d  in piece i,  knots[i] ≤ t < knots[i + 1].

    The arm stands at the first position before, and at the last one after.

    Args:
        knots: (k + 1,) [s], increasing.
        coefficients: (k, n, degree + 1) [rad | m, …/s, …/s², …], the constant term first.
    Raises:
        ScenarioError: shapes that do not fit, numbers that are not finite, times that do not increase.
    """

    knots: np.ndarray
    coefficients: np.ndarray

    def __post_init__(self) -> None:
        knots, coefficients = _numbers("knots", self.knots, 1), _numbers("coefficients", self.coefficients, 3)
        if len(knots) != len(coefficients) + 1 or not coefficients.size:
            expected = f"(k + 1,) times and (k, n, degree + 1) coefficients, not {knots.shape} and {coefficients.shape}"
            raise ScenarioError("shapes do not fit", place="PiecewisePolynomial", expected=expected)
        late = np.flatnonzero(np.diff(knots) <= 0.0)
        if len(late):
            k = int(late[0]) + 1
            what = f"not after {knots[k - 1]:.10g} before it"
            raise ScenarioError(what, place=f"knots[{k}]", value=float(knots[k]), expected="times that increase")
        object.__setattr__(self, "knots", knots)
        object.__setattr__(self, "coefficients", coefficients)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.coefficients.shape[1]

    @property
    def time(self) -> float:
        """Time of the beginning [s]."""
        return float(self.knots[0])

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.knots[-1] - self.knots[0])

    @property
    def breaks(self) -> np.ndarray:
        """(k + 1,) [s] times between pieces, and both ends."""
        return self.knots

    def derivative(self) -> PiecewisePolynomial:
        """Motion whose positions are the speeds of this one."""
        order = self.coefficients.shape[2]
        factors = np.arange(1.0, order)
        rows = self.coefficients[:, :, 1:] * factors if order > 1 else np.zeros((*self.coefficients.shape[:2], 1))
        return PiecewisePolynomial(self.knots, rows)

    def at(self, t: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, q̇ and q̈, each (…, n) [rad | m, …/s, …/s²], at times t (…) [s]."""
        times = np.asarray(t, dtype=float)
        piece = np.clip(np.searchsorted(self.knots, times, side="right") - 1, 0, len(self.coefficients) - 1)
        local = np.clip(times, self.knots[0], self.knots[-1]) - self.knots[piece]
        inside = ((times >= self.knots[0]) & (times <= self.knots[-1]))[..., None]
        q, qd, qdd = _values(self.coefficients[piece], local[..., None])
        return q, np.where(inside, qd, 0.0), np.where(inside, qdd, 0.0)

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s]; a trace holds all pieces, so it suits short motions."""
        if not scalar.is_symbolic(t):
            return self.at(t)
        held = scalar.clip(t, self.knots[0], self.knots[-1])
        chosen: Array = self.coefficients[0]
        begin: Array = self.knots[0]
        for knot, coefficients in zip(self.knots[1:-1], self.coefficients[1:], strict=True):
            reached = scalar.less_equal(knot, t)
            begin = scalar.where(reached, knot, begin)
            chosen = scalar.where(np.full(coefficients.shape, reached, dtype=object), coefficients, chosen)
        q, qd, qdd = _values(chosen, held - begin)
        inside = scalar.less_equal(self.knots[0], t) * scalar.less_equal(t, self.knots[-1])
        return scalar.array(q), scalar.array(inside * qd), scalar.array(inside * qdd)

    def extrema(self, derivative: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest value of a derivative of every joint in every piece, both (k, n).

        They are taken at the ends of a piece and where the next derivative is 0, so that nothing hides between grid points.

        Args:
            derivative: 0: positions, 1: speeds, 2: accelerations, 3: jerk.
        """
        c: Any = self.coefficients
        for _ in range(derivative):
            c = c[:, :, 1:] * np.arange(1.0, c.shape[2]) if c.shape[2] > 1 else np.zeros((*c.shape[:2], 1))
        c = c * np.diff(self.knots)[:, None, None] ** np.arange(c.shape[2])  # over s from 0 to 1 within a piece
        values = _polynomial(c[..., None, :], _turning_points(c))
        return values.min(axis=-1), values.max(axis=-1)

    def largest(self, derivative: int) -> np.ndarray:
        """(n,) largest magnitude of a derivative of every joint."""
        low, high = self.extrema(derivative)
        return np.maximum(np.abs(low), np.abs(high)).max(axis=0)


def _numbers(name: str, value: Any, dimensions: int) -> np.ndarray:
    try:
        numbers = scalar.real_numbers(value).copy()
    except ValueError:
        numbers = np.full((), np.nan)
    if numbers.ndim != dimensions or not np.isfinite(numbers).all():
        raise ScenarioError(place=f"PiecewisePolynomial.{name}", value=value, expected="finite numbers")
    numbers.flags.writeable = False
    return numbers


def _values(coefficients: Array, local: Array) -> tuple[Array, Array, Array]:
    """Value, first and second derivative of polynomials (…, degree + 1), the constant term first, by Horner's scheme."""
    q, qd, half = coefficients[..., -1], 0.0 * coefficients[..., -1], 0.0 * coefficients[..., -1]
    for d in range(coefficients.shape[-1] - 2, -1, -1):
        half = half * local + qd
        qd = qd * local + q
        q = q * local + coefficients[..., d]
    return q, qd, 2.0 * half


def _polynomial(coefficients: np.ndarray, s: np.ndarray) -> np.ndarray:
    value = coefficients[..., -1]
    for d in range(coefficients.shape[-1] - 2, -1, -1):
        value = value * s + coefficients[..., d]
    return value * np.ones_like(s)


def _turning_points(c: np.ndarray) -> np.ndarray:
    """Points (…, m) of 0 ≤ s ≤ 1, both ends and all zeros of the derivative of polynomials c (…, degree + 1) among them.

    Between two zeros of its derivative a polynomial is monotone, so that halving finds its zero there: the zeros of the
    derivatives are found one after the other, from the one of degree 1 up.
    """
    points = np.broadcast_to(np.array([0.0, 1.0]), (*c.shape[:-1], 2))
    chain = [c[..., 1:] * np.arange(1.0, c.shape[-1])]
    while chain[-1].shape[-1] > 2:
        chain.append(chain[-1][..., 1:] * np.arange(1.0, chain[-1].shape[-1]))
    for each in reversed(chain):
        if each.shape[-1] < 2:
            continue
        rows = each[..., None, :]
        low, high = points[..., :-1].copy(), points[..., 1:].copy()
        sign = np.sign(_polynomial(rows, low))
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            same = np.sign(_polynomial(rows, middle)) == sign
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        points = np.concatenate([points[..., :1], np.sort(low, axis=-1), points[..., -1:]], axis=-1)
    return points

"""Piecewise polynomials: the computed form of joint-space motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.scalar import Array, Scalar
from armwright.trajectory.motion import Motion

HALVINGS = 40  # of an interval that holds a root: an extremum's value is then right to rounding
LAST = 1e9  # [s] of the end of a plan: some thirty years, where a float still tells a microsecond from the next
SAME = 1e-13  # of a duration: knots of two joints this near to each other are one


@dataclass(frozen=True, eq=False, repr=False)
class PiecewisePolynomial(Motion):
    """q(t) = Σ_d coefficients[i, :, d] (t - knots[i])^d  in piece i,  knots[i] ≤ t < knots[i + 1].

    The arm stands at the first position before, and at the last one after.

    Args:
        knots: (k + 1,) [s], increasing.
        coefficients: (k, n, degree + 1) [rad | m, …/s, …/s², …], the constant term first.
    Raises:
        ScenarioError: shapes that do not fit, numbers that are not finite, times that do not increase.
    Example:
        >>> line = [[[0.0, 0.5], [0.0, -0.5]]]  # q = 0.5 t and -0.5 t
        >>> motion = aw.trajectories.PiecewisePolynomial([0.0, 1.0], line)
        >>> motion.at(0.5)[0]
        array([ 0.25, -0.25])
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
    def polynomial(self) -> PiecewisePolynomial:
        """The motion, as of the motions that are computed as one."""
        return self

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

    @classmethod
    def hermite(cls, times: Any, q: Any, qd: Any, qdd: Any) -> PiecewisePolynomial:
        """Quintic Hermite interpolation: in each piece the polynomial of fifth degree with the states of its ends.

        Args:
            times: (k + 1,) [s], increasing.   q, qd, qdd: (k + 1, n) [rad | m, …/s, …/s²].
        Raises:
            ScenarioError: as the class.
        """
        times = _numbers("knots", times, 1)
        q, qd, qdd = (_numbers(name, value, 2) for name, value in (("q", q), ("qd", qd), ("qdd", qdd)))
        h = np.diff(times)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):  # of equal times, which the class refuses
            # what is left at the end of the piece by the polynomial of second degree that leaves its beginning
            dq = (q[1:] - q[:-1] - h * qd[:-1] - 0.5 * h**2 * qdd[:-1]) / h**3
            dqd = (qd[1:] - qd[:-1] - h * qdd[:-1]) / h**2
            dqdd = (qdd[1:] - qdd[:-1]) / h
            high = [
                10.0 * dq - 4.0 * dqd + 0.5 * dqdd,
                (-15.0 * dq + 7.0 * dqd - dqdd) / h,
                (6.0 * dq - 3.0 * dqd + 0.5 * dqdd) / h**2,
            ]
        rows = np.stack([q[:-1], qd[:-1], 0.5 * qdd[:-1], *high], axis=-1)
        return cls(times, np.where(h[..., None] > 0.0, rows, 0.0))

    @classmethod
    def of_segments(cls, time: float, durations: Any, derivative: Any, start: Any) -> PiecewisePolynomial:
        """Motion from rest of one joint with constant acceleration or jerk in each segment; empty segments are dropped.

        Args:
            time: [s].   durations: (k,) [s].
            derivative: (k, order): the last column is what is constant, of order 2 or 3; the others are 0.
            start: [rad | m].
        """
        state, rows, lengths = np.zeros(derivative.shape[1]), [], []
        state[0] = start
        factorials = np.cumprod([1.0, *range(1, derivative.shape[1] + 1)])
        least = np.spacing(abs(time) + np.sum(durations))  # shorter ones, left by rounding, would end when they begin
        for length, values in zip(durations, derivative, strict=True):
            if length <= least:
                continue
            taylor = np.append(state, values[-1]) / factorials
            rows.append(taylor)
            lengths.append(length)
            for d in range(len(state)):
                state[d] = factorials[d] * sum(
                    taylor[e] * factorials[e] / (factorials[d] * factorials[e - d]) * length ** (e - d)
                    for e in range(d, len(taylor))
                )
        return cls(time + np.concatenate([[0.0], np.cumsum(lengths)]), np.array(rows)[:, None, :])

    @classmethod
    def side_by_side(cls, parts: Sequence[PiecewisePolynomial]) -> PiecewisePolynomial:
        """Motion of all joints of several motions that begin and end together, on the knots of all of them.

        Args:
            parts: motions; knots nearer to each other than rounding are one.
        """
        begin, end = parts[0].knots[0], max(part.knots[-1] for part in parts)
        inner = np.unique(np.concatenate([part.knots[1:-1] for part in parts]))
        inner = inner[(inner > begin + SAME * (end - begin)) & (inner < end - SAME * (end - begin))]
        inner = inner[np.diff(inner, prepend=begin) > SAME * (end - begin)]
        knots = np.concatenate([[begin], inner, [end]])
        degree = max(part.coefficients.shape[2] for part in parts)
        rows = []
        for part in parts:
            piece = np.searchsorted(part.knots[1:-1], 0.5 * (knots[:-1] + knots[1:]), side="right")
            moved = shifted(part.coefficients[piece], (knots[:-1] - part.knots[piece])[:, None])
            rows.append(np.pad(moved, ((0, 0), (0, 0), (0, degree - moved.shape[2]))))
        return cls(knots, np.concatenate(rows, axis=1))

    def scaled(self, factor: float) -> PiecewisePolynomial:
        """The path in `factor` times the duration: speeds are divided by it, accelerations by its square."""
        powers = float(factor) ** -np.arange(self.coefficients.shape[2])
        return PiecewisePolynomial(self.time + factor * (self.knots - self.time), self.coefficients * powers)

    def delayed(self, time: float) -> PiecewisePolynomial:
        """The motion, shifted to begin at `time` [s]."""
        return PiecewisePolynomial(self.knots - self.knots[0] + time, self.coefficients)

    def derivative(self) -> PiecewisePolynomial:
        """Motion whose positions are the speeds of this one."""
        return PiecewisePolynomial(self.knots, derived(self.coefficients))

    def _at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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
            c = derived(c)
        c = c * np.diff(self.knots)[:, None, None] ** np.arange(c.shape[2])  # over s from 0 to 1 within a piece
        values = polynomial(c[..., None, :], _turning_points(c))
        return values.min(axis=-1), values.max(axis=-1)

    def largest(self, derivative: int) -> np.ndarray:
        """(n,) largest magnitude of a derivative of every joint."""
        low, high = self.extrema(derivative)
        return np.maximum(np.abs(low), np.abs(high)).max(axis=0)


class PiecewiseMotion(Motion):
    """Motion whose dataclass computes a piecewise polynomial on construction.

    Attributes:
        polynomial: the motion.
    """

    polynomial: PiecewisePolynomial

    def set_polynomial(self, polynomial: PiecewisePolynomial) -> None:
        """Stores the result; the dataclass's own fields stay as given."""
        object.__setattr__(self, "polynomial", polynomial)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.polynomial.n

    @property
    def breaks(self) -> np.ndarray:
        """(k + 1,) [s] times between pieces, and both ends."""
        return self.polynomial.knots

    def _at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.polynomial.at(times)

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s]."""
        return self.polynomial(t)


def shifted(coefficients: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Coefficients (…, degree + 1) of p(x + offset), the constant term first; offset (…)."""
    c = coefficients.copy()
    for begin in range(c.shape[-1] - 1):
        for d in range(c.shape[-1] - 2, begin - 1, -1):
            c[..., d] += offset * c[..., d + 1]
    return c


def _numbers(name: str, value: Any, dimensions: int) -> np.ndarray:
    numbers = scalar.numbers_or_nan(value).copy()
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


def derived(coefficients: np.ndarray) -> np.ndarray:
    """Coefficients (…, degree) of p', the constant term first; of a constant 0."""
    order = coefficients.shape[-1]
    return coefficients[..., 1:] * np.arange(1.0, order) if order > 1 else np.zeros_like(coefficients)


def polynomial(coefficients: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Values at s of polynomials (…, degree + 1), the constant term first, by Horner's scheme."""
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
    chain = [c]
    while chain[-1].shape[-1] > 2:
        chain.append(derived(chain[-1]))
    for each in reversed(chain[1:]):
        rows = each[..., None, :]
        low, high = points[..., :-1].copy(), points[..., 1:].copy()
        sign = np.sign(polynomial(rows, low))
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            same = np.sign(polynomial(rows, middle)) == sign
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        points = np.concatenate([points[..., :1], np.sort(low, axis=-1), points[..., -1:]], axis=-1)
    return points

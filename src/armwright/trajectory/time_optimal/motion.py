"""A motion along a path with a planned path speed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armwright import scalar
from armwright.scalar import Array, Scalar
from armwright.trajectory.motion import Motion
from armwright.trajectory.path import JointPath
from armwright.trajectory.piecewise import PiecewisePolynomial
from armwright.trajectory.time_optimal.timing import PathTiming

SATURATED = 0.98  # of a limit: a motion that uses more is at it


@dataclass(frozen=True, eq=False, repr=False)
class PathMotion(Motion):
    """q(s(t)): a path with s̈ linear in time or constant between grid points, so polynomials of time of three times the path's
    degree, or of twice.

    Accelerations jump where the active limit changes, but with a limit of jerk: then s̈ is continuous.

    Attributes:
        path: q(s).   s: (m,) grid.   x: (m,) ṡ² there.   time: [s] of the beginning.
        used: by quantity (m - 1, n) the largest part of its limit that each joint uses between grid points; 0 without a limit.
        excess: relative excess over a limit on the grid that judged the plan; negative or 0: none.
        notes: about effects of the record that torques and voltages approximate.
        ramps: one for all, or (m - 1,): between grid points s̈ is linear in time, else constant, as with limits of velocity and
            acceleration alone.
        spans: (m - 1,) [s] durations of the pieces where jerk is limited; else None.
        rms_torque: (n,) [N m | N] root mean square torques of the motors over the motion, where they are limited; else None.
    """

    path: JointPath
    s: np.ndarray
    x: np.ndarray
    time: float
    used: dict[str, np.ndarray]
    excess: float
    notes: tuple[str, ...] = ()
    ramps: bool | np.ndarray = True
    rms_torque: np.ndarray | None = None
    spans: np.ndarray | None = None

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.path.n

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.breaks[-1] - self.breaks[0])

    def _at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Through s(t) and the path, so that no speed has the other sign by rounding where the arm comes to rest."""
        knots = self.breaks
        k = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(self.s) - 2)
        moving = (times >= knots[0]) & (times <= knots[-1])
        s, speed, sdd = self.timing.at(k, np.clip(times, knots[0], knots[-1]) - knots[k])
        q, first, second = self.path.at(s)
        speed = speed * moving
        qdd = first * (sdd * moving)[..., None] + second * (speed * speed)[..., None]
        return q, first * speed[..., None], qdd

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s]; a trace holds all pieces."""
        return self.polynomial(t) if scalar.is_symbolic(t) else self.at(t)

    @cached_property
    def timing(self) -> PathTiming:
        """s(t)."""
        return PathTiming(self.s, self.x, self.ramps, self.spans)

    @property
    def breaks(self) -> np.ndarray:
        """(m,) [s] times at the grid points."""
        return self._knots

    @cached_property
    def _knots(self) -> np.ndarray:
        return self.time + np.concatenate([[0.0], np.cumsum(self.timing.durations)])

    @cached_property
    def polynomial(self) -> PiecewisePolynomial:
        """The motion as polynomials of time."""
        timing = self.timing
        terms = [timing.speeds[:-1], 0.5 * timing.accelerations, timing.jerks / 6.0]
        terms = terms if np.any(self.ramps) or self.spans is not None else terms[:2]
        gone = np.stack([np.zeros_like(terms[0]), *terms], axis=-1)[:, None]  # s - s_k over the time since then
        degree = len(self.path.curve.c) - 1
        taylor = [self.path.derivative(self.s[:-1], order)[..., None] for order in range(degree + 1)]
        rows = taylor[degree]
        for order in range(degree - 1, -1, -1):  # Horner's scheme in s - s_k, with polynomials for numbers
            rows = _product(rows, gone) / (order + 1.0)
            rows[..., :1] += taylor[order]
        return PiecewisePolynomial(self.breaks, rows)

    @property
    def saturated(self) -> float:
        """Share of the duration with at least one joint at a limit."""
        at_limit = np.max([each.max(axis=1) for each in self.used.values()], axis=0) >= SATURATED
        return float(np.diff(self.breaks) @ at_limit / self.duration)


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of polynomials (…, k) and (…, l), the constant terms first: (…, k + l - 1)."""
    rows = np.zeros((*np.broadcast_shapes(a.shape[:-1], b.shape[:-1]), a.shape[-1] + b.shape[-1] - 1))
    for k in range(b.shape[-1]):
        rows[..., k : k + a.shape[-1]] += a * b[..., k : k + 1]
    return rows

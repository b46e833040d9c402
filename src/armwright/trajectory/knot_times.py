"""Times of waypoints for the fastest cubic spline, or straight lines with parabolic blends, within limits.

Both are found by an interior-point method over the rates x = 1 / h of the intervals, in which all limits are polynomials.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from armwright.trajectory.interior_point import Terms, shortest_times
from armwright.trajectory.limits import MotionLimits

TINY = 1e-12  # of the largest, in place of 0
SLOWER = 1.05  # of the start, so that no limit is reached there


@dataclass(frozen=True, eq=False)
class SplineProblem:
    """Limits of a cubic spline, in units in which intervals and accelerations are about 1.

    Unknown are the rates x = 1 / h of the intervals and the speeds v at the waypoints. With the way d between two waypoints
    a(x, v, w, d) = 6 d x² - x (4 v + 2 w) is the acceleration where a piece begins at speed v and ends at speed w, and
    6 x² (v + w - 2 d x) its jerk. Accelerations are continuous where a(x_i, v_i, v_i+1, d_i) + a(x_i-1, v_i, v_i-1, d_i-1) = 0.

    Attributes:
        way: (k - 1, n) between waypoints.   velocity, acceleration, jerk: (n,), infinite where unlimited.
        natural: accelerations are 0 at both ends, else speeds.
    """

    way: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    natural: bool

    @property
    def block(self) -> int:
        """Number of unknowns of a waypoint: its speeds, then the rate of the interval after it."""
        return self.way.shape[1] + 1

    @property
    def band(self) -> int:
        """Largest distance of two unknowns of one term: speeds of a joint at a waypoint and at the next but one."""
        return 2 * self.block

    @cached_property
    def speeds(self) -> np.ndarray:
        """(k, n) numbers of the unknown speeds."""
        return np.arange(len(self.way) + 1)[:, None] * self.block + np.arange(self.block - 1)

    @property
    def rates(self) -> np.ndarray:
        """(k - 1,) numbers of the unknown rates."""
        return np.arange(len(self.way)) * self.block + self.block - 1

    @property
    def pinned(self) -> np.ndarray:
        """Indices of the fixed unknowns."""
        filler = [len(self.way) * self.block + self.block - 1]  # of the last waypoint's block, in place of a rate
        return np.array(filler if self.natural else [*filler, *self.speeds[0], *self.speeds[-1]])

    def typical(self, y: np.ndarray) -> np.ndarray:
        """Mean size of rates and of speeds, for each of them."""
        found = np.full(len(y), np.abs(y[self.speeds]).mean() + TINY)
        found[self.rates] = y[self.rates].mean()
        return found

    def _end_acceleration(self, y: np.ndarray, pieces: slice, *, backward: bool) -> Terms:
        """-a / 2 = x (2 v + w) - 3 d x²  of pieces, where they begin, or where they end with its sign turned."""
        here, there = (self.speeds[1:], self.speeds[:-1]) if backward else (self.speeds[:-1], self.speeds[1:])
        here, there, d = here[pieces], there[pieces], self.way[pieces]
        rate = np.broadcast_to(self.rates[:, None][pieces], d.shape)
        x, v, w = y[rate], y[here], y[there]
        first = (2.0 * v + w - 6.0 * d * x, 2.0 * x, x)
        second = {(0, 0): -6.0 * d, (0, 1): 2.0, (0, 2): 1.0}
        return Terms(x * (2.0 * v + w) - 3.0 * d * x * x, (rate, here, there), first, second)

    def zero(self, y: np.ndarray) -> list[Terms]:
        """Half the jumps of acceleration at inner waypoints, and of natural splines half the accelerations at both ends."""
        inner = self._end_acceleration(y, slice(1, None), backward=False)
        inner += self._end_acceleration(y, slice(None, -1), backward=True)
        if not self.natural:
            return [inner]
        first = self._end_acceleration(y, slice(0, 1), backward=False)
        return [inner, first, self._end_acceleration(y, slice(-1, None), backward=True)]

    def limited(self, y: np.ndarray) -> list[Terms]:
        """Accelerations where pieces begin and at the end, speeds at waypoints and largest ones between, and jerks."""
        found = []
        if np.isfinite(self.acceleration).any():
            for pieces, backward in ((slice(None), False), (slice(-1, None), True)):
                each = self._end_acceleration(y, pieces, backward=backward)
                found.append(Terms(each.value, each.at, each.first, each.second, 0.5 * self.acceleration))
        if np.isfinite(self.velocity).any():
            ones = np.ones(self.speeds.shape)
            found += [Terms(y[self.speeds], (self.speeds,), (ones,), {}, self.velocity), self._largest_speed(y)]
        if np.isfinite(self.jerk).any():
            at, (x, v, w), d = self._pieces(y)
            inner = 6.0 * (v + w)
            second = {(0, 0): 2.0 * inner - 72.0 * d * x, (0, 1): 12.0 * x, (0, 2): 12.0 * x}
            first = (2.0 * x * inner - 36.0 * d * x * x, 6.0 * x * x, 6.0 * x * x)
            found.append(Terms(x * x * (inner - 12.0 * d * x), at, first, second, self.jerk))
        return found

    def _pieces(self, y: np.ndarray) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...], np.ndarray]:
        """Numbers and values of rate, first and last speed of every piece, each (k - 1, n), and its way."""
        at = (np.broadcast_to(self.rates[:, None], self.way.shape), self.speeds[:-1], self.speeds[1:])
        return at, tuple(y[each] for each in at), self.way

    def _largest_speed(self, y: np.ndarray) -> Terms:
        """Speed at the turning point of each piece, or at an end where it has none: the envelope of the speeds within."""
        at, (x, v, w), d = self._pieces(y)
        rise, bend = 6.0 * d * x - 4.0 * v - 2.0 * w, 3.0 * (v + w) - 6.0 * d * x
        with np.errstate(divide="ignore", invalid="ignore"):
            s = np.nan_to_num(np.clip(-0.5 * rise / bend, 0.0, 1.0))
            turns = np.where((s > 0.0) & (s < 1.0), -0.5 / bend, 0.0)
        first = (6.0 * s * (1.0 - s) * d, 1.0 + s * (3.0 * s - 4.0), s * (3.0 * s - 2.0))
        moves = ((6.0 - 12.0 * s) * d, 6.0 * s - 4.0, 6.0 * s - 2.0)  # of the turning point with the unknowns
        second = {(a, b): turns * moves[a] * moves[b] for a in range(3) for b in range(a, 3)}
        return Terms(first[0] * x + first[1] * v + first[2] * w, at, first, second, self.velocity)


@dataclass(frozen=True, eq=False)
class BlendProblem:
    """Limits of straight lines with parabolic blends, in units in which intervals and accelerations are about 1.

    Unknown are the rates x = 1 / T of the segments, gone at the speeds d x. A blend takes |d_i x_i - d_i-1 x_i-1| / a, and no
    more than either segment: |(d_i x_i - d_i-1 x_i-1) x_i| ≤ a and |(d_i x_i - d_i-1 x_i-1) x_i-1| ≤ a.

    Attributes:
        way: (k - 1, n) between waypoints.   velocity, acceleration: (n,), infinite where unlimited.
    """

    way: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    band: int = 1

    @property
    def rates(self) -> np.ndarray:
        """(k - 1,) numbers of the unknown rates: all."""
        return np.arange(len(self.way))

    @property
    def pinned(self) -> np.ndarray:
        """Indices of the fixed unknowns: none."""
        return np.zeros(0, dtype=int)

    def typical(self, y: np.ndarray) -> np.ndarray:
        """Sizes of the rates."""
        return y

    def zero(self, y: np.ndarray) -> list[Terms]:
        """No equations."""
        return []

    def limited(self, y: np.ndarray) -> list[Terms]:
        """Changes of speed by the time of the segments beside them, and speeds."""
        at = np.broadcast_to(self.rates[:, None], self.way.shape)
        before, after = at[:-1], at[1:]
        e, d, x, z = self.way[:-1], self.way[1:], y[before], y[after]
        change, most = d * z - e * x, self.acceleration
        ends, rows = self.way[[0, -1]], at[[0, -1]]
        found = [
            Terms(change * z, (before, after), (-e * z, 2.0 * d * z - e * x), {(0, 1): -e, (1, 1): 2.0 * d}, most),
            Terms(change * x, (before, after), (d * z - 2.0 * e * x, d * x), {(0, 1): d, (0, 0): -2.0 * e}, most),
            Terms(ends * y[rows] ** 2, (rows,), (2.0 * ends * y[rows],), {(0, 0): 2.0 * ends}, most),
        ]
        if np.isfinite(self.velocity).any():
            found.append(Terms(self.way * y[at], (at,), (self.way,), {}, self.velocity))
        return found


def spline_intervals(
    curve: str,
    points: np.ndarray,
    intervals: np.ndarray,
    limits: MotionLimits,
    scaled: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """Intervals (k - 1,) [s] of the fastest "cubic" or "natural_cubic" spline that was found, a local optimum.

    Args:
        curve: as above.   points: (k, n) [rad | m].   intervals: (k - 1,) [s], with which the spline keeps its limits.
        limits: of speed, acceleration and jerk.   scaled: intervals with which the spline keeps its limits, from others.
    """
    moving, natural = np.ptp(points, axis=0) > 0.0, curve == "natural_cubic"
    points, unit = points[:, moving], SLOWER * float(intervals.mean())
    knots = np.append(0.0, np.cumsum(SLOWER * intervals))
    start = CubicSpline(knots, points, bc_type="natural" if natural else "clamped")
    velocity, acceleration, jerk = (each[moving] for each in (limits.velocity, limits.acceleration, limits.jerk))
    size = np.where(np.isfinite(acceleration), acceleration, np.abs(start(knots, 2)).max(axis=0))  # of accelerations
    size = np.maximum(size, TINY * size.max())
    way, velocity = np.diff(points, axis=0) / (size * unit**2), velocity / (size * unit)
    problem = SplineProblem(way, velocity, acceleration / size, jerk * unit / size, natural)
    y = np.ones(len(points) * problem.block)
    y[problem.rates] = unit / (SLOWER * intervals)
    y[problem.speeds] = start(knots, 1) / (size * unit)
    y[problem.pinned] = 0.0
    return unit * shortest_times(problem, y, lambda times: scaled(unit * times) / unit)


def blend_intervals(
    points: np.ndarray, intervals: np.ndarray, limits: MotionLimits, scaled: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Intervals (k - 1,) [s] of the fastest motion with parabolic blends that was found, a local optimum.

    Args:
        points: (k, n) [rad | m].   intervals: (k - 1,) [s], with which the limits are kept.   limits: of speed and acceleration.
        scaled: intervals with which the limits are kept, from others.
    """
    moving = np.ptp(points, axis=0) > 0.0
    unit, size = SLOWER * float(intervals.mean()), limits.acceleration[moving]
    way, velocity = np.diff(points[:, moving], axis=0) / (size * unit**2), limits.velocity[moving] / (size * unit)
    problem = BlendProblem(way, velocity, np.ones(len(size)))
    return unit * shortest_times(problem, unit / (SLOWER * intervals), lambda times: scaled(unit * times) / unit)

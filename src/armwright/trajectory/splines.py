"""Interpolating splines through waypoints, and knot times that keep limits. [BiagiottiMelchiorri2008]"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline

from armwright.errors import ScenarioError
from armwright.trajectory.knot_times import spline_intervals
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.piecewise import PiecewisePolynomial, derived, polynomial

CURVES = ("cubic", "natural_cubic", "quintic", "natural_quintic")
UNEVEN, SHAPED = 0.75, 3  # power of the shortest times, and rounds, of the first intervals
ROUNDS = 30  # of stretching and shrinking intervals of quintic splines, from each start
INSIDE = np.linspace(0.0, 1.0, 9)  # points of a piece at which a round looks; the last scaling takes exact extrema
GENTLE = 0.6  # power of an interval's excess by which it is stretched: 1 overshoots, as neighbours answer
FAR = 2.0  # by the best duration: a round that goes so far astray ends the search from that start
LEAST = 1e-2  # of its first length, that an interval keeps


def spline(curve: str, times: np.ndarray, points: np.ndarray) -> PiecewisePolynomial:
    """The spline through points (k, n) [rad | m] at times (k,) [s].

    A clamped one begins and ends at rest: "cubic" with q̇ = 0, "quintic" with q̇ = q̈ = 0. A natural one has q̈ = 0 at both ends,
    a quintic q⁽³⁾ = q⁽⁴⁾ = 0: it begins and ends moving.
    """
    natural = curve.startswith("natural")
    if curve.endswith("cubic"):
        found = CubicSpline(times, points, bc_type="natural" if natural else "clamped")
        return PiecewisePolynomial(times, found.c[::-1].transpose(1, 2, 0))
    ends = [(order, np.zeros(points.shape[1])) for order in ((3, 4) if natural else (1, 2))]
    unit = (times[-1] - times[0]) / (len(times) - 1)  # derivatives of intervals near 1 are near each other in size
    knots = (times - times[0]) / unit
    found = make_interp_spline(knots, points, k=5, bc_type=(ends, ends))
    qd, qdd = found.derivative(1)(knots) / unit, found.derivative(2)(knots) / unit**2
    return PiecewisePolynomial.hermite(times, points, qd, qdd)


def optimised_spline(curve: str, points: np.ndarray, limits: MotionLimits) -> PiecewisePolynomial:
    """The spline with the shortest duration found, from time 0, that keeps limits of speed, acceleration and jerk.

    Its knot times are those of the fastest cubic spline with such ends, a local optimum. A quintic spline goes on from there:
    intervals are stretched where they exceed a limit and shrunk where they use none, again and again. The best of all is then
    scaled so that the largest use of a limit, at the exact extrema of its pieces, is 1.
    """
    shortest = _shortest_intervals(np.abs(np.diff(points, axis=0)), limits)
    cubic = curve.replace("quintic", "cubic")
    intervals = _balanced(cubic, shortest**UNEVEN, points, limits, SHAPED)
    if len(points) > 2:
        intervals = spline_intervals(
            cubic, points, intervals, limits, lambda each: each * _used_of_pieces(cubic, each, points, limits).max()
        )
    if curve.endswith("quintic"):
        both = [_balanced(curve, each, points, limits, ROUNDS) for each in (intervals, shortest)]
        intervals = min(both, key=np.sum)
    return scaled_to_limits(spline(curve, np.append(0.0, np.cumsum(intervals)), points), limits)


def _balanced(curve: str, intervals: np.ndarray, points: np.ndarray, limits: MotionLimits, rounds: int) -> np.ndarray:
    """Shortest intervals (k - 1,) [s] that keep the limits among those of some rounds that even out their use."""
    best: tuple[float, np.ndarray] = (np.inf, intervals)
    least = LEAST * intervals  # an unused interval would shrink for ever
    for _ in range(rounds):
        try:
            used = _used_of_pieces(curve, intervals, points, limits)
        except np.linalg.LinAlgError:  # intervals too uneven for this curve
            break
        intervals = intervals * used.max()  # which keeps all limits
        if intervals.sum() < best[0]:
            best = float(intervals.sum()), intervals
        elif intervals.sum() > FAR * best[0]:  # it does not settle
            break
        intervals = np.maximum(intervals * (used / used.max()) ** GENTLE, least)
    if not np.isfinite(best[0]):
        expected = "waypoints more evenly apart, or another curve"
        raise ScenarioError("no times were found", place="Waypoints.points", expected=expected)
    return best[1]


def scaled_to_limits(motion: PiecewisePolynomial, limits: MotionLimits) -> PiecewisePolynomial:
    """The motion scaled in time so that its largest use of a limit of speed, acceleration or jerk is 1, by exact extrema."""
    bounds = (limits.velocity, limits.acceleration, limits.jerk)
    used = max(float((motion.largest(order) / most).max()) ** (1.0 / order) for order, most in enumerate(bounds, 1))
    return motion.scaled(used * (1.0 + 1e-12))


def _shortest_intervals(way: np.ndarray, limits: MotionLimits) -> np.ndarray:
    """(k,) [s] time in which each way (k, n) can be gone at all, from rest to rest by its limits."""
    powers: tuple[Callable[[np.ndarray], np.ndarray], ...] = (lambda x: x, np.sqrt, np.cbrt)
    bounds = (limits.velocity, limits.acceleration, limits.jerk)
    return np.max([power(way / most).max(axis=1) for power, most in zip(powers, bounds, strict=True)], axis=0)


def _used_of_pieces(curve: str, intervals: np.ndarray, points: np.ndarray, limits: MotionLimits) -> np.ndarray:
    """(k,) factor by which time would have to be stretched in each piece."""
    motion = spline(curve, np.append(0.0, np.cumsum(intervals)), points)
    c: np.ndarray = motion.coefficients
    s, used = intervals[:, None, None] * INSIDE, np.zeros(len(intervals))
    for order, most in enumerate((limits.velocity, limits.acceleration, limits.jerk), 1):
        c = derived(c)
        if np.isfinite(most).any():
            largest = np.abs(polynomial(c[:, :, None], s)).max(axis=2)
            used = np.maximum(used, (largest / most).max(axis=1) ** (1.0 / order))
    return used

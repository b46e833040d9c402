"""Moves limited in jerk: seven segments of constant jerk, the double-S profile. [BiagiottiMelchiorri2008]"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.piecewise import PiecewiseMotion, PiecewisePolynomial
from armwright.trajectory.poses import check_number, chosen_duration, move_within
from armwright.trajectory.trapezoid import standing

JERK = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])  # in the seven segments, by its largest


@dataclass(frozen=True, eq=False)
class SCurve(PiecewiseMotion):
    """Fastest move from rest to rest within limits of speed, acceleration and jerk, in seven segments of constant jerk.

    Accelerations are continuous. Joints end together: those that need less time than the slowest move slower in proportion.

    Args:
        start, goal: (n,) [rad | m].   limits: velocity and acceleration (perhaps infinite), jerk, position.
        duration: [s]; None: what the slowest joint needs.   time: [s] of its beginning.
    Raises:
        ScenarioError: a pose outside its limits, no jerk limit, a duration too short, a move without length.
    """

    start: Any
    goal: Any
    limits: MotionLimits
    duration: Any = None
    time: float = 0.0

    def __post_init__(self) -> None:
        start, goal = move_within("SCurve", self.start, self.goal, self.limits)
        check_number("SCurve", "time", self.time)
        limits, way = self.limits, goal - start
        limits.required("jerk", moving=way != 0.0)
        bounds = zip(way, limits.velocity, limits.acceleration, limits.jerk, strict=True)
        profiles = [s_curve_times(abs(h), v, a, j) for h, v, a, j in bounds]
        least = np.array([times.sum() for times in profiles])
        duration = chosen_duration("SCurve", self.duration, least, limits)
        parts = []
        for k, times in enumerate(profiles):
            if way[k] == 0.0:
                parts.append(standing(self.time, duration, start[k]))
                continue
            ramp, flat, _, cruise, *_ = stretched = times * (duration / least[k])
            # the way is the speed reached, j ramp (ramp + flat), times half the time of accelerating and braking and the cruise
            jerk = way[k] / (ramp * (ramp + flat) * (2.0 * ramp + flat + cruise))
            rows = np.zeros((7, 3))
            rows[:, -1] = jerk * JERK
            parts.append(PiecewisePolynomial.of_segments(self.time, stretched, rows, start[k]))
        object.__setattr__(self, "duration", duration)
        self.set_polynomial(PiecewisePolynomial.side_by_side(parts))


def s_curve_times(h: float, v: float, a: float, j: float) -> np.ndarray:
    """(7,) durations [s] of the segments of jerk j, 0, -j, 0, -j, 0, j over a distance h ≥ 0 within limits v, a and j."""
    if h == 0.0:
        return np.zeros(7)
    # up to speed v: the acceleration reaches a, or it turns back before
    reaches = np.isfinite(a) and v * j >= a * a
    ramp = a / j if reaches else np.sqrt(v / j)
    rising = ramp + v / a if reaches else 2.0 * ramp
    if h >= v * rising:
        cruise = h / v - rising
    else:  # speed v is not reached
        cruise = 0.0
        ramp = min(a / j, np.cbrt(h / (2.0 * j)))
        rising = 0.5 * ramp + np.sqrt(0.25 * ramp * ramp + h / a) if ramp == a / j else 2.0 * ramp
    flat = max(rising - 2.0 * ramp, 0.0)
    return np.array([ramp, flat, ramp, cruise, ramp, flat, ramp])

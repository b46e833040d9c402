"""Moves with trapezoidal speeds: constant acceleration, constant speed, constant deceleration. [BiagiottiMelchiorri2008]"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.piecewise import PiecewiseMotion, PiecewisePolynomial
from armwright.trajectory.poses import check_number, chosen_duration, move_within


@dataclass(frozen=True, eq=False)
class Trapezoid(PiecewiseMotion):
    """Fastest move from rest to rest within limits of speed and acceleration (LSPB): q̈ = a, 0, -a.

    With h = |goal - start| a joint accelerates for t_a = v / a and is at speed v for h / v - t_a; where h < v² / a it does
    not reach v, and t_a = √(h / a). Joints end together: those that need less time than the slowest move slower in proportion.

    Args:
        start, goal: (n,) [rad | m].   limits: velocity (perhaps infinite), acceleration, position.
        duration: [s]; None: what the slowest joint needs.   time: [s] of its beginning.
    Raises:
        ScenarioError: a pose outside its limits, no acceleration limit, a duration too short, a move without length.
    """

    start: Any
    goal: Any
    limits: MotionLimits
    duration: Any = None
    time: float = 0.0

    def __post_init__(self) -> None:
        start, goal = move_within("Trapezoid", self.start, self.goal, self.limits)
        check_number("Trapezoid", "time", self.time)
        way = goal - start
        self.limits.required("acceleration", moving=way != 0.0)
        profiles = [
            trapezoid_times(abs(h), v, a)
            for h, v, a in zip(way, self.limits.velocity, self.limits.acceleration, strict=True)
        ]
        least = np.array([sum(times) for times in profiles])
        duration = chosen_duration("Trapezoid", self.duration, least, self.limits)
        parts = []
        for k, times in enumerate(profiles):
            if way[k] == 0.0:
                parts.append(standing(self.time, duration, start[k]))
                continue
            accelerating, cruising, _ = stretched = np.array(times) * (duration / least[k])
            a = way[k] / (accelerating * (accelerating + cruising))
            rows = np.array([[0.0, a], [0.0, 0.0], [0.0, -a]])
            parts.append(PiecewisePolynomial.of_segments(self.time, stretched, rows, start[k]))
        object.__setattr__(self, "duration", duration)
        self.set_polynomial(PiecewisePolynomial.side_by_side(parts))


def trapezoid_times(h: float, v: float, a: float) -> tuple[float, float, float]:
    """Durations [s] of acceleration, constant speed and deceleration over a distance h ≥ 0 [rad | m] within limits v and a."""
    if h == 0.0:
        return 0.0, 0.0, 0.0
    if h < v * v / a:  # the speed v is not reached
        return np.sqrt(h / a), 0.0, np.sqrt(h / a)
    return v / a, h / v - v / a, v / a


def standing(time: float, duration: float, position: float) -> PiecewisePolynomial:
    """Motion of one joint at rest."""
    return PiecewisePolynomial(np.array([time, time + duration]), np.full((1, 1, 1), position))

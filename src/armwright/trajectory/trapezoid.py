"""Moves with trapezoidal speeds: constant acceleration, constant speed, constant deceleration. [BiagiottiMelchiorri2008]"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright.trajectory.segmented import SegmentedMove


def trapezoid_times(h: float, v: float, a: float, j: float = np.inf) -> np.ndarray:
    """(3,) [s] of acceleration, speed and deceleration over a distance h ≥ 0 within limits v and a; j does not count."""
    if h == 0.0:
        return np.zeros(3)
    if h < v * v / a:  # the speed v is not reached
        return np.array([np.sqrt(h / a), 0.0, np.sqrt(h / a)])
    return np.array([v / a, h / v - v / a, v / a])


@dataclass(frozen=True, eq=False)
class Trapezoid(SegmentedMove):
    """Fastest move from rest to rest within limits of speed and acceleration (LSPB): q̈ = a, 0, -a.

    With h = |goal - start| a joint accelerates for t_a = v / a and is at speed v for h / v - t_a; where h < v² / a it does
    not reach v, and t_a = √(h / a). Joints end together: those that need less time than the slowest move slower in proportion.

    Args:
        start, goal: (n,) [rad | m].   limits: velocity (perhaps infinite), acceleration, position.
        duration: [s]; None: what the slowest joint needs.   time: [s] of its beginning.
    Raises:
        ScenarioError: a pose outside its limits, no acceleration limit, a duration too short, a move without length.
    Example:
        >>> limits = aw.trajectories.MotionLimits.of("two-link", velocity=1.0, acceleration=4.0)
        >>> move = aw.trajectories.Trapezoid([0.0, 0.0], [0.5, -0.5], limits)
        >>> round(float(move.duration), 3)
        0.75
    """

    NEEDED = "acceleration"

    _durations = staticmethod(trapezoid_times)

    @staticmethod
    def _constants(h: float, times: np.ndarray) -> np.ndarray:
        """(3, 2) accelerations, behind zeros in place of speeds."""
        accelerating, cruising, _ = times
        a = h / (accelerating * (accelerating + cruising))
        return np.array([[0.0, a], [0.0, 0.0], [0.0, -a]])

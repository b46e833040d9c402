"""Moves limited in jerk: seven segments of constant jerk, the double-S profile. [BiagiottiMelchiorri2008]"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright.trajectory.segmented import SegmentedMove

SIGNS = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])  # of the jerk in the seven segments


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


def s_curve_jerks(h: float, times: np.ndarray) -> np.ndarray:
    """(7, 3) jerks of segments of times (7,) [s] over a way h, behind zeros in place of speeds and accelerations."""
    ramp, flat, _, cruise, *_ = times
    rows = np.zeros((7, 3))
    # the way is the speed reached, j ramp (ramp + flat), times half the time of accelerating and braking and the cruise
    rows[:, -1] = h / (ramp * (ramp + flat) * (2.0 * ramp + flat + cruise)) * SIGNS
    return rows


@dataclass(frozen=True, eq=False)
class SCurve(SegmentedMove):
    """Fastest move from rest to rest within limits of speed, acceleration and jerk, in seven segments of constant jerk.

    Accelerations are continuous. Joints end together: those that need less time than the slowest move slower in proportion.

    Args:
        start, goal: (n,) [rad | m].   limits: velocity and acceleration (perhaps infinite), jerk, position.
        duration: [s]; None: what the slowest joint needs.   time: [s] of its beginning.
    Raises:
        ScenarioError: a pose outside its limits, no jerk limit, a duration too short, a move without length.
    Example:
        >>> own = {"velocity": 1.0, "acceleration": 4.0, "jerk": 40.0}
        >>> limits = aw.trajectories.MotionLimits.of("two-link", **own)
        >>> move = aw.trajectories.SCurve([0.0, 0.0], [0.5, -0.5], limits)
        >>> round(float(move.duration), 3)
        0.85
    """

    NEEDED = "jerk"
    _durations, _constants = staticmethod(s_curve_times), staticmethod(s_curve_jerks)

"""Time of a round through several poses, with all joints at rest at each of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def rest_to_rest(distance: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Time of the fastest motion from rest to rest, the slowest joint's: a trapezoid of the speed, or a triangle.

    t = d/v + v/a  where d > v²/a,  else  2 √(d/a).

    Args:
        distance: (…, n) [rad | m].   velocity: (n,) [rad/s | m/s].   acceleration: (n,) [rad/s² | m/s²]; both may be infinite.
    Returns:
        t: (…) [s].
    """
    d = np.abs(distance)
    with np.errstate(invalid="ignore", over="ignore"):
        ramp = np.where(np.isinf(acceleration), 0.0, velocity / acceleration)
        triangle = 2.0 * np.sqrt(d / acceleration)
        trapezoid = np.where(np.isinf(velocity), np.inf, d / velocity + ramp)
        short = np.where(np.isinf(velocity), True, d <= velocity * ramp)
    return np.where(short, triangle, trapezoid).max(axis=-1)


def shortest_round(
    choices: Sequence[np.ndarray], velocity: np.ndarray, acceleration: np.ndarray
) -> tuple[float, list[int]]:
    """The fastest round through one of several joint positions for each pose, and back to the first.

    Args:
        choices: for each pose (c, n) [rad | m].   velocity, acceleration: (n,) as in `rest_to_rest`.
    Returns:
        time, picked: [s], and the index of the chosen one for each pose. A single pose takes no time.
    """
    legs = [
        rest_to_rest(choices[k][:, None] - choices[(k + 1) % len(choices)][None], velocity, acceleration)
        for k in range(len(choices))
    ]
    best, picked = np.inf, [0] * len(choices)
    for first in range(len(choices[0])):
        cost, back = np.full(len(choices[0]), np.inf), []
        cost[first] = 0.0
        for leg in legs:
            total = cost[:, None] + leg
            back.append(np.argmin(total, axis=0))
            cost = total.min(axis=0)
        if cost[first] < best:
            best, at, picked = float(cost[first]), first, [0] * len(choices)
            for k in reversed(range(len(choices))):
                at = int(back[k][at])
                picked[k] = at
    return best, picked

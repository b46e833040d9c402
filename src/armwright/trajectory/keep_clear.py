"""Least distances along paths and motions, and errors for those below the allowed distance."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from armwright.collision import Clearance, Nearest
from armwright.entry import AnyArm, AnyMotion, as_arm, as_motion
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.trajectory.limits_report import dense_times
from armwright.trajectory.motion import Motion

ZOOM, ZOOMS = np.linspace(0.0, 1.0, 11), 3  # between the neighbours of a row, and how often: to 1/125 of their distance


def nearest_along(
    clearance: Clearance, positions: Callable[[np.ndarray], np.ndarray], places: np.ndarray
) -> tuple[Nearest, float]:
    """The least distance along a curve of positions, and its place.

    The distances of each pair are computed at the places and, wherever they fall and rise again near the least one, closer and
    closer between them.

    Args:
        clearance: of the arm.   positions: q (k, n) [rad | m] at places (k,).   places: (k,) increasing, dense.
    Raises:
        ScenarioError: nothing can meet.
    """
    q = positions(places)
    found, place = clearance.nearest(q), float(places[clearance.nearest(q).index])
    rows = clearance.distances(q)
    before, after = np.vstack([rows[:1], rows[:-1]]), np.vstack([rows[1:], rows[-1:]])
    could = rows - np.maximum(np.abs(rows - before), np.abs(rows - after)) < found.distance
    row, pair = np.nonzero((rows <= before) & (rows <= after) & could)
    low, high = places[np.maximum(row - 1, 0)], places[np.minimum(row + 1, len(places) - 1)]
    for _ in range(ZOOMS if len(row) else 0):
        closer = low[:, None] + (high - low)[:, None] * ZOOM
        distances = clearance.distances(positions(closer.ravel())).reshape(*closer.shape, -1)
        distances = distances[np.arange(len(row)), :, pair]
        k = distances.argmin(axis=1)
        best = int(distances.min(axis=1).argmin())
        if distances[best, k[best]] < found.distance:
            place = float(closer[best, k[best]])
            index = int(np.searchsorted(places, place))
            found = Nearest(float(distances[best, k[best]]), clearance.pairs[pair[best]], min(index, len(places) - 1))
        k = k.clip(1, len(ZOOM) - 2)
        low, high = (closer[np.arange(len(row)), k + side] for side in (-1, 1))
    return found, place


def too_near(clearance: Clearance, found: Nearest, when: str = "") -> ScenarioError | None:
    """The error for two objects nearer than allowed; None if they keep the distance."""
    if found.distance >= clearance.least:
        return None
    one, two = found.pair
    if found.distance < 0.0:
        how = f"overlap by {-1e3 * found.distance:.4g} mm"
    else:
        how = f"are {1e3 * found.distance:.4g} mm apart"
    return ScenarioError(f"{one} and {two} {how}{when}", expected=f"{1e3 * clearance.least:.4g} mm or more")


def check_arm(clearance: Any, arm: Model) -> None:
    """Refuses a value that is not a clearance, or is one of another arm.

    Raises:
        ScenarioError: shows it.
    """
    if not isinstance(clearance, Clearance) or clearance.arm.names != arm.names:
        raise ScenarioError(
            place="clearance", value=clearance, expected=f"aw.collision.clearance(arm, …) of {arm.name}"
        )


def check_clearance(arm: AnyArm, motion: AnyMotion, clearance: Clearance) -> tuple[Nearest, float]:
    """The least distance during a motion, and its time [s].

    Args:
        arm: whose joints move.   motion: with an end.   clearance: of the arm, with the least distance that is allowed.
    Returns:
        nearest: distance and pair.   time: [s].
    Raises:
        ScenarioError: something comes nearer than `clearance.least`: what, how near and when; the clearance of another arm.
    Example:
        >>> floor = aw.collision.PlaneObstacle((0, 0, -0.3), (0, 0, 1), name="floor")
        >>> near = aw.collision.clearance("puma560", [floor], radius=0.06)
        >>> move = aw.trajectories.Quintic(np.zeros(6), np.full(6, 0.3), duration=1.0)
        >>> found, time = aw.trajectories.check_clearance(aw.load("puma560"), move, near)
        >>> print(found)
        link2 and link4: 31.42 mm
    """
    arm = as_arm(arm)
    motion = as_motion(motion, arm)
    check_arm(clearance, arm)
    if not isinstance(motion, Motion):
        raise ScenarioError(place="motion", value=motion, expected="a motion of the arm's joints")
    if motion.n != arm.n:
        raise ScenarioError(f"a motion of {motion.n} joints", place="motion", expected=f"one of {arm.n}")
    found, t = nearest_along(clearance, lambda t: motion.at(t)[0], dense_times(motion))
    error = too_near(clearance, found, f" at {t:.4g} s")
    if error is not None:
        raise error.within("motion")
    return found, t

"""Poses and durations of motions, checked."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.parameters import Batch, Draw, numbers_by_lane
from armwright.trajectory.limits import MotionLimits

LARGEST = 1e100  # of numbers, and of their reciprocals: squares stay within the range of floats


def check_poses(reference: str, **poses: Any) -> None:
    """Refuses values that are not poses (n,) [rad | m] or a `Batch` of them, and poses of different lengths.

    Args:
        reference: who asks, for errors.   poses: values by the name of their field.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    """
    sizes = {}
    for name, value in poses.items():
        if isinstance(value, Draw):
            continue  # checked when it is drawn
        try:
            rows = numbers_by_lane(value)
        except ValueError:
            rows = np.zeros(0)
        if rows.ndim != 2 or not rows.size or not (np.abs(rows) < LARGEST).all():
            expected = "finite numbers, one for each joint"
            raise ScenarioError(place=f"{reference}.{name}", value=value, expected=expected)
        sizes[name] = rows.shape[-1]
    if len(set(sizes.values())) > 1:
        counts = ", ".join(f"{count} of {name}" for name, count in sizes.items())
        raise ScenarioError(f"numbers of joints differ: {counts}", place=reference)


def check_number(reference: str, name: str, value: Any, *, above: float = -np.inf) -> None:
    """Refuses a value that is not a finite number above a bound, nor a `Batch` of such.

    Raises:
        ScenarioError: names the field, its value and what was expected.
    """
    drawn = isinstance(value, Draw)  # checked when it is
    for each in value.values if isinstance(value, Batch) else [] if drawn else [value]:
        number = scalar.real_number(each)
        least = 1.0 / LARGEST if above == 0.0 else above
        if number is None or not least < number < LARGEST:
            expected = "a finite number" if above == -np.inf else f"a number above {above:g}"
            raise ScenarioError(place=f"{reference}.{name}", value=each, expected=expected)


def joint_count(pose: Any) -> int:
    """Number of joints of a pose (n,), or of a `Batch` of poses."""
    return numbers_by_lane(pose).shape[-1]


def plain_pose(kind: str, name: str, value: Any, n: int | None = None) -> np.ndarray:
    """(n,) a pose without batches; None gives zeros if n is known.

    Raises:
        ScenarioError: names the field, its value and what was expected.
    """
    if value is None and n is not None:
        return np.zeros(n)
    if isinstance(value, (Batch, Draw)):
        raise ScenarioError("a Batch", place=f"{kind}.{name}", expected="one pose: this kind is planned, not traced")
    check_poses(kind, **{name: value})
    pose = scalar.real_numbers(value).astype(float)
    if n is not None and len(pose) != n:
        raise ScenarioError(f"{len(pose)} numbers", place=f"{kind}.{name}", expected=f"{n}, one for each joint")
    return pose


def chosen_duration(kind: str, duration: float | None, least: np.ndarray, limits: MotionLimits) -> float:
    """Duration [s] of a move of synchronised joints: that of the slowest, or the given one.

    Args:
        kind: who asks, for errors.   duration: [s]; None: the least.   least: (n,) [s] that each joint needs.
    Raises:
        ScenarioError: nothing moves and no duration is given, a joint that no limit bounds, or a duration too short; names
            the joint and what it needs.
    """
    slowest = int(np.argmax(least))
    if not np.isfinite(least).all():
        free = [limits.names[k] for k in np.flatnonzero(~np.isfinite(least))]
        raise ScenarioError(f"nothing limits {', '.join(free)}", place=kind, expected="limits, or a duration")
    if duration is None:
        if least[slowest] <= 0.0:
            expected = "another pose than start, or a duration to stand"
            raise ScenarioError("the move has no length", place=f"{kind}.goal", expected=expected)
        return float(least[slowest])
    check_number(kind, "duration", duration, above=0.0)
    if duration < least[slowest] * (1.0 - 1e-12):
        expected = f"{least[slowest]:.6g} s or more, which {limits.names[slowest]} needs within its limits"
        raise ScenarioError(place=f"{kind}.duration", value=duration, expected=expected)
    return float(duration)


def move_within(kind: str, start: Any, goal: Any, limits: Any) -> tuple[np.ndarray, np.ndarray]:
    """Start and goal (n,) of a move, both within the limits of position.

    Raises:
        ScenarioError: what is no pose or no limits, a pose outside; names the joint and how far.
    """
    check_limits(kind, limits)
    poses = plain_pose(kind, "start", start, limits.n), plain_pose(kind, "goal", goal, limits.n)
    for name, pose in zip(("start", "goal"), poses, strict=True):
        limits.check_position(f"{kind}.{name}", pose)
    return poses


def check_limits(kind: str, limits: Any) -> None:
    """Refuses a value that is not `MotionLimits`.

    Raises:
        ScenarioError: shows it.
    """
    if not isinstance(limits, MotionLimits):
        raise ScenarioError(place=f"{kind}.limits", value=limits, expected="aw.trajectories.MotionLimits.of(arm, …)")


def duration_within(motion: Any, peaks: tuple[float, float, float]) -> Any:
    """Duration [s] of a motion from rest to rest along one polynomial: the given one, or the shortest within its limits.

    Args:
        motion: with `start`, `goal`, `duration` and `limits`.
        peaks: largest speed, acceleration and jerk of a way of 1 in a time of 1.
    Raises:
        ScenarioError: no duration and no limits, a pose outside its limits, a duration too short.
    """
    kind = type(motion).__name__
    for name in ("duration", "time"):
        if isinstance(getattr(motion, name), MotionLimits):
            raise ScenarioError(
                "are limits", place=f"{kind}.{name}", expected=f"a number [s]; limits by name: {kind}(…, limits=…)"
            )
    if motion.limits is not None:
        check_limits(kind, motion.limits)
    if motion.limits is None or isinstance(motion.duration, (Batch, Draw)):
        if motion.duration is None:
            raise ScenarioError("missing", place=f"{kind}.duration", expected="a duration [s], or limits")
        check_number(kind, "duration", motion.duration, above=0.0)
        return motion.duration
    start, goal = move_within(kind, motion.start, motion.goal, motion.limits)
    way, limits = np.abs(goal - start), motion.limits
    least = rest_to_rest_times(peaks, way, limits)
    if motion.duration is None:
        least = np.where((way > 0.0) & limits.unlimited, np.inf, least)
    return chosen_duration(kind, motion.duration, least, limits)


def rest_to_rest_times(peaks: tuple[float, float, float], way: np.ndarray, limits: MotionLimits) -> np.ndarray:
    """(n,) [s] least time of each joint for a way (n,) of 0 or more along one polynomial with these peaks."""
    bounds = np.stack([limits.velocity, limits.acceleration, limits.jerk])
    return ((np.array(peaks)[:, None] * way / bounds) ** (1.0 / np.array([[1.0], [2.0], [3.0]]))).max(axis=0)

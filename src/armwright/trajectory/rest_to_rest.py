"""Motions from rest to rest along one polynomial of third or fifth degree, the same for all joints."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from armwright import scalar
from armwright.parameters import Numbers
from armwright.scalar import Array, Scalar
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.motion import Motion
from armwright.trajectory.poses import check_number, check_poses, duration_within, joint_count


@dataclass(frozen=True, eq=False)
class RestToRest(Motion):
    """q(t) = start + p(s)(goal - start),  s = (t - time) / duration within 0 and 1.

    Args:
        start, goal: (n,) [rad | m].   duration: [s]; None: the shortest within the limits.   time: [s] of its beginning.
        limits: that are kept; None: none are.
    Raises:
        ScenarioError: names the field, its value and what was expected; with limits a pose outside and how far.
    """

    PEAKS: ClassVar[tuple[float, float, float]]  # largest speed, acceleration and jerk, by way / durationᵏ

    start: Numbers
    goal: Numbers
    duration: Any = None
    time: float = 0.0
    limits: MotionLimits | None = None

    def __post_init__(self) -> None:
        kind = type(self).__name__
        check_poses(kind, start=self.start, goal=self.goal)
        object.__setattr__(self, "duration", duration_within(self, self.PEAKS))
        check_number(kind, "time", self.time)

    @property
    def n(self) -> int:
        """Number of joints."""
        return joint_count(self.start)

    @staticmethod
    @abstractmethod
    def law(s: Scalar, moving: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """p and its first and second derivative at s; `moving` is 0 before the beginning and after the end, else 1."""

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s]."""
        start, goal = scalar.array(self.start), scalar.array(self.goal)
        way, s = goal - start, scalar.clip((t - self.time) / self.duration, 0.0, 1.0)
        moving = scalar.less_equal(self.time, t) * scalar.less_equal(t, self.time + self.duration)  # up to `breaks[-1]`
        path, speed, acceleration = self.law(s, moving)
        speed, acceleration = speed / self.duration, acceleration / self.duration**2
        return scalar.array(start + path * way), scalar.array(speed * way), scalar.array(acceleration * way)


@dataclass(frozen=True, eq=False)
class Cubic(RestToRest):
    """q(t) = start + (3 s² - 2 s³)(goal - start),  s = (t - time) / duration within 0 and 1.

    Speed is 0 at both ends, where acceleration jumps. With limits and without a duration it is as fast as the slowest
    joint can: 1.5 h / T is its largest speed, 6 h / T² its acceleration, 12 h / T³ its jerk.

    Each field but `limits` may be a `Batch`; then a duration is needed.

    Args:
        start, goal: (n,) [rad | m].   duration: [s]; None: the shortest within the limits.   time: [s] of its beginning.
        limits: that are kept; None: none are.
    Raises:
        ScenarioError: names the field, its value and what was expected; with limits a pose outside and how far.
    Example:
        >>> move = aw.trajectories.Cubic([0.0, 0.0], [0.5, -0.5], duration=1.0)
        >>> q, qd, qdd = move.at(0.25)
        >>> print(q.round(4), qd)
        [ 0.0781 -0.0781] [ 0.5625 -0.5625]
    """

    PEAKS: ClassVar[tuple[float, float, float]] = (1.5, 6.0, 12.0)

    @staticmethod
    def law(s: Scalar, moving: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """3 s² - 2 s³ and its derivatives; the second is 0 at rest."""
        return s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s), moving * (6.0 - 12.0 * s)


@dataclass(frozen=True, eq=False)
class Quintic(RestToRest):
    """q(t) = start + (10 s³ - 15 s⁴ + 6 s⁵)(goal - start),  s = (t - time) / duration within 0 and 1.

    Speed and acceleration are 0 at both ends. With limits and without a duration it is as fast as the slowest joint can:
    15/8 h / T is its largest speed, 10/√3 h / T² its acceleration, 60 h / T³ its jerk.

    Each field but `limits` may be a `Batch`; then a duration is needed.

    Args:
        start, goal: (n,) [rad | m].   duration: [s]; None: the shortest within the limits.   time: [s] of its beginning.
        limits: that are kept; None: none are.
    Raises:
        ScenarioError: names the field, its value and what was expected; with limits a pose outside and how far.
    Example:
        >>> move = aw.trajectories.Quintic([0.0, 0.0], [0.5, -0.5], duration=1.0)
        >>> q, qd, qdd = move.at(0.25)
        >>> print(q.round(4), qd.round(3))
        [ 0.0518 -0.0518] [ 0.527 -0.527]
    """

    PEAKS: ClassVar[tuple[float, float, float]] = (15.0 / 8.0, 10.0 / 3.0**0.5, 60.0)

    @staticmethod
    def law(s: Scalar, moving: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """10 s³ - 15 s⁴ + 6 s⁵ and its derivatives."""
        path = s * s * s * (10.0 + s * (-15.0 + 6.0 * s))
        speed = 30.0 * s * s * (1.0 + s * (-2.0 + s))
        return path, speed, 60.0 * s * (1.0 + s * (-3.0 + 2.0 * s))

"""A motion from rest to rest by a polynomial of third degree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from armwright import scalar
from armwright.scalar import Array, Scalar
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.motion import Motion
from armwright.trajectory.poses import check_number, check_poses, duration_within, joint_count

PEAKS = (1.5, 6.0, 12.0)  # largest speed, acceleration and jerk of (3 s² - 2 s³), by way / durationᵏ


@dataclass(frozen=True, eq=False)
class Cubic(Motion):
    """q(t) = start + (3 s² - 2 s³)(goal - start),  s = (t - time) / duration within 0 and 1.

    Speed is 0 at both ends, where acceleration jumps. With limits and without a duration it is as fast as the slowest
    joint can: 1.5 h / T is its largest speed, 6 h / T² its acceleration, 12 h / T³ its jerk.

    Each field but `limits` may be a `Batch`; then a duration is needed.

    Args:
        start, goal: (n,) [rad | m].   duration: [s]; None: the shortest within the limits.   time: [s] of its beginning.
        limits: that are kept; None: none are.
    Raises:
        ScenarioError: names the field, its value and what was expected; with limits a pose outside and how far.
    """

    start: Any
    goal: Any
    duration: Any = None
    time: float = 0.0
    limits: MotionLimits | None = None

    def __post_init__(self) -> None:
        check_poses("Cubic", start=self.start, goal=self.goal)
        object.__setattr__(self, "duration", duration_within(self, PEAKS))
        check_number("Cubic", "time", self.time)

    @property
    def n(self) -> int:
        """Number of joints."""
        return joint_count(self.start)

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s]."""
        start, goal = scalar.array(self.start), scalar.array(self.goal)
        way, s = goal - start, scalar.clip((t - self.time) / self.duration, 0.0, 1.0)
        moving = scalar.less_equal(0.0, t - self.time) * scalar.less_equal(t - self.time, self.duration)
        path = s * s * (3.0 - 2.0 * s)
        speed = 6.0 * s * (1.0 - s) / self.duration
        acceleration = moving * (6.0 - 12.0 * s) / self.duration**2
        return scalar.array(start + path * way), scalar.array(speed * way), scalar.array(acceleration * way)

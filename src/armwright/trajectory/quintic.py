"""A motion from rest to rest by a polynomial of fifth degree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from armwright import scalar
from armwright.scalar import Array, Scalar
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.motion import Motion
from armwright.trajectory.poses import check_number, check_poses, duration_within, joint_count

PEAKS = (15.0 / 8.0, 10.0 / 3.0**0.5, 60.0)  # largest speed, acceleration and jerk, by way / durationᵏ


@dataclass(frozen=True, eq=False)
class Quintic(Motion):
    """q(t) = start + (10 s³ - 15 s⁴ + 6 s⁵)(goal - start),  s = (t - time) / duration within 0 and 1.

    Speed and acceleration are 0 at both ends. With limits and without a duration it is as fast as the slowest joint can:
    15/8 h / T is its largest speed, 10/√3 h / T² its acceleration, 60 h / T³ its jerk.

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
        check_poses("Quintic", start=self.start, goal=self.goal)
        object.__setattr__(self, "duration", duration_within(self, PEAKS))
        check_number("Quintic", "time", self.time)

    @property
    def n(self) -> int:
        """Number of joints."""
        return joint_count(self.start)

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s]."""
        start, goal = scalar.array(self.start), scalar.array(self.goal)
        way, s = goal - start, scalar.clip((t - self.time) / self.duration, 0.0, 1.0)
        path = s * s * s * (10.0 + s * (-15.0 + 6.0 * s))
        speed = 30.0 * s * s * (1.0 + s * (-2.0 + s)) / self.duration
        acceleration = 60.0 * s * (1.0 + s * (-3.0 + 2.0 * s)) / self.duration**2
        return scalar.array(start + path * way), scalar.array(speed * way), scalar.array(acceleration * way)

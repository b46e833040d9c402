"""A motion from rest to rest by a polynomial of fifth degree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from armwright import scalar
from armwright.scalar import Array, Scalar
from armwright.trajectory.motion import Motion
from armwright.trajectory.poses import check_number, check_poses, joint_count


@dataclass(frozen=True, eq=False)
class Quintic(Motion):
    """q(t) = start + (10 s³ - 15 s⁴ + 6 s⁵)(goal - start),  s = (t - time) / duration within 0 and 1.

    Speed and acceleration are 0 at both ends.

    Each field may be a `Batch`.

    Args:
        start, goal: (n,) [rad | m].   duration: [s].   time: [s] of its beginning.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    """

    start: Any
    goal: Any
    duration: float
    time: float = 0.0

    def __post_init__(self) -> None:
        check_poses("Quintic", start=self.start, goal=self.goal)
        check_number("Quintic", "duration", self.duration, above=0.0)
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

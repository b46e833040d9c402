"""A motion of constant speed from one pose to another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.parameters import Numbers
from armwright.scalar import Array, Scalar
from armwright.trajectory.motion import Motion
from armwright.trajectory.poses import check_number, check_poses, joint_count


@dataclass(frozen=True, eq=False)
class Ramp(Motion):
    """q(t) = start + s (goal - start) with s from 0 at `time` to 1 a `duration` later, in proportion to time.

    Each field may be a `Batch`.

    Args:
        start, goal: (n,) [rad | m].   duration: [s].   time: [s] of its beginning.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> ramp = aw.trajectories.Ramp([0.0, 0.0], [0.5, -0.5], duration=1.0)
        >>> q, qd, qdd = ramp.at(0.5)
        >>> print(q, qd)
        [ 0.25 -0.25] [ 0.5 -0.5]
    """

    start: Numbers
    goal: Numbers
    duration: float
    time: float = 0.0

    def __post_init__(self) -> None:
        check_poses("Ramp", start=self.start, goal=self.goal)
        check_number("Ramp", "duration", self.duration, above=0.0)
        check_number("Ramp", "time", self.time)

    @property
    def n(self) -> int:
        """Number of joints."""
        return joint_count(self.start)

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s]."""
        start, goal = scalar.array(self.start), scalar.array(self.goal)
        s = scalar.clip((t - self.time) / self.duration, 0.0, 1.0)
        moving = scalar.less_equal(0.0, t - self.time) * scalar.less(t - self.time, self.duration)
        speed = (goal - start) / self.duration
        return scalar.array(start + s * (goal - start)), scalar.array(moving * speed), np.zeros(len(start))

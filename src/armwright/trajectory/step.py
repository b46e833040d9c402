"""A jump from one pose to another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.parameters import Numbers
from armwright.scalar import Array, Scalar
from armwright.trajectory.motion import Motion
from armwright.trajectory.poses import check_number, check_poses, joint_count

ROUNDING = 1e-12  # of a time: a tick this near the jump is on it


@dataclass(frozen=True, eq=False)
class Step(Motion):
    """q(t) = start before `time`, goal from then on; speed and acceleration 0.

    Each field may be a `Batch`.

    Args:
        start, goal: (n,) [rad | m].   time: [s].
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> step = aw.trajectories.Step([0.0, 0.0], [0.5, -0.5], time=0.1)
        >>> step.at(0.2)[0]
        array([ 0.5, -0.5])
    """

    start: Numbers
    goal: Numbers
    time: float = 0.0

    def __post_init__(self) -> None:
        check_poses("Step", start=self.start, goal=self.goal)
        check_number("Step", "time", self.time)

    @property
    def n(self) -> int:
        """Number of joints."""
        return joint_count(self.start)

    @property
    def duration(self) -> float:
        """0 [s]: the arm is at rest again at once."""
        return 0.0

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s]."""
        start, goal = scalar.array(self.start), scalar.array(self.goal)
        jumped = scalar.less_equal(self.time, t * (1.0 + ROUNDING))
        still = np.zeros(len(start))
        return scalar.array([scalar.where(jumped, b, a) for a, b in zip(start, goal, strict=True)]), still, still

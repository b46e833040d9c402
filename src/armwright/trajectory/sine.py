"""Sinusoidal motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.parameters import Numbers
from armwright.scalar import Array, Scalar
from armwright.trajectory.motion import Motion
from armwright.trajectory.poses import check_number, check_poses, joint_count


@dataclass(frozen=True, eq=False)
class Sine(Motion):
    """q(t) = centre + amplitude sin(2π f t + phase).

    Each field may be a `Batch`.

    Args:
        centre, amplitude: (n,) [rad | m].   frequency_hz: f.   phase: [rad].
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> sine = aw.trajectories.Sine([0.0, 0.0], [0.3, 0.1], frequency_hz=0.5)
        >>> sine.at([0.0, 0.5])[0].round(3)
        array([[0. , 0. ],
               [0.3, 0.1]])
    """

    centre: Numbers
    amplitude: Numbers
    frequency_hz: float
    phase: float = 0.0
    time = 0.0

    def __post_init__(self) -> None:
        check_poses("Sine", centre=self.centre, amplitude=self.amplitude)
        check_number("Sine", "frequency_hz", self.frequency_hz, above=0.0)
        check_number("Sine", "phase", self.phase)

    @property
    def n(self) -> int:
        """Number of joints."""
        return joint_count(self.centre)

    @property
    def duration(self) -> float:
        """Infinite [s]: the motion is endless, also before `time`."""
        return np.inf

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s]."""
        centre, amplitude = scalar.array(self.centre), scalar.array(self.amplitude)
        w = 2.0 * np.pi * self.frequency_hz
        s, c = scalar.sin(w * t + self.phase), scalar.cos(w * t + self.phase)
        return (
            scalar.array(centre + s * amplitude),
            scalar.array(w * c * amplitude),
            scalar.array(-w * w * s * amplitude),
        )

"""Input shaping: a motion convolved with impulses whose vibrations of one mode cancel.  [SingerSeering1990]

With ω_d = ω √(1 - ζ²) and K = exp(-π ζ / √(1 - ζ²)), by which half a period of the mode decays:

    ZV    impulses 1, K          over 1 + K        at 0, π/ω_d            no residual vibration of that mode
    ZVD   impulses 1, 2 K, K²    over (1 + K)²     at 0, π/ω_d, 2π/ω_d    nor a first-order one where ω is somewhat wrong
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError, check_known
from armwright.scalar import Array, Scalar
from armwright.trajectory.motion import Motion
from armwright.trajectory.poses import check_number

IMPULSES = {"zv": 1, "zvd": 2}  # powers of (1 + K z) in each kind


@dataclass(frozen=True, eq=False)
class InputShaper(Motion):
    """q(t) = Σ a_i q_r(t - t_i): a motion that leaves a mode at rest, delayed by half a period or a whole one.

    All joints are shaped alike, so synchronised joints stay so.

    Args:
        reference: the motion q_r.   hz: natural frequency of the mode, ω / 2π.   damping: its ratio ζ, from 0 to below 1.
        kind: "zv" or "zvd", which takes twice as long and forgives a wrong frequency.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> move = aw.trajectories.Quintic([0.0, 0.0], [0.5, -0.5], duration=1.0)
        >>> shaped = aw.trajectories.InputShaper(move, hz=5.0)  # of a vibration of 5 Hz
        >>> round(float(shaped.duration), 3)
        1.1
    """

    reference: Motion
    hz: float
    damping: float = 0.0
    kind: Literal["zv", "zvd"] = "zv"

    def __post_init__(self) -> None:
        if not isinstance(self.reference, Motion):
            expected = "a motion, such as aw.trajectories.Quintic(…)"
            raise ScenarioError(place="InputShaper.reference", value=self.reference, expected=expected)
        damping = scalar.real_number(self.damping)
        if damping is None or not 0.0 <= damping < 1.0:
            expected = "a ratio from 0 to below 1"
            raise ScenarioError(place="InputShaper.damping", value=self.damping, expected=expected)
        if scalar.real_number(self.hz) is None:
            raise ScenarioError(place="InputShaper.hz", value=self.hz, expected="a number above 0")
        check_number("InputShaper", "hz", self.hz, above=0.0)
        check_known(ScenarioError, self.kind, IMPULSES, place="InputShaper.kind")

    @property
    def impulses(self) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes (k,), whose sum is 1, and times (k,) [s]."""
        damped = math.sqrt(1.0 - self.damping**2)
        pair = np.array([1.0, math.exp(-math.pi * self.damping / damped)])
        row = np.ones(1)
        for _ in range(IMPULSES[self.kind]):
            row = np.convolve(row, pair / pair.sum())
        return row, np.arange(len(row)) / (2.0 * self.hz * damped)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.reference.n

    @property
    def payloads(self) -> Any:
        """Bodies in the hand, each from its time on: the reference's."""
        return self.reference.payloads

    @property
    def time(self) -> Any:
        """Time of the beginning [s], the reference's."""
        return self.reference.time

    @property
    def duration(self) -> Any:
        """Duration [s]: the reference's and the last impulse's time."""
        return self.reference.duration + self.impulses[1][-1]

    @property
    def breaks(self) -> np.ndarray:
        """(k,) [s] times at which a higher derivative may jump: the reference's after every impulse."""
        return np.unique(np.add.outer(self.impulses[1], self.reference.breaks))

    def _at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        total = np.zeros((3, *times.shape, self.n))
        for a, late in zip(*self.impulses, strict=True):
            total += a * np.stack(self.reference.at(times - late))
        q, qd, qdd = total
        return q, qd, qdd

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s]."""
        total = sum(
            a * np.stack([scalar.array(row) for row in self.reference(t - late)])
            for a, late in zip(*self.impulses, strict=True)
        )
        q, qd, qdd = scalar.array(total)
        return q, qd, qdd

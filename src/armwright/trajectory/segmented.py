"""Moves from rest to rest in segments of constant acceleration or jerk, all joints at once."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from armwright.parameters import Numbers
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.piecewise import PiecewiseMotion, PiecewisePolynomial
from armwright.trajectory.poses import check_number, chosen_duration, move_within


@dataclass(frozen=True, eq=False)
class SegmentedMove(PiecewiseMotion):
    """Fastest move from rest to rest within limits, in segments; joints end together.

    Args:
        start, goal: (n,) [rad | m].   limits: of every joint.
        duration: [s]; None: what the slowest joint needs.   time: [s] of its beginning.
    Raises:
        ScenarioError: a pose outside its limits, no limit that is needed, a duration too short, a move without length.
    """

    NEEDED: ClassVar[str]  # quantity whose limit a joint that moves must have

    start: Numbers
    goal: Numbers
    limits: MotionLimits
    duration: Any = None
    time: float = 0.0

    def __post_init__(self) -> None:
        kind, limits = type(self).__name__, self.limits
        start, goal = move_within(kind, self.start, self.goal, limits)
        check_number(kind, "time", self.time)
        way = goal - start
        limits.required(self.NEEDED, moving=way != 0.0)
        bounds = zip(np.abs(way), limits.velocity, limits.acceleration, limits.jerk, strict=True)
        profiles = [self._durations(*each) for each in bounds]
        least = np.array([times.sum() for times in profiles])
        duration = chosen_duration(kind, self.duration, least, limits)
        parts = []
        for h, times, shortest, position in zip(way, profiles, least, start, strict=True):
            if h == 0.0:
                ends = np.array([self.time, self.time + duration])
                parts.append(PiecewisePolynomial(ends, np.full((1, 1, 1), position)))
                continue
            stretched = times * (duration / shortest)
            parts.append(PiecewisePolynomial.of_segments(self.time, stretched, self._constants(h, stretched), position))
        object.__setattr__(self, "duration", duration)
        self.set_polynomial(PiecewisePolynomial.side_by_side(parts))

    @staticmethod
    @abstractmethod
    def _durations(h: float, v: float, a: float, j: float) -> np.ndarray:
        """(k,) [s] durations of the segments of a joint over a distance h ≥ 0 [rad | m] within its limits."""

    @staticmethod
    @abstractmethod
    def _constants(h: float, times: np.ndarray) -> np.ndarray:
        """(k, order) derivatives in the segments, of which the last column is not 0, over a way h [rad | m]."""

"""Geometric paths of the joints: q(s), without a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.trajectory.poses import LARGEST

COINCIDENT = 1e-12  # of the path's length: waypoints nearer than that give no direction


@dataclass(frozen=True, eq=False)
class JointPath:
    """q(s) for s from 0 to `length`: the natural cubic spline through waypoints, C²; a straight line through two.

    Without `parameter`, s grows between waypoints by their distance √Σ (Δq)², in which a metre counts as a radian. A curve
    that is sampled densely, such as a Cartesian path, brings its own parameter.

    Args:
        waypoints: (k, n) [rad | m] poses that the path passes through, two or more.
        parameter: (k,) s at the waypoints, from 0 on, increasing.
    Raises:
        ScenarioError: names the waypoint, its value and what was expected.
    Example:
        >>> path = aw.trajectories.JointPath([[0.0, 0.0], [0.5, -0.5], [1.0, 0.0]])
        >>> limits = aw.trajectories.MotionLimits.of("two-link", torque=[120.0, 30.0])
        >>> motion = aw.trajectories.time_optimal("two-link", path, limits, grid=100)
        >>> round(motion.duration, 2)
        0.81
    """

    waypoints: Any
    parameter: Any = None

    def __post_init__(self) -> None:
        points = _numbers("waypoints", self.waypoints, "two or more finite poses (k, n) [rad | m]")
        if points.ndim != 2 or points.shape[0] < 2 or points.shape[1] == 0:
            raise ScenarioError(
                f"shape {points.shape}", place="JointPath.waypoints", expected="two or more finite poses (k, n)"
            )
        distances = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
        if not distances.any():
            raise ScenarioError(
                "all waypoints coincide: the path has no length", place="JointPath.waypoints", value=points[0],
                expected="poses that differ",
            )  # fmt: skip
        if self.parameter is None:
            near = np.flatnonzero(distances <= COINCIDENT * distances.sum())
            if near.size:
                k = int(near[0])
                raise ScenarioError(
                    "the same pose as the waypoint before it, or as the start", place=f"JointPath.waypoints[{k + 1}]",
                    expected="another pose, or no such waypoint",
                )  # fmt: skip
            parameter = np.concatenate([[0.0], np.cumsum(distances)])
        else:
            parameter = _parameter(self.parameter, len(points))
        object.__setattr__(self, "waypoints", points)
        object.__setattr__(self, "parameter", parameter)

    @cached_property
    def curve(self) -> PPoly:
        """q(s) as piecewise polynomials."""
        return CubicSpline(self.parameter, self.waypoints, axis=0, bc_type="natural")

    @cached_property
    def _derivatives(self) -> Sequence[PPoly]:
        return self.curve, self.curve.derivative(1), self.curve.derivative(2)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.waypoints.shape[1]

    @property
    def length(self) -> float:
        """s of the last waypoint."""
        return float(self.parameter[-1])

    @property
    def breaks(self) -> np.ndarray:
        """(k,) values of s where a higher derivative jumps, both ends included."""
        return self.parameter

    def at(self, s: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q [rad | m], dq/ds and d²q/ds², each (…, n), at s (…) within 0 and `length`."""
        s = np.clip(np.asarray(s, dtype=float), 0.0, self.length)
        q, first, second = (curve(s) for curve in self._derivatives)
        return q, first, second

    def derivative(self, s: Any, order: int) -> np.ndarray:
        """A derivative of q (…, n) by s of that order; at a break that of the piece after it."""
        return self.curve(np.clip(np.asarray(s, dtype=float), 0.0, self.length), order)

    @cached_property
    def turns(self) -> np.ndarray:
        """(k,) s, increasing, of turning points and pauses of a joint: its q' is 0."""
        roots = self._derivatives[1].roots(discontinuity=False, extrapolate=False)
        s = np.unique(np.concatenate([np.asarray(each, dtype=float) for each in roots]))
        return s[np.isfinite(s)]  # of a joint at rest on a whole piece: NaN

    def extremes(self) -> tuple[np.ndarray, np.ndarray]:
        """s (n, 2) of each joint's lowest and highest position, and these positions (n, 2) [rad | m]."""
        s = np.concatenate([self.breaks, self.turns])
        q = self.at(s)[0]
        rows = np.stack([q.argmin(axis=0), q.argmax(axis=0)], axis=1)
        return s[rows], np.take_along_axis(q, rows.T, axis=0).T


def _numbers(name: str, value: Any, expected: str) -> np.ndarray:
    values = scalar.numbers_or_nan(value)
    wrong = ~(np.abs(values) < LARGEST)
    if wrong.any():
        row = int(np.argwhere(wrong)[0][0]) if values.ndim > 1 else None
        place = f"JointPath.{name}" if row is None else f"JointPath.{name}[{row}]"
        raise ScenarioError(place=place, value=value if row is None else values[row], expected=expected)
    return values


def _parameter(value: Any, count: int) -> np.ndarray:
    expected = f"{count} increasing numbers from 0 on, one for each waypoint"
    parameter = _numbers("parameter", value, expected)
    if parameter.shape != (count,) or parameter[0] != 0.0 or not (np.diff(parameter) > 0.0).all():
        raise ScenarioError(place="JointPath.parameter", value=parameter, expected=expected)
    return parameter

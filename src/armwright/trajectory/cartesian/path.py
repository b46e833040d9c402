"""Paths of the tool: segments in sequence with rounded corners."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import brentq

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.trajectory.cartesian.pieces import Blend, PathPoints, PathStretch, blend
from armwright.trajectory.cartesian.segments import Arc, Circle, Line, Poses, goal_pose

SMOOTH = 1e-9  # of directions, of curvatures and rates by the pieces' lengths: no corner
SHARPEST = np.deg2rad(150.0)  # corners that turn back by more are not rounded
SHARE = 0.5  # of a segment that a blend may take, on either side


@dataclass(frozen=True, eq=False)
class CartesianPath:
    """Path T(s) of the tool, s the distance covered [m]; a turn in place counts 1 m for each rad.

    Corners are rounded by polynomials of fifth degree, in position and rotation, so that T(s) is C² there. A blend passes its
    corner at `blend`, or nearer where a segment is too short, since it takes at most half of a segment, or where
    `blend_angle` asks for it. Between pieces that meet without blend and do not continue each other in direction, curvature and
    rate of turning, the tool stops; so it does where the path turns back by more than 150°, and around turns in place.

    Args:
        segments: `Line`, `Arc`, `Circle` or `Poses`, each from where the last one ends.   start: (4, 4) pose.
        blend: [m] largest distance of the rounded from the sharp path; 0: corners stay sharp.
        blend_angle: [rad] largest angle between them.
    Raises:
        ScenarioError: names the segment, its value and what was expected.
    Example:
        >>> start = aw.forward_kinematics(aw.load("ur5e"), [0.0, -1.0, 1.2, -0.5, 0.8, 0.0])
        >>> there = aw.trajectories.Line(start[:3, 3] + [0.0, 0.1, 0.0])
        >>> up = aw.trajectories.Line(start[:3, 3] + [0.0, 0.1, 0.1])
        >>> path = aw.trajectories.CartesianPath([there, up], start, blend=0.02)
        >>> round(float(path.length), 3)
        0.186
    """

    segments: Any
    start: Any
    blend: float = 0.0
    blend_angle: float = math.radians(1.0)

    def __post_init__(self) -> None:
        if not isinstance(self.segments, Sequence) or not self.segments:
            expected = "a list of Line, Arc, Circle or Poses"
            raise ScenarioError(place="CartesianPath.segments", value=self.segments, expected=expected)
        for k, each in enumerate(self.segments):
            if not isinstance(each, (Line, Arc, Circle, Poses)):
                expected = "Line, Arc, Circle or Poses"
                raise ScenarioError(place=f"segments[{k}]", value=each, expected=expected)
        object.__setattr__(self, "segments", tuple(self.segments))
        start = goal_pose("CartesianPath.start", self.start)
        if start.shape != (4, 4):
            raise ScenarioError(place="CartesianPath.start", value=self.start, expected="a pose (4, 4)")
        object.__setattr__(self, "start", start)
        for name, least in (("blend", 0.0), ("blend_angle", np.nextafter(0.0, 1.0))):
            value = scalar.real_number(getattr(self, name))
            if value is None or not least <= value < np.inf:
                bound = "0 or more" if name == "blend" else "above 0"
                raise ScenarioError(
                    place=f"CartesianPath.{name}", value=getattr(self, name), expected=f"a number {bound}"
                )
        _ = self._joined  # so that a path that cannot be drawn is refused here

    @cached_property
    def _joined(self) -> tuple[list[PathStretch | Blend], list[bool]]:
        """The pieces with their blends, and of each whether the tool stops behind it."""
        pose, stretches = self.start, []
        for k, segment in enumerate(self.segments):
            for piece in segment.pieces(pose, f"segments[{k}]"):
                stretches.append(piece)
                pose = piece.at(np.array([piece.length])).pose[0]
        cuts = [self._cut(a, b) for a, b in itertools.pairwise(stretches)]
        pieces: list[PathStretch | Blend] = []
        stops: list[bool] = []
        for k, piece in enumerate(stretches):
            before = cuts[k - 1] or 0.0 if k else 0.0
            behind = (cuts[k] or 0.0) if k < len(cuts) else 0.0
            pieces.append(piece.part(before, piece.length - behind))
            stops.append(k == len(cuts) or cuts[k] is None)
            if behind:
                pieces.append(blend(piece, stretches[k + 1], behind))
                stops.append(False)
        return pieces, stops

    def _cut(self, before: PathStretch, after: PathStretch) -> float | None:
        """[m] that a blend takes of both pieces; 0 where they continue each other, None where the tool stops."""
        if before.in_place or after.in_place:
            return None
        a, b = before.at(np.array([before.length])), after.at(np.array([0.0]))
        short = min(before.length, after.length)
        turn, bend = b.first[0, :3] - a.first[0, :3], (b.second[0, :3] - a.second[0, :3]) * short
        rate = (after.rate - before.rate) * short
        if max(np.abs(turn).max(), np.abs(bend).max(), np.abs(rate).max()) < SMOOTH:
            return 0.0
        if not self.blend or a.first[0, :3] @ b.first[0, :3] < np.cos(SHARPEST):
            return None
        most = SHARE * short
        if before.centre is None and after.centre is None:
            # p and φ pass the corner at 3/16 of the change of their slopes
            limits = [(self.blend, np.linalg.norm(turn)), (self.blend_angle, np.linalg.norm(after.rate - before.rate))]
            return float(min([most, *(16.0 * limit / (3.0 * change) for limit, change in limits if change > 0.0)]))

        def over(cut: float) -> float:
            distance, angle = blend(before, after, cut).deviation(after.position)
            return max(distance / self.blend, angle / self.blend_angle) - 1.0

        least = 1e-9 * most
        if over(least) > 0.0:  # a blend so small that the tool might as well stop
            return None
        return most if over(most) <= 0.0 else float(brentq(over, least, most, xtol=least))  # pyright: ignore[reportArgumentType]

    @cached_property
    def breaks(self) -> np.ndarray:
        """(k + 1,) s at the ends of the pieces."""
        return np.concatenate([[0.0], np.cumsum([piece.length for piece in self._joined[0]])])

    @property
    def length(self) -> float:
        """s at the end."""
        return float(self.breaks[-1])

    @cached_property
    def runs(self) -> list[tuple[float, float]]:
        """(begin, end) of the parts between two stops, in each of which T(s) is C²."""
        ends = [0.0, *self.breaks[1:][np.array(self._joined[1])]]
        return list(itertools.pairwise(float(end) for end in ends))

    def points(self, s: Any) -> PathPoints:
        """Poses and their derivatives at s (k,); at an end of a piece those of the piece before it."""
        s = np.clip(np.asarray(s, dtype=float), 0.0, self.length)
        pieces, breaks = self._joined[0], self.breaks
        which = np.clip(np.searchsorted(breaks, s, side="left") - 1, 0, len(pieces) - 1)
        found = PathPoints(np.zeros((len(s), 4, 4)), np.zeros((len(s), 6)), np.zeros((len(s), 6)))
        for k in np.unique(which):
            rows = np.flatnonzero(which == k)
            part = pieces[k].at(np.clip(s[rows] - breaks[k], 0.0, pieces[k].length))
            found.pose[rows], found.first[rows], found.second[rows] = part.pose, part.first, part.second
        return found

    def at(self, s: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pose (…, 4, 4), [v; ω] (…, 6) and its derivative, by s instead of time, in base axes, at s (…)."""
        s = np.asarray(s, dtype=float)
        found = self.points(s.reshape(-1))
        return found.pose.reshape(*s.shape, 4, 4), found.first.reshape(*s.shape, 6), found.second.reshape(*s.shape, 6)

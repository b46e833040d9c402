"""Closed form of an arm, recognised from its axes in the zero pose."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from armwright.ik.closed_form.axes import JointAxes, Links, axes_of, links_of
from armwright.ik.closed_form.decomposition import (
    Shoulder,
    Turns,
    shoulder_of_meeting_first_and_second,
    shoulder_of_meeting_second_and_third,
    shoulder_of_parallel_first_and_second,
    shoulder_of_parallel_second_and_third,
    spherical_wrist,
    three_parallel,
)
from armwright.ik.closed_form.subproblems import Turn
from armwright.model import Model
from armwright.spatial import Placement

JOINTS = 6
# angles [rad], and lengths as a share of the arm's reach, within which axes count as parallel or meeting
TOLERANCE = 1e-9
NEARLY = 2e-3  # the same of an arm whose branches are polished: the 1.57 or 3.14 that some files have
TRIED, AGREE = 8, 1e-6  # positions at which a decomposition is tried before it is used; how near it must come
AGREE_NEARLY = 0.05  # [rad]
Solve = Callable[[Links, Placement, Sequence[Turn]], list[Turns]]


@dataclass(frozen=True, eq=False)
class Geometry:
    """An arm's closed form.

    Attributes:
        description: which axes meet and which are parallel, for people.   links: the frames that it works in.
        reversed: whether `links` run from the tip to the base.   solve: links, pose of their tip, angles for singular poses →
            branches of six turns.
    """

    description: str
    links: Links
    reversed: bool
    solve: Solve

    def positions(self, target: Placement, instead: Sequence[Turn]) -> list[Sequence[Turn]]:
        """Turns θ of all joints in the arm's order, for every branch.

        Args:
            target: of the arm's tip in its base, lengths in units of `links.length`.   instead: (6) where any turn does.
        """
        if not self.reversed:
            return [*self.solve(self.links, target, instead)]
        return [each[::-1] for each in self.solve(self.links, target.inverse(), instead[::-1])]

    @property
    def offsets(self) -> np.ndarray:
        """(6,) of θ = q + offset, in the arm's order."""
        return self.links.offsets[::-1] if self.reversed else self.links.offsets


def geometry_of(model: Model, frame: str | None = None, tolerance: float = TOLERANCE) -> Geometry | None:
    """The closed form of an arm for one of its frames; None if there is none.

    The first that fits, of: last three axes meet and axes 2 and 3 are parallel, 1 and 2 meet, 2 and 3 meet, 1 and 2 are
    parallel; axes 2, 3 and 4 are parallel and 5 and 6 meet; the same counted from the tip.

    Args:
        model: the arm.   frame: which of its frames; by default the tip.
        tolerance: angles [rad], and lengths as a share of the arm's reach, that count as 0.
    Raises:
        ModelError: no such frame.
    """
    target = model.frame(frame)
    if model.n != JOINTS or target.body != JOINTS - 1:
        return None
    length = sum(float(np.linalg.norm(body.placement.position)) for body in model.bodies) or 1.0
    axes = axes_of(model, frame, length)
    if axes is None:
        return None
    for backward in (False, True):
        for relations, ideal, solve in _decompositions(axes.reversed() if backward else axes, tolerance):
            geometry = Geometry(_described(relations, backward), links_of(ideal), backward, solve)
            if _holds(geometry, axes, AGREE if tolerance <= TOLERANCE else AGREE_NEARLY):
                return geometry
    return None


Relation = tuple[tuple[int, ...], str]  # axes, and what they do


def _described(relations: Sequence[Relation], backward: bool) -> str:
    """The relations of axes in words, counted from 1 at the base."""
    words = []
    for which, what in relations:
        numbers = [str(k) for k in sorted(JOINTS - k if backward else k + 1 for k in which)]
        words.append(f"axes {', '.join(numbers[:-1])} and {numbers[-1]} {what}")
    return ", ".join(words)


def _decompositions(axes: JointAxes, tolerance: float) -> Iterator[tuple[list[Relation], JointAxes, Solve]]:
    """Closed forms that an arm's axes allow, with the axes put exactly where they count as being."""
    centre, off = axes.meeting(3, 4, 5)
    if off <= tolerance:
        for relation, ideal, shoulder in _shoulders(axes.through(centre, 3, 4, 5), tolerance):
            yield [((3, 4, 5), MEET), relation], ideal, spherical_wrist(shoulder)
    direction, tilted = axes.parallel(1, 2, 3)
    point, off = axes.meeting(4, 5)
    if max(tilted, off) <= tolerance:
        ideal = axes.along(direction, 1, 2, 3).through(point, 4, 5)
        yield [((1, 2, 3), PARALLEL), ((4, 5), MEET)], ideal, three_parallel


def _shoulders(axes: JointAxes, tolerance: float) -> Iterator[tuple[Relation, JointAxes, Shoulder]]:
    """Closed forms for the first three axes, the cheapest first."""
    for which, what, shoulder in SHOULDERS:
        point, off = axes.meeting(*which) if what == MEET else axes.parallel(*which)
        if off <= tolerance:
            ideal = axes.through(point, *which) if what == MEET else axes.along(point, *which)
            yield (which, what), ideal, shoulder


MEET, PARALLEL = "meet", "are parallel"
SHOULDERS = (
    ((1, 2), PARALLEL, shoulder_of_parallel_second_and_third),
    ((0, 1), MEET, shoulder_of_meeting_first_and_second),
    ((1, 2), MEET, shoulder_of_meeting_second_and_third),
    ((0, 1), PARALLEL, shoulder_of_parallel_first_and_second),
)


def _holds(geometry: Geometry, axes: JointAxes, agree: float) -> bool:
    """True if the closed form finds the positions again that poses are of: an arm may be degenerate in yet other ways."""
    exact = links_of(axes)
    free = [Turn.by(0.0)] * JOINTS
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (TRIED, JOINTS)):
        branches = geometry.positions(_pose(exact, q), free)
        angles = np.array([[turn.angle for turn in turns] for turns in branches]) - geometry.offsets - q
        if not np.abs(np.sin(angles / 2.0)).max(axis=1).min() < agree:
            return False
    return True


def _pose(links: Links, q: np.ndarray) -> Placement:
    """Pose of the tip."""
    placed = links.placements[0]
    for angle, link in zip(q + links.offsets, links.placements[1:], strict=True):
        c, s = np.cos(angle), np.sin(angle)
        placed = placed @ Placement(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3)) @ link
    return placed

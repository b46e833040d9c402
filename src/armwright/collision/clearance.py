"""Clearance of an arm: distances between links and from obstacles, for thousands of poses at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from armwright import scalar
from armwright.collision.capsules import Capsule, base_link, link_capsules
from armwright.collision.distance import segment_to_segment
from armwright.collision.obstacles import Obstacle
from armwright.entry import AnyArm, as_arm
from armwright.errors import ModelError, ScenarioError, check_known
from armwright.kinematics.forward_kinematics import body_placements
from armwright.kinematics.reach import reach
from armwright.model import BASE, Model
from armwright.results.result import Result
from armwright.results.table import Table, number

SAMPLES = 2000  # of poses within the joint limits, to find links that always meet


@dataclass(frozen=True, eq=False)
class Nearest:
    """Least distance over poses, with the pair and the pose where it occurs.

    Attributes:
        distance: [m]; negative: they overlap.   pair: names of the two.   index: of the pose, in the batch as one row.
    """

    distance: float
    pair: tuple[str, str]
    index: int

    def __str__(self) -> str:
        return f"{self.pair[0]} and {self.pair[1]}: {1e3 * self.distance:.4g} mm"


class Clearance(Result):
    """Distances between an arm's links, and from them to obstacles, by capsules around the links; of `clearance`.

    Attributes:
        arm: the arm.   obstacles: what stands around it, in base axes.
        capsules: around its links, each in the frame of `forward_kinematics(arm, q, frame=capsule.link)`.
        pairs: names (link, link) or (link, obstacle), one for each distance.   ignored: pairs of links that are not looked at.
        least: [m] distance that planners keep.
    """

    def __init__(
        self,
        arm: Model,
        capsules: Sequence[Capsule],
        obstacles: Sequence[Obstacle],
        ignored: set[frozenset[str]],
        least: float = 0.0,
    ):
        self.arm, self.capsules, self.obstacles, self.ignored = arm, tuple(capsules), tuple(obstacles), ignored
        self.least = least
        meeting: dict[tuple[str, str], list[tuple[Any, Any]]] = {}
        for one, two in combinations(self.capsules, 2):
            if one.body != two.body and frozenset((one.link, two.link)) not in ignored:
                meeting.setdefault((one.link, two.link), []).append((one, two))
        for capsule in self.capsules:
            for obstacle in self.obstacles if capsule.body != BASE else ():
                meeting.setdefault((capsule.link, obstacle.name), []).append((capsule, obstacle))
        self._meeting = meeting
        self.pairs = tuple(meeting)

    def tables(self) -> list[Table]:
        """A row for each capsule: its link, radius and length."""
        rows = [[c.link, number(c.radius), number(np.linalg.norm(c.b - c.a))] for c in self.capsules]
        return [Table(f"{self.arm.name}: capsules", ("link", "radius [m]", "length [m]"), rows)]

    def __repr__(self) -> str:
        return f"Clearance({self.arm.name!r}, {len(self.capsules)} capsules, {len(self.pairs)} pairs)"

    def distances_at(self, q: Any) -> np.ndarray:
        """(pairs,) distances [m] at q (n,) [rad | m], numbers or symbols: what `distances` computes for many poses."""
        placed = body_placements(self.arm, q)
        within = {c.link: self.arm.frames[c.link].placement for c in self.capsules}  # link in body
        ends = {
            id(c): tuple(placed[c.body].point(within[c.link].point(end)) for end in (c.a, c.b)) for c in self.capsules
        }

        def distance(one: Capsule, two: Any) -> Any:
            if isinstance(two, Capsule):
                return segment_to_segment(*ends[id(one)], *ends[id(two)]) - one.radius - two.radius
            return two.distance(*ends[id(one)]) - one.radius

        least = []
        for couples in self._meeting.values():
            values = [distance(one, two) for one, two in couples]
            smallest = values[0]
            for value in values[1:]:
                smallest = scalar.minimum(smallest, value)
            least.append(smallest)
        return scalar.array(least)

    @cached_property
    def _kernel(self) -> Any:
        from armwright.kernels.batch import Kernel
        from armwright.kernels.target import select_target
        from armwright.program import trace

        program = trace("clearance", self.distances_at, {"q": (self.arm.n,)}, by_content=True)
        return Kernel(program, select_target(None))

    def distances(self, q: Any) -> np.ndarray:
        """Distances [m] of every pair (…, pairs) at positions q (…, n) [rad | m], in one compiled kernel.

        Negative where capsules overlap; by how much is right as long as their axes do not meet. Of a box it is the distance of
        the capsule's axis from it less the radius, so never less than -radius.

        Raises:
            ShapeError: arrays of another shape.   ScenarioError: positions that are not finite.
        """
        if not np.isfinite(scalar.real_numbers(q)).all():
            raise ScenarioError("is not finite", place="q", expected=f"positions (…, {self.arm.n}) [rad | m]")
        if not self.pairs:
            return np.full((*np.shape(q)[:-1], 0), np.inf)
        return self._kernel(q)

    def nearest(self, q: Any) -> Nearest:
        """The least distance over positions q (…, n) [rad | m].

        Raises:
            ScenarioError: nothing can meet, or there is no pose.
        """
        found = self.distances(q)
        distances = found.reshape(int(np.prod(found.shape[:-1])), len(self.pairs))
        if not distances.size:
            what = "has no poses" if self.pairs else "has no pair of links or obstacles that could meet"
            raise ScenarioError(what, place="q" if self.pairs else repr(self))
        row, pair = np.unravel_index(np.argmin(distances), distances.shape)
        return Nearest(float(distances[row, pair]), self.pairs[pair], int(row))


def clearance(
    arm: AnyArm,
    obstacles: Iterable[Any] = (),
    *,
    radius: float | Mapping[str, float] | None = None,
    ignore: Iterable[tuple[str, str]] = (),
    most: int = 3,
    least: float = 0.0,
) -> Clearance:
    """Distances between an arm's links, and from them to obstacles, as a function of its positions.

    Links are held in capsules (`link_capsules`), so that a distance is never larger than the true one between the record's
    shapes. Not looked at are links that are joined to each other, and pairs that overlap in each of 2000 poses drawn within
    the joint limits, since their shapes reach into each other by construction; `Clearance.ignored` lists both.

    Args:
        arm: the arm.   obstacles: `PlaneObstacle`, `BoxObstacle`, `SphereObstacle`, in base axes; the base itself may touch them.
        radius: [m] of links without shapes, one number or link → number.   ignore: further pairs of links.
        most: capsules of a link.   least: [m] distance that planners keep which are given this clearance.
    Returns:
        clearance: `distances(q)` and `nearest(q)` for positions q (…, n) [rad | m].
    Raises:
        ScenarioError: what is no obstacle, no distance.
        ModelError: a link without shapes and without radius, a radius with which all links always overlap, or a name that is no
            link.   RunError: a mesh that cannot be read.
    Example:
        >>> floor = aw.collision.PlaneObstacle((0, 0, -0.3), (0, 0, 1), name="floor")
        >>> near = aw.collision.clearance("puma560", [floor], radius=0.06)
        >>> print(near.nearest(np.zeros((1, 6))))
        link2 and link4: 31.42 mm
    """
    arm = as_arm(arm)
    obstacles = (obstacles,) if isinstance(obstacles, Obstacle) else tuple(obstacles)
    for obstacle in obstacles:
        if not isinstance(obstacle, Obstacle):
            expected = "a PlaneObstacle, BoxObstacle or SphereObstacle"
            raise ScenarioError(place="obstacles", value=obstacle, expected=expected)
    distance = scalar.real_number(least)
    if distance is None or not 0.0 <= distance < np.inf:
        raise ScenarioError(place="least", value=least, expected="a distance of 0 or more [m]")
    capsules = link_capsules(arm, radius, most)
    label = {BASE: base_link(arm)} | {i: body.link for i, body in enumerate(arm.bodies)}
    ignored = {frozenset((label[body.parent], body.link)) for body in arm.bodies}
    for pair in ignore:
        pair = tuple(label[BASE] if name == "base" else name for name in pair)  # whatever the record calls it
        for name in pair:
            check_known(ModelError, name, label.values(), place="ignore", expected="a link")
        ignored.add(frozenset(pair))
    alone = Clearance(arm, capsules, (), ignored)
    if alone.pairs:
        low, high = np.array([body.sampled_range for body in arm.coordinates]).T
        poses = np.random.default_rng(0).uniform(low, high, (SAMPLES, arm.n))
        always = np.max(alone.distances(poses), axis=0) < 0.0
        if radius is not None and always.all():
            pairs = f"none of their {len(alone.pairs)} pairs can be checked"
            what = f"with it all links overlap in each of {SAMPLES} poses, and {pairs}"
            given = max(capsule.radius for capsule in capsules)
            metres = f"metres, as {given / 1000.0:g}" if arm.tip is not None and given > reach(arm) else ""
            expected = metres or "a smaller radius, or these pairs in ignore"
            raise ModelError(what, place="radius", value=radius, expected=expected)
        ignored |= {frozenset(pair) for pair, meets in zip(alone.pairs, always.tolist(), strict=True) if meets}
    return Clearance(arm, capsules, obstacles, ignored, distance)

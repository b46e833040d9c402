"""Joint axes of an arm in its zero pose: where they meet, which are parallel, and frames along them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armwright.kinematics.forward_kinematics import body_placements
from armwright.model import Model
from armwright.spatial import Placement, snap

SNAP = 1e-12  # of lengths in units of the arm's; entries of rotations have the same in `spatial.snap`


@dataclass(frozen=True, eq=False)
class JointAxes:
    """Axes of an arm's joints at q = 0, in base axes, lengths in units of `length`.

    Attributes:
        directions: (n, 3) of unit length.   points: (n, 3), one on each axis.   tip: the frame that is brought to poses.
        length: [m], of about the arm's size.
    """

    directions: np.ndarray
    points: np.ndarray
    tip: Placement
    length: float

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.directions)

    def reversed(self) -> JointAxes:
        """The arm with tip and base exchanged: same joint positions, from the last joint to the first.

        T⁻¹ = T₀⁻¹ E_n⁻¹ … E_1⁻¹: axes in the tip's frame, pointing the other way.
        """
        back = self.tip.inverse()
        points = np.array([back.point(point) for point in self.points[::-1]])
        return replace(self, directions=-(self.directions[::-1] @ back.rotation.T), points=points, tip=back)

    def meeting(self, *which: int) -> tuple[np.ndarray, float]:
        """The point (3,) nearest to some axes, by least squares, and its distance from the farthest of them.

        Infinite for axes that are all parallel.
        """
        across = [np.eye(3) - np.outer(h, h) for h in self.directions[list(which)]]
        matrix = np.array(across).sum(axis=0)
        if np.linalg.eigvalsh(matrix)[0] < NEARLY_PARALLEL:
            return np.zeros(3), np.inf
        lines = list(zip(across, self.points[list(which)], strict=True))
        point = np.linalg.solve(matrix, np.sum([p @ c for p, c in lines], axis=0))
        return point, max(float(np.linalg.norm(p @ (point - c))) for p, c in lines)

    def parallel(self, *which: int) -> tuple[np.ndarray, float]:
        """The direction (3,) that axes have in common, whichever way they point, and the largest angle to it [rad]."""
        first = self.directions[which[0]]
        same = np.array([h * np.sign(h @ first) for h in self.directions[list(which)]])
        mean = same.sum(axis=0)
        mean = mean / (np.linalg.norm(mean) or 1.0)
        return mean, max(float(np.linalg.norm(np.cross(mean, h))) for h in same)

    def through(self, point: np.ndarray, *which: int) -> JointAxes:
        """The arm with axes moved to a point."""
        points = self.points.copy()
        points[list(which)] = point
        return replace(self, points=points)

    def along(self, direction: np.ndarray, *which: int) -> JointAxes:
        """The arm with axes turned along a direction or against it, whichever is nearer."""
        directions = self.directions.copy()
        for k in which:
            directions[k] = direction * np.sign(direction @ directions[k])
        return replace(self, directions=directions)


NEARLY_PARALLEL = 1e-6  # least eigenvalue of Σ (1 - h hᵀ), the square of an angle: such axes meet nowhere near


def axes_of(model: Model, frame: str | None, length: float) -> JointAxes | None:
    """Axes of an arm all of whose joints are revolute and carry a frame one after the other; None for other arms."""
    target = model.frame(frame)
    serial = model.path(target.body) == list(range(len(model.bodies))) and model.mimics is None
    if not serial or any(body.kind.slides for body in model.bodies):
        return None
    placed = body_placements(model, np.zeros(model.n))
    each = [placed[i] for i in range(model.n)]
    tip = each[-1] @ target.placement
    return JointAxes(
        np.array([p.rotation[:, 2] for p in each], dtype=float),
        np.array([p.position for p in each], dtype=float) / length,
        Placement(np.asarray(tip.rotation, dtype=float), np.asarray(tip.position, dtype=float) / length),
        length,
    )


@dataclass(frozen=True, eq=False)
class Links:
    """An arm as  T = L_0 Rz(θ_1) L_1 Rz(θ_2) … Rz(θ_n) L_n  with θ = q + offset. [DenavitHartenberg1955]

    x axes are along the common normal of the axis before, so that L_i turns about x only. Origins are the axes' points.

    Attributes:
        placements: L_0 … L_n, lengths in units of `length`.   offsets: (n,) [rad].   length: [m].
    """

    placements: tuple[Placement, ...]
    offsets: np.ndarray
    length: float


def links_of(axes: JointAxes) -> Links:
    """The frames along an arm's axes."""
    normals = [_normal(axes, i) for i in range(axes.n - 1)]
    before, after = [normals[0], *normals], [*normals, normals[-1]]
    offsets, frames_before, frames_after = [], [], []
    for h, c, x, next_x in zip(axes.directions, axes.points, before, after, strict=True):
        frames_before.append(Placement(np.column_stack([x, np.cross(h, x), h]), c))
        frames_after.append(Placement(np.column_stack([next_x, np.cross(h, next_x), h]), c))
        offsets.append(float(np.arctan2(np.cross(x, next_x) @ h, x @ next_x)))
    ends = zip([Placement.identity(), *frames_after], [*frames_before, axes.tip], strict=True)
    placements = tuple(_snapped(inner.inverse() @ outer) for inner, outer in ends)
    return Links(placements, np.array(offsets), axes.length)


def _normal(axes: JointAxes, i: int) -> np.ndarray:
    """Unit vector across axes i and i + 1: their common normal; of parallel axes, from the one to the other."""
    h, other = axes.directions[i], axes.directions[i + 1]
    normal = np.cross(h, other)
    if np.linalg.norm(normal) < SNAP:
        way = axes.points[i + 1] - axes.points[i]
        normal = way - h * (h @ way)
    if np.linalg.norm(normal) < SNAP:  # one axis
        normal = np.cross(h, np.eye(3)[np.argmin(np.abs(h))])
    normal = normal - h * (h @ normal)
    return normal / np.linalg.norm(normal)


def _snapped(placement: Placement) -> Placement:
    position = np.where(np.abs(placement.position) < SNAP, 0.0, placement.position)
    return Placement(snap(placement.rotation), position)

"""Figure of an arm that has no visuals: drums and blocks at its joints, bones between them, a ball at the tip."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from armwright.model import BASE, Model
from armwright.solids.surface import AROUND
from armwright.spatial import Placement, rotation_to_axis

if TYPE_CHECKING:
    import trimesh

GREY, JOINT, TIP = (0.78, 0.79, 0.81), (0.0, 0.447, 0.698), (0.835, 0.369, 0.0)
CYLINDER = (0.0, 0.62, 0.451)
ROD, BARREL = 0.25, 0.5  # radii of a cylinder's two pieces, in sizes of a bone
THICKNESS = 0.028  # of a bone, in lengths of the whole arm

# body, colour, mesh, where in the body's frame
Piece = tuple[int, tuple[float, float, float], "trimesh.Trimesh", Placement]


def joint_figure(arm: Model, travel: Mapping[int, tuple[float, float]]) -> Iterator[Piece]:
    """A drum at every turning joint, a block at every sliding one, bones between them and a ball at the tip.

    Args:
        arm: the arm.
        travel: body → the least and the greatest position [m] of its joint; a sliding joint has a rail from 0 to there.
    """
    from trimesh.creation import box, cylinder, icosphere

    def along_z(z: float) -> Placement:
        return Placement(np.eye(3), np.array([0.0, 0.0, z]))

    bones = [(body.parent, *_end(body.placement)) for body in arm.bodies]
    if arm.tip is not None:
        tip = arm.frame()
        bones.append((tip.body, *_end(tip.placement)))
    size = bone_size(arm)
    for body, end, axis in bones:
        for start, leg in _legs(end, axis):
            length = float(np.linalg.norm(leg))
            if length > 0.05 * size:
                bone = cylinder(radius=0.55 * size, height=length, sections=AROUND)
                yield body, GREY, bone, Placement(rotation_to_axis(leg), start + leg / 2)
                if start.any():
                    yield body, GREY, icosphere(subdivisions=3, radius=0.55 * size), Placement(np.eye(3), start)
    for k, body in enumerate(arm.bodies):
        turns = body.kind.turns
        drum = cylinder(radius=size, height=2.4 * size, sections=AROUND) if turns else box(extents=3 * [2.2 * size])
        yield k, JOINT, drum, Placement.identity()
        ways = [body.kind.motion(q)[1] for q in travel.get(k, (0.0, 0.0))]
        low, high = min(*ways, 0.0), max(*ways, 0.0)
        if high - low > 0.05 * size:
            rail = cylinder(radius=0.4 * size, height=high - low, sections=AROUND)
            yield body.parent, GREY, rail, body.placement @ along_z(0.5 * (low + high))
    yield BASE, GREY, cylinder(radius=2.2 * size, height=0.5 * size, sections=AROUND), along_z(-0.25 * size)
    if arm.tip is not None:
        body, end, _ = bones[-1]
        yield body, TIP, icosphere(subdivisions=2, radius=0.8 * size), Placement(np.eye(3), end)


def bone_size(arm: Model) -> float:
    """Scale of a figure's pieces [m]: a share of the total length of the arm's bones."""
    placements = [body.placement for body in arm.bodies] + ([arm.frame().placement] if arm.tip is not None else [])
    return THICKNESS * (sum(float(np.linalg.norm(np.asarray(at.position, dtype=float))) for at in placements) or 1.0)


def cylinder_figures(arm: Model, placed: Mapping[int, Placement]) -> Iterator[Piece]:
    """A rod between the two ends of every spring cylinder, and a barrel about its first half, in one pose, in the base's frame.

    Args:
        arm: the arm.   placed: body → where it stands in the base.
    """
    from trimesh.creation import cylinder

    size = bone_size(arm)
    for spring in arm.cylinders:
        start, end = (placed[body].point(point) for body, point in zip(spring.bodies, spring.ends, strict=True))
        turn = Placement(rotation_to_axis(end - start), start)
        for radius, share in ((ROD, 1.0), (BARREL, 0.5)):
            length = share * float(np.linalg.norm(end - start))
            piece = cylinder(radius=radius * size, height=length, sections=AROUND)
            yield BASE, CYLINDER, piece, turn @ Placement(np.eye(3), np.array([0.0, 0.0, 0.5 * length]))


def _end(at: Placement) -> tuple[np.ndarray, np.ndarray]:
    """End of a bone (3,) [m], and the direction of the axis there (3,)."""
    return np.asarray(at.position, dtype=float), np.asarray(at.rotation, dtype=float)[:, 2]


def _legs(end: np.ndarray, axis: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """A bone's two legs, each a start and a vector (3,) [m]: along one joint's axis, then along the common normal.

    The axis is that at the near end (z, as classic Denavit-Hartenberg rows go) or that at the far end (as modified rows go),
    whichever leaves a leg that is normal to both.
    """
    near = np.array([0.0, 0.0, end[2]])
    far = (end @ axis) * axis
    if abs((end - near) @ axis) <= abs(end[2] - far[2]):
        return [(np.zeros(3), near), (near, end - near)]
    return [(np.zeros(3), end - far), (end - far, far)]

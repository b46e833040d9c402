"""Arm in one pose: the shapes and placements of its bodies, from which a picture or a scene file is made."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.entry import as_arm
from armwright.errors import Problem, RunError, ShapeError
from armwright.kinematics.forward_kinematics import body_placements
from armwright.model import Model
from armwright.pictures.body_shapes import Shape, body_shapes
from armwright.pictures.joint_figure import cylinder_figures
from armwright.pictures.render import Surfaces
from armwright.spatial import Placement, rotation_to_axis


@dataclass(frozen=True, eq=False)
class PosedArm:
    """An arm in one pose.

    Attributes:
        arm: the arm.   q: (bodies,) [rad | m] of every body, mimicking ones included.
        shapes: of each body (BASE: what does not move), in its own frame.
        placements: of each body in the base.   notes: visuals that are drawn in another way than the record has them.
    """

    arm: Model
    q: np.ndarray
    shapes: dict[int, list[Shape]]
    placements: dict[int, Placement]
    notes: tuple[Problem, ...]

    def surfaces(self) -> Surfaces:
        """All triangles in base axes that were turned by `upright`: z points up, against gravity."""
        corners, normals, colours, bodies = [], [], [], []
        stand = upright(self.arm)
        for body, shapes in self.shapes.items():
            at = self.placements[body]
            turn, position = stand @ at.rotation, stand @ at.position
            for shape in shapes:
                corners.append((shape.positions @ turn.T + position)[shape.triangles])
                normals.append((shape.normals @ turn.T)[shape.triangles])
                colours.append(np.tile(shape.colour, (len(shape.triangles), 1)))
                bodies.append(np.full(len(shape.triangles), body))
        return Surfaces(*(np.concatenate(parts) for parts in (corners, normals, colours, bodies)))


def upright(arm: Model) -> np.ndarray:
    """(3, 3) the shortest rotation after which gravity points along -z; none without gravity, half a turn about x from +z."""
    gravity = np.asarray(arm.gravity, dtype=float)
    return rotation_to_axis(-gravity).T if gravity.any() else np.eye(3)


def posed_arm(arm: Model, q: Any = None) -> PosedArm:
    """The arm at q (n,) [rad | m], by default 0, and its cylinders; as a stick figure if a mesh cannot be read.

    Raises:
        ModelError: it is no arm.   ShapeError: q is no pose of it.
    """
    arm = as_arm(arm)
    pose = checked_pose(arm, np.zeros(arm.n) if q is None else q)
    moved = pose if arm.mimics is None else arm.mimics.positions(pose)
    travel = {k: (float(position), float(position)) for k, position in enumerate(moved)}
    placed = body_placements(arm, pose)
    try:
        shapes, notes = body_shapes(arm, travel, cylinder_figures(arm, placed))
    except RunError as error:  # a mesh that is missing, or of a format that needs more than is installed
        shapes, _ = body_shapes(replace(arm, description=None), travel, cylinder_figures(arm, placed))
        first = error.problems[0]
        notes = (replace(first, what=f"{first.what}; drawn as a figure of its joints instead"),)
    return PosedArm(arm, moved, shapes, placed, notes)


def checked_pose(arm: Model, q: Any) -> np.ndarray:
    """(n,) [rad | m] the joints' positions as numbers.

    Raises:
        ShapeError: q is no pose of the arm.
    """
    pose = scalar.numbers_or_nan(q)
    if pose.shape != (arm.n,) or not np.isfinite(pose).all():
        expected = f"{arm.n} finite numbers, one for each joint of {arm.name}"
        raise ShapeError(place="q", value=q, expected=expected)
    return pose

"""An arm in one pose, as triangles in base axes: what a picture and a scene file are made of."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.errors import RunError, ShapeError
from armwright.kinematics import body_placements
from armwright.model import BASE, Model, check_arm
from armwright.pictures.render import Surfaces
from armwright.pictures.scene import Shape, body_shapes
from armwright.spatial import Placement


@dataclass(frozen=True, eq=False)
class Still:
    """An arm in one pose.

    Attributes:
        arm: the arm.   shapes: of each body (BASE: what stands still), in its own frame.
        placements: of each body in the base.   notes: what could not be drawn as the record has it.
    """

    arm: Model
    shapes: dict[int, list[Shape]]
    placements: dict[int, Placement]
    notes: tuple[str, ...]

    def surfaces(self) -> Surfaces:
        """All triangles in base axes."""
        corners, normals, colours, bodies = [], [], [], []
        for body, shapes in self.shapes.items():
            at = self.placements[body]
            for shape in shapes:
                corners.append((shape.positions @ at.rotation.T + at.position)[shape.triangles])
                normals.append((shape.normals @ at.rotation.T)[shape.triangles])
                colours.append(np.tile(shape.colour, (len(shape.triangles), 1)))
                bodies.append(np.full(len(shape.triangles), body))
        return Surfaces(*(np.concatenate(parts) for parts in (corners, normals, colours, bodies)))


def still(arm: Model, q: Any = None) -> Still:
    """The arm at q (n,) [rad | m], by default 0; as a figure of its joints where a mesh of it cannot be read.

    Raises:
        ModelError: it is no arm.   ShapeError: q is no pose of it.
    """
    check_arm(arm)
    pose = np.zeros(arm.n) if q is None else np.asarray(q, dtype=float)
    if pose.shape != (arm.n,) or not np.isfinite(pose).all():
        expected = f"{arm.n} finite numbers, one for each joint of {arm.name}"
        raise ShapeError(f"show: q has shape {pose.shape} or is not finite; expected {expected}")
    moved = pose if arm.mimics is None else arm.mimics.positions(pose)
    travel = {k: (float(position), float(position)) for k, position in enumerate(moved)}
    try:
        shapes, notes = body_shapes(arm, travel)
    except RunError as error:  # a mesh that is missing, or of a format that needs more than is installed
        shapes, _ = body_shapes(dataclasses.replace(arm, description=None), travel)
        notes = (f"{error}; drawn as a figure of its joints instead",)
    return Still(arm, shapes, body_placements(arm, pose), notes)


def node_name(arm: Model, body: int) -> str:
    """What a body's node is called in a scene file: as its link."""
    if body != BASE:
        return arm.bodies[body].link
    return "base" if arm.description is None else arm.description.base

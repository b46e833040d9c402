"""Jacobian of the tip or of another frame."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.kinematics.forward_kinematics import body_placements
from armwright.model import Mimics, Model, on_tree, one_state
from armwright.scalar import Array
from armwright.spatial import cross


@one_state
@on_tree(Mimics.columns)
def jacobian(arm: Model, q: Array, frame: str | None = None) -> np.ndarray:
    """Geometric Jacobian of the tip or of another frame:  [v; ω] = J(q) q̇.  [Whitney1972]

    Column of a revolute joint: [z × (p - o); z], of a prismatic one: [z; 0], with z the joint's axis and o its origin.

    Args:
        arm: the model.   q: (n,) [rad | m].   frame: name of a frame of the arm; by default its tip.
    Returns:
        J: (6, n) linear rows first, of the frame's origin, in base axes; [m/rad | -] and [- | 1/m].
    Raises:
        ModelError: no such frame, or the arm branches and names no tip.
    """
    tip = arm.frame(frame)
    placed = body_placements(arm, q)
    p = placed[tip.body].point(tip.placement.position)
    columns = scalar.zeros(6, arm.n)
    for i in arm.path(tip.body):
        z, o = placed[i].rotation[:, 2], placed[i].position
        if arm.bodies[i].kind == "revolute":
            columns[:3, i], columns[3:, i] = cross(z, p - o), z
        else:
            columns[:3, i] = z
    return scalar.array(columns)

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

    Column of a joint: t [z × (p - o); z] + s [z; 0], with z the joint's axis, o its origin, and t, s its share of turn and slide:
    1, 0 of a revolute joint, 0, 1 of a prismatic one, 1 and its pitch of a helical one.

    Args:
        arm: the model.   q: (n,) [rad | m].   frame: name of a frame of the arm; by default its tip.
    Returns:
        J: (6, n) linear rows first, of the frame's origin, in base axes; [m/rad | -] and [- | 1/m].
    Raises:
        ModelError: no such frame, or the arm branches and names no tip.
    Example:
        >>> arm = aw.load("two-link")
        >>> (aw.jacobian(arm, [0.3, 0.5])[:3] @ [1.0, -0.5]).round(3)  # speed of the tip
        array([-0.582,  1.234,  0.   ])
    """
    tip = arm.frame(frame)
    placed = body_placements(arm, q)
    p = placed[tip.body].point(tip.placement.position)
    columns = scalar.zeros(6, arm.n)
    for i in arm.path(tip.body):
        z, o = placed[i].rotation[:, 2], placed[i].position
        columns[:3, i] = arm.bodies[i].kind.project(cross(z, p - o), z)
        if arm.bodies[i].kind.turns:
            columns[3:, i] = z
    return scalar.array(columns)

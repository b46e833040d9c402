"""Placements of the arm's bodies and frames in the base."""

from __future__ import annotations

import numpy as np

from armwright.kinematics.joint_motion import joint_motions
from armwright.model import BASE, Model, on_tree, one_state
from armwright.scalar import Array
from armwright.spatial import Placement


@on_tree()
def body_placements(arm: Model, q: Array) -> dict[int, Placement]:
    """Placement of every body's frame in the base at q (n,) [rad | m]; BASE is the identity."""
    placed = {BASE: Placement.identity()}
    for (i, body), motion in zip(arm.outward(), joint_motions(arm, q), strict=True):
        placed[i] = placed[body.parent] @ motion.placement()
    return placed


@on_tree()
def frame_placement(arm: Model, q: Array, frame: str | None = None) -> Placement:
    """Placement in the base of a named frame, by default the tip; only the joints that carry it are computed."""
    target = arm.frame(frame)
    motions = joint_motions(arm, q)
    placed = Placement.identity()
    for i in arm.path(target.body):
        placed = placed @ motions[i].placement()
    return placed @ target.placement


@one_state
def forward_kinematics(arm: Model, q: Array, frame: str | None = None) -> np.ndarray:
    """Pose of the tip or of another frame:  T = A_0^1 A_1^2 … A_{N-1}^N.  [DenavitHartenberg1955]

    Args:
        arm: the model.   q: (n,) [rad | m].   frame: name of a frame of the arm; by default its tip.
    Returns:
        T: (4, 4) homogeneous transform, the frame's coordinates to base coordinates; [-] and [m].
    Raises:
        ModelError: no such frame, or the arm branches and names no tip.
    Example:
        >>> arm = aw.load("two-link")
        >>> aw.forward_kinematics(arm, [0.3, 0.5])[:3, 3].round(3)  # where the tip is
        array([1.513, 0.869, 0.   ])
    """
    return frame_placement(arm, q, frame).matrix()

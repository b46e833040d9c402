"""Acceleration of a frame while no joint accelerates."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.kinematics.joint_motion import joint_motions, origin_acceleration, turning
from armwright.model import Model, on_tree, one_state
from armwright.scalar import Array
from armwright.spatial import acceleration_tensor


@one_state
@on_tree()
def jacobian_dot_qd(arm: Model, q: Array, qd: Array, frame: str | None = None) -> np.ndarray:
    """Acceleration of the tip or of another frame at q̈ = 0:  [v̇; ω̇] = J q̈ + J̇ q̇.  [LuhWalkerPaul1980]

    The outward half of Newton and Euler's recursion, (1), (2) and (4) of the CMU report, without gravity; then back
    into base axes.

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        frame: name of a frame of the arm; by default its tip.
    Returns:
        a: (6,) linear rows first, of the frame's origin, in base axes; [m/s²] and [rad/s²].
    Raises:
        ModelError: no such frame, or the arm branches and names no tip.
    Example:
        >>> arm = aw.load("two-link")
        >>> aw.jacobian_dot_qd(arm, [0.3, 0.5], [1.0, -0.5])[:3].round(3)
        array([-1.095, -0.439,  0.   ])
    """
    target, motion = arm.frame(frame), joint_motions(arm, q)
    path = arm.path(target.body)
    w, wd, vd, u = scalar.zeros(3), scalar.zeros(3), scalar.zeros(3), scalar.zeros(3, 3)
    for i in path:
        body = arm.bodies[i]
        w, wd = turning(body, motion[i], w, wd, qd[i], 0.0)  # (1) (2)
        vd = origin_acceleration(body, motion[i], w, vd, u, qd[i], 0.0)  # (4)
        u = acceleration_tensor(w, wd)
    vd = vd + u @ target.placement.position
    for i in reversed(path):
        vd, wd = motion[i].to_parent(vd), motion[i].to_parent(wd)
    return scalar.array([*vd, *wd])

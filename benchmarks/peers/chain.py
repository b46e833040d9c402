"""A chain for the peers: placement of each joint in the one before."""

from __future__ import annotations

import numpy as np

from armwright.model import Model
from armwright.spatial import rotation_z


def joint_places(arm: Model) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rotation (3, 3) and position (3,) [m] of every joint's frame at q = 0 in its parent's; joints act along z.

    Raises:
        ValueError: the arm branches.
    """
    for i, body in enumerate(arm.bodies):
        if body.parent != i - 1:
            raise ValueError(f"{arm.name}: body {i} hangs on {body.parent}; the peers here take chains only")
    return [
        (
            np.array(body.placement.rotation, dtype=float) @ np.array(rotation_z(float(body.offset)), dtype=float),
            np.array(body.placement.position, dtype=float),
        )
        for body in arm.bodies
    ]

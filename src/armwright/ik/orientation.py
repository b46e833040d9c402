"""Error of a part of an orientation: pitch, yaw, and the twist about one axis, each with its exact slope."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.kinematics.aim import Aim, horizontal_normal, yaw_row
from armwright.scalar import Array, Scalar

LEAST = 1e-6  # of 1 + G_kk, 0 where a twist is undefined


def partial_turn(aim: Aim, rotation: Array, target: Array) -> tuple[np.ndarray, np.ndarray]:
    """Error (m,) [rad] of pitch, yaw or twist, and rows (m, 3): a small turn φ of the frame, in base axes, leaves e - rows φ.

    Args:
        aim: what counts.   rotation, target: (3, 3) of the frame and of its target.
    """
    if aim.kind == "pitch":
        return _pitch(rotation[:, aim.axis], target[:, aim.axis])
    if aim.kind == "yaw":
        x, y, _ = direction = rotation[:, aim.axis]
        u, v, _ = target[:, aim.axis]
        return scalar.array([scalar.atan2(x * v - y * u, x * u + y * v)]), scalar.stack([yaw_row(direction)])
    turn = target @ rotation.T if aim.base else target.T @ rotation
    angle, row = twist(turn, aim.axis)
    return scalar.array([angle if aim.base else -angle]), scalar.stack([row if aim.base else rotation @ row])


def twist(turn: Array, k: int) -> tuple[Scalar, np.ndarray]:
    """Twist τ [rad] of a rotation G (3, 3) about axis k and its slope (3,).

    With i, j, k cyclic:  τ = atan2(G_ji - G_ij, G_ii + G_jj),  0 where the rotation's axis has no component along k.
    A turn by φ about G's axes from the right changes it by  row · φ,
    row_k = 1,  row_i = -(cos τ G_ik + sin τ G_jk) / (1 + G_kk),  row_j = -(cos τ G_jk - sin τ G_ik) / (1 + G_kk).
    """
    i, j = (k + 1) % 3, (k + 2) % 3
    angle = scalar.atan2(turn[j, i] - turn[i, j], turn[i, i] + turn[j, j])
    c, s = scalar.cos(angle), scalar.sin(angle)
    scale = 1.0 / scalar.maximum(1.0 + turn[k, k], LEAST)
    row = [1.0, 1.0, 1.0]
    row[i] = -(c * turn[i, k] + s * turn[j, k]) * scale
    row[j] = -(c * turn[j, k] - s * turn[i, k]) * scale
    return angle, scalar.array(row)


def polar_angle(direction: Array) -> Scalar:
    """Angle [rad] of a direction (3,) from base z, to all digits at both ends."""
    x, y, z = direction
    return scalar.atan2(scalar.sqrt(x * x + y * y), z)


def _pitch(direction: Array, wanted: Array) -> tuple[np.ndarray, np.ndarray]:
    """Error of the angle to base z.

    A second row, of error 0, keeps the direction from moving sideways: near a vertical target the error is the length of
    a vector of two components, and Newton's method needs both; elsewhere its weight, |e| / sin θ, goes to 0 with the error.
    """
    off = polar_angle(wanted) - polar_angle(direction)
    normal = horizontal_normal(direction)
    x, y, z = direction
    across = scalar.array([y * normal[2] - z * normal[1], z * normal[0] - x * normal[2], x * normal[1] - y * normal[0]])
    share = scalar.abs(off) / scalar.maximum(scalar.sqrt(x * x + y * y), 1e-300)
    return scalar.array([off, 0.0]), scalar.stack([normal, across * scalar.minimum(share, 1.0)])

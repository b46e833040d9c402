"""Part of an orientation along a path: its error, what it asks of the joint rates, and of their change.

An error r(R, R*) that is smooth where it is 0, of the frame's rotation R and its target R*, both functions of the way s:

    r' = 0:  A w_R = b   and   r'' = 0:  A w_R' = c,    with [w_R] = R' Rᵀ,  A = -∂r/∂w_R,

b the share of the target's motion and c all of r'' but that of w_R'. r is a polynomial or a quotient of those, so that both
derivatives are exact, by algorithmic differentiation.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from armwright import scalar
from armwright.kernels.batch import Kernel
from armwright.kernels.target import select_target
from armwright.kinematics.aim import Aim
from armwright.program import trace
from armwright.scalar import Array, Scalar
from armwright.spatial.rotation import skew

UPRIGHT = 1e-6  # sine of the angle to base z below which a direction is taken for vertical
LEAST = 1e-9  # of a divisor that is 0 half a turn from the target


def smooth_error(aim: Aim, rotation: Array, target: Array, at: Array) -> np.ndarray:
    """Error (m,) [rad] of a part of an orientation, to first order where it is small.

    Args:
        aim: an axis, pitch, yaw or twist.   rotation, target: (3, 3).
        at: (3, 3) the target in the point about which both move, a constant.
    Returns:
        r: (m,) two numbers of an axis and of pitch, one of yaw and twist; the second of pitch counts only of vertical axes.
    """
    k = aim.axis
    if aim.kind in ("axis", "twist"):
        turn = target @ rotation.T if aim.base else target.T @ rotation
        if aim.kind == "axis":
            return scalar.array([turn[i, k] for i in aim.others])
        i, j = (k + 1) % 3, (k + 2) % 3
        return scalar.array([(turn[j, i] - turn[i, j]) / _nonzero(turn[i, i] + turn[j, j])])
    x, y, z = rotation[:, k]
    u, v, w = target[:, k]
    if aim.kind == "yaw":
        return scalar.array([(x * v - y * u) / _nonzero(x * u + y * v)])
    sine = scalar.sqrt(at[0, k] * at[0, k] + at[1, k] * at[1, k])
    upright = scalar.less(sine, UPRIGHT)
    height = (z - w) / scalar.maximum(sine, UPRIGHT)
    return scalar.array([scalar.where(upright, u - x, height), scalar.where(upright, v - y, 0.0)])


@lru_cache(maxsize=32)
def turning(aim: Aim) -> Kernel:
    """Compiled  R, w_R, w_R' of the resting joint rates, R*, w*, w*'  →  r (m,), A (m, 3), b (m,), c (m,)."""

    def every(
        rotation: Array, w: Array, dw: Array, target: Array, target_w: Array, target_dw: Array
    ) -> tuple[np.ndarray, ...]:
        def error(turn: Array, step: Scalar) -> np.ndarray:
            moved = (np.eye(3) + skew(turn)) @ rotation
            return smooth_error(aim, moved, _further(target, target_w, target_dw, step), target)

        def along(step: Scalar) -> np.ndarray:
            ends = _further(rotation, w, dw, step), _further(target, target_w, target_dw, step)
            return smooth_error(aim, *ends, target)

        slope = scalar.jacobian(lambda x: error(x[:3], x[3]), np.zeros(4))

        def change(x: Array) -> np.ndarray:
            return scalar.jacobian(lambda y: along(y[0]), x)[:, 0]

        second = scalar.jacobian(change, np.zeros(1))[:, 0]
        return error(np.zeros(3), 0.0), -slope[:, :3], slope[:, 3], second

    shapes = {"rotation": (3, 3), "w": (3,), "dw": (3,), "target": (3, 3), "target_w": (3,), "target_dw": (3,)}
    return Kernel(trace("turning", every, shapes, ("error", "rows", "asked", "change")), select_target())


def _further(rotation: Array, w: Array, dw: Array, step: Scalar) -> np.ndarray:
    """A rotation a step further on, to second order:  (1 + h [w] + h²/2 ([w'] + [w]²)) R."""
    rate = skew(w)
    return rotation + (step * rate + (0.5 * step * step) * (skew(dw) + rate @ rate)) @ rotation


def _nonzero(value: Scalar) -> Scalar:
    """A divisor away from 0."""
    return scalar.where(scalar.less(scalar.abs(value), LEAST), LEAST, value)

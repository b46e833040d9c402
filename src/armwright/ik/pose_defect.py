"""Deviation of (k, 4, 4) arrays from poses, in native code: NumPy would take longer than the arm's closed form."""

from __future__ import annotations

from functools import cache

import numpy as np

from armwright import scalar
from armwright.kernels.batch import Kernel
from armwright.kernels.target import select_target
from armwright.program import trace
from armwright.scalar import Array

LARGEST = 1e100  # [m] of a position: squares stay within the range of floats
NO_POSE = 2.0  # of mirrors and infinite positions


def pose_defects(poses: np.ndarray) -> np.ndarray:
    """Largest entry (k,) of  Rᵀ R - 1  and of what the last row of poses (k, 4, 4) is off; 2 or more, or NaN, of no poses."""
    return _kernel()(poses)


def pose_defect(pose: Array) -> np.ndarray:
    """The defect () of one pose (4, 4)."""
    rotation, last = pose[:3, :3], pose[3]
    gram = rotation.T @ rotation - np.eye(3)
    most = 0.0
    for entry in (*gram.reshape(-1), *last[:3], last[3] - 1.0):
        most = scalar.maximum(most, scalar.abs(entry))
    x, y, z = rotation.T
    volume = x[0] * (y[1] * z[2] - y[2] * z[1]) - x[1] * (y[0] * z[2] - y[2] * z[0])
    volume = volume + x[2] * (y[0] * z[1] - y[1] * z[0])
    finite = 1.0
    for entry in pose[:3, 3]:
        finite = finite * scalar.less(scalar.abs(entry), LARGEST)  # 0 of NaN too
    return scalar.array(scalar.where(finite * scalar.less(0.0, volume), most, scalar.maximum(most, NO_POSE)))


@cache
def _kernel() -> Kernel:
    return Kernel(trace("pose_defect", pose_defect, {"pose": (4, 4)}), select_target())

"""Rotation matrices (3, 3): R_ab takes coordinates in frame b to coordinates in frame a."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.scalar import Array, Scalar

SNAP = 1e-12  # an entry this near 0, 1 or -1 is meant to be it: cos(π/2) is 6e-17 in floats, and 0 folds away


def cross(a: Array, b: Array) -> np.ndarray:
    """a × b of two (3,) vectors."""
    return scalar.array(
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    )


def skew(a: Array) -> np.ndarray:
    """The (3, 3) matrix of  b ↦ a × b."""
    return scalar.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def snap(value: Array) -> Array:
    """Numbers within `SNAP` of 0, 1 and -1 replaced by them; a traced matrix is left as it is."""
    if scalar.is_symbolic(value):
        return value
    value = np.asarray(value, dtype=float)
    whole = np.rint(value)
    near = (np.abs(value - whole) <= SNAP) & (np.abs(whole) <= 1.0)
    return np.choose(near, [value, whole + 0.0])


def rotation_x(angle: Scalar) -> np.ndarray:
    """Rotation by an angle [rad] about x."""
    c, s = scalar.cos(angle), scalar.sin(angle)
    return snap(scalar.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]))


def rotation_y(angle: Scalar) -> np.ndarray:
    """Rotation by an angle [rad] about y."""
    c, s = scalar.cos(angle), scalar.sin(angle)
    return snap(scalar.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]))


def rotation_z(angle: Scalar) -> np.ndarray:
    """Rotation by an angle [rad] about z."""
    c, s = scalar.cos(angle), scalar.sin(angle)
    return snap(scalar.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


def rotation_rpy(roll: Scalar, pitch: Scalar, yaw: Scalar) -> np.ndarray:
    """Rz(yaw) Ry(pitch) Rx(roll), the fixed-axis angles [rad] of a URDF."""
    return snap(rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll))


def rotation_to_axis(axis: Array) -> np.ndarray:
    """A rotation whose z axis has the given direction (3,): the frame in which a joint about `axis` turns about z.

    Of the many, the one that turns least; -z is reached by half a turn about x.
    """
    axis = np.asarray(axis, dtype=float)
    axis = axis / np.abs(axis).max()  # first, or the squares of 1e200 overflow and those of 1e-200 vanish
    x, y, z = axis / scalar.sqrt(float(axis @ axis))
    if z < -1.0 + SNAP:
        return np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    k = 1.0 / (1.0 + z)
    return snap(np.array([[1.0 - k * x * x, -k * x * y, x], [-k * x * y, 1.0 - k * y * y, y], [-x, -y, z]]))

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
    """Numbers within `SNAP` of 0, 1 and -1 replaced by them; symbols are left as they are."""
    if scalar.is_symbolic(value):
        entries = [v if scalar.is_symbolic(v) else float(snap(np.asarray(v))) for v in value.flat]
        return scalar.array(entries).reshape(value.shape)
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


def rotated(rotation: Array, vector: Array) -> np.ndarray:
    """R v (3,), each entry summed in order: `@` on transposed matrices has other last bits on other processors."""
    return scalar.array((np.asarray(rotation) * vector).sum(axis=1))


def rotation_rpy(roll: Scalar, pitch: Scalar, yaw: Scalar) -> np.ndarray:
    """Rz(yaw) Ry(pitch) Rx(roll), the fixed-axis angles [rad] of a URDF."""
    return snap(rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll))


def rpy_angles(rotation: Array) -> np.ndarray:
    """Roll, pitch, yaw (3,) [rad] of a rotation, the inverse of `rotation_rpy`; where pitch is ±π/2, yaw is 0."""
    yaw = scalar.atan2(rotation[1, 0], rotation[0, 0])
    pitch = scalar.atan2(-rotation[2, 0], scalar.hypot(rotation[0, 0], rotation[1, 0]))
    c, s = scalar.cos(yaw), scalar.sin(yaw)  # what is left without yaw tells roll, even where pitch hides it
    roll = scalar.atan2(s * rotation[0, 2] - c * rotation[1, 2], c * rotation[1, 1] - s * rotation[0, 1])
    return scalar.array([roll, pitch, yaw])


def rotation_to_axis(axis: Array) -> np.ndarray:
    """A rotation whose z axis has the given direction (3,): the frame in which a joint about `axis` turns about z.

    Of the many, the one that turns least; -z is reached by half a turn about x.
    """
    if scalar.is_symbolic(axis):
        return _to_varied_axis(axis)
    axis = np.asarray(axis, dtype=float)
    axis = axis / np.abs(axis).max()  # first, or the squares of 1e200 overflow and those of 1e-200 vanish
    x, y, z = axis / scalar.sqrt(float((axis * axis).sum()))
    if z < -1.0 + SNAP:
        return np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    k = 1.0 / (1.0 + z)
    return snap(np.array([[1.0 - k * x * x, -k * x * y, x], [-k * x * y, 1.0 - k * y * y, y], [-x, -y, z]]))


def _to_varied_axis(axis: Array) -> np.ndarray:
    """`rotation_to_axis` for a direction that holds symbols, both of its cases computed."""
    x, y, z = axis / scalar.sqrt(axis @ axis)
    below = scalar.less(z, -1.0 + SNAP)
    k = 1.0 / scalar.where(below, 1.0, 1.0 + z)
    turned = scalar.array([[1.0 - k * x * x, -k * x * y, x], [-k * x * y, 1.0 - k * y * y, y], [-x, -y, z]])
    return scalar.where(below, np.diag([1.0, -1.0, -1.0]), turned)


def roll_pitch_yaw(rotation: Array) -> tuple[float, float, float]:
    """Angles [rad] of which `rotation_rpy` makes this rotation again, to rounding even where two of them are one.

    The yaw is taken first; roll and pitch are those of the rotation without the yaw.
    """
    r = np.asarray(rotation, dtype=float)
    yaw = float(scalar.atan2(r[1, 0], r[0, 0]))
    c, s = float(scalar.cos(yaw)), float(scalar.sin(yaw))
    pitch = float(scalar.atan2(-r[2, 0], c * r[0, 0] + s * r[1, 0]))
    roll = float(scalar.atan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1]))
    return roll, pitch, yaw


def rotation_quaternion(rotation: Array) -> np.ndarray:
    """The unit quaternion (w, x, y, z) of a rotation, by its largest entry, which loses no digits. [Shepperd1978]"""
    r = np.asarray(rotation, dtype=float)
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    i = max((0, 1, 2), key=lambda k: float(r[k, k]))
    if trace > r[i, i]:
        q = np.array([1.0 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q = np.array([r[k, j] - r[j, k], 0.0, 0.0, 0.0])
        q[1 + i], q[1 + j], q[1 + k] = 1.0 + 2.0 * r[i, i] - trace, r[j, i] + r[i, j], r[k, i] + r[i, k]
    return q / scalar.sqrt(float((q * q).sum()))

"""Targets of inverse kinematics as users hand them in: poses or positions, checked before anything is solved."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.errors import ModelError, ShapeError, check_known
from armwright.ik.pose_defect import LARGEST, pose_defects
from armwright.kinematics.aim import AXES, POSE, POSITION, VERTICAL, Aim
from armwright.parameters import Batch
from armwright.scalar import real_numbers

ORTHOGONAL = 1e-6  # of the entries of Rᵀ R - 1


def checked_array(value: Any, place: str) -> np.ndarray:
    """An array of real numbers.

    Raises:
        ShapeError: the value is none; names the place.
    """
    if isinstance(value, Batch):
        raise ShapeError("a Batch", place=place, expected="an array; its leading axes are the batch")
    try:
        return real_numbers(value)
    except ValueError as error:
        # NumPy's sentence is a paragraph
        what = "rows of unequal length" if "inhomogeneous" in str(error) else str(error)
        raise ShapeError(what, place=place, expected="an array of real numbers") from None


def checked_targets(targets: Any, aim: str | Aim | None) -> tuple[np.ndarray, tuple[int, ...], Aim]:
    """Targets as poses (k, 4, 4), the shape of their batch, and what of them counts.

    Raises:
        ShapeError, ModelError: what is no pose; names the first.
    """
    array = checked_array(targets, "targets")
    aim = None if aim is None else Aim.of(aim)
    if array.shape[-2:] == (4, 4):
        shape, poses = array.shape[:-2], array.reshape(-1, 4, 4)
        wrong = np.flatnonzero(~(pose_defects(poses) < ORTHOGONAL))  # NaN is wrong too
        if len(wrong):
            pose = poses[wrong[0]]
            expected = "a rotation matrix, a finite position, and the row 0 0 0 1"
            place = _place(int(wrong[0]), shape)
            raise ModelError(f"no pose: {_defect(pose)}", place=place, value=pose.tolist(), expected=expected)
        if aim is not None and aim.kind == "yaw":
            upright = np.flatnonzero(np.hypot(*poses[:, :2, aim.axis].T) < VERTICAL)
            if len(upright):
                what = f"the frame's {AXES[aim.axis]} axis is vertical, which has no yaw"
                raise ModelError(what, place=_place(int(upright[0]), shape), expected="a pose in which it is not")
        return poses, shape, aim or POSE
    if array.shape[-1:] != (3,) or aim not in (None, POSITION):
        expected = "(…, 4, 4) poses" + (
            " or (…, 3) positions"
            if aim in (None, POSITION)
            else ", as aw.kinematics.pose_towards(positions, direction) makes"
        )
        raise ShapeError(f"shape {array.shape}", place="targets", expected=expected)
    if aim is None and array.shape[-2:] == (3, 3) and _rotations(array.reshape(-1, 3, 3)):
        expected = "(…, 4, 4) poses: a position too; aim='position' where they are three positions"
        raise ShapeError(f"a rotation matrix alone, shape {array.shape}", place="targets", expected=expected)
    shape, positions = array.shape[:-1], array.reshape(-1, 3)
    wrong = np.flatnonzero(~(np.abs(positions) < LARGEST).all(axis=1))
    if len(wrong):
        place, expected = _place(int(wrong[0]), shape), "a finite position [m]"
        raise ModelError(place=place, value=positions[wrong[0]].tolist(), expected=expected)
    poses = np.broadcast_to(np.eye(4), (len(positions), 4, 4)).copy()
    poses[:, :3, 3] = positions
    return poses, shape, POSITION


def pose_towards(position: Any, direction: Any, axis: str = "z") -> np.ndarray:
    """Poses of a frame at positions, with one of its axes along a direction; the turn about that axis is arbitrary.

    For targets of which only the axis, its pitch or its yaw counts.

    Args:
        position: (…, 3) [m] in base axes.   direction: (3,) or (…, 3) in base axes, of any length.
        axis: of the frame: "x", "y" or "z".
    Returns:
        poses: (…, 4, 4).
    Raises:
        ShapeError: other shapes.   ModelError: a direction without length, no such axis, numbers that are not finite.
    Example:
        >>> pose = aw.kinematics.pose_towards([0.4, 0.2, 0.3], [0.0, 0.0, -1.0])  # downwards
        >>> pose[:3, 3]
        array([0.4, 0.2, 0.3])
    """
    at, way = checked_array(position, "position"), checked_array(direction, "direction")
    for place, value in (("position", at), ("direction", way)):
        if value.shape[-1:] != (3,) or (place == "direction" and way.shape not in ((3,), at.shape)):
            expected = "(…, 3)" if place == "position" else "(3,), or one for each position"
            raise ShapeError(f"shape {value.shape}", place=place, expected=expected)
        if not (np.abs(value) < LARGEST).all():
            raise ModelError("not finite", place=place, value=value.tolist(), expected="finite numbers")
    check_known(ModelError, axis, tuple(AXES), place="axis")
    length = np.linalg.norm(way, axis=-1, keepdims=True)
    if not (length > 0.0).all():
        raise ModelError(place="direction", value=way.tolist(), expected="a direction, not 0 0 0")
    first = np.broadcast_to(way / length, at.shape)
    across = np.eye(3)[np.abs(first).argmin(axis=-1)]  # the base's axis that is farthest from the direction
    second = np.cross(across, first)
    second = second / np.linalg.norm(second, axis=-1, keepdims=True)
    poses, k = np.zeros((*at.shape[:-1], 4, 4)), AXES.index(axis)
    poses[..., :3, 3], poses[..., 3, 3] = at, 1.0
    for column, each in zip((k, k + 1, k + 2), (first, second, np.cross(first, second)), strict=True):
        poses[..., :3, column % 3] = each
    return poses


def _place(number: int, shape: tuple[int, ...]) -> str:
    indices = np.unravel_index(number, shape)
    return f"targets[{', '.join(str(i) for i in indices)}]" if shape else "targets"


def _rotations(matrices: np.ndarray) -> bool:
    """True if all (k, 3, 3) are rotation matrices."""
    poses = np.broadcast_to(np.eye(4), (len(matrices), 4, 4)).copy()
    poses[:, :3, :3] = matrices
    return len(poses) > 0 and bool((pose_defects(poses) < ORTHOGONAL).all())


def _defect(pose: np.ndarray) -> str:
    """Reason why (4, 4) numbers are not a pose, in words."""
    if not (np.abs(pose) < LARGEST).all():
        return "a number is not finite"
    last = np.array([0.0, 0.0, 0.0, 1.0])
    if np.abs(pose[3] - last).max() >= ORTHOGONAL:
        turned = np.abs(pose[:, 3] - last).max() < ORTHOGONAL
        return "transposed, the position is in the last row" if turned else "the last row is another"
    rotation = pose[:3, :3]
    off = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if off < ORTHOGONAL:
        return "a mirror image, whose determinant is -1"
    return f"entries of RᵀR - 1 are up to {off:.2g}"

"""Targets of inverse kinematics as users hand them in: poses or positions, checked before anything is solved."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np

from armwright.errors import ModelError, ShapeError
from armwright.ik.chain import Aim
from armwright.ik.pose_defect import LARGEST, pose_defects
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
        what = (
            "rows of unequal length" if "inhomogeneous" in str(error) else str(error)
        )  # NumPy's sentence is a paragraph
        raise ShapeError(what, place=place, expected="an array of real numbers") from None


def checked_targets(targets: Any, aim: Aim | None) -> tuple[np.ndarray, tuple[int, ...], Aim]:
    """Targets as poses (k, 4, 4), the shape of their batch, and what of them counts.

    Raises:
        ShapeError, ModelError: what is no pose; names the first.
    """
    array = checked_array(targets, "targets")
    if aim is not None and aim not in get_args(Aim):
        raise ModelError(place="aim", value=aim, choices=get_args(Aim))
    if array.shape[-2:] == (4, 4):
        shape, poses = array.shape[:-2], array.reshape(-1, 4, 4)
        wrong = np.flatnonzero(~(pose_defects(poses) < ORTHOGONAL))  # NaN is wrong too
        if len(wrong):
            pose = poses[wrong[0]]
            expected = "a rotation matrix, a finite position, and the row 0 0 0 1"
            place = _place(int(wrong[0]), shape)
            raise ModelError(f"no pose: {_defect(pose)}", place=place, value=pose.tolist(), expected=expected)
        return poses, shape, aim or "pose"
    if array.shape[-1:] != (3,) or aim not in (None, "position"):
        expected = "(…, 4, 4) poses" + (" or (…, 3) positions" if aim in (None, "position") else "")
        raise ShapeError(place="targets", value=array.shape, expected=expected)
    if aim is None and array.shape[-2:] == (3, 3) and _rotations(array.reshape(-1, 3, 3)):
        expected = "(…, 4, 4) poses: a position too; aim='position' where they are three positions"
        raise ShapeError("a rotation matrix alone", place="targets", value=array.shape, expected=expected)
    shape, positions = array.shape[:-1], array.reshape(-1, 3)
    wrong = np.flatnonzero(~(np.abs(positions) < LARGEST).all(axis=1))
    if len(wrong):
        place, expected = _place(int(wrong[0]), shape), "a finite position [m]"
        raise ModelError(place=place, value=positions[wrong[0]].tolist(), expected=expected)
    poses = np.broadcast_to(np.eye(4), (len(positions), 4, 4)).copy()
    poses[:, :3, 3] = positions
    return poses, shape, "position"


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

"""Joint positions that bring the tip to poses: damped least squares over many starts and poses at once. [Marquardt1963]"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from armwright import scalar
from armwright.kinematics import forward_kinematics
from armwright.model import Model
from armwright.modules.parametric_model import Structure, numbers, shapes, skeleton, structure
from armwright.modules.statics import ranges
from armwright.program import Program, interpret, trace
from armwright.scalar import Array

STEPS = 60
ARM_OF_ANGLE = 0.3  # [m]: a turn by 1 rad counts as much as this way, about half the reach of an arm
DAMPING, EASED, HARDENED = 1e-2, 0.3, 4.0  # at first, behind a step that helped, behind one that did not
SOFTEST, HARDEST = 1e-9, 1e6  # where it cannot go on
NOTHING, STALLED = 1e-9, 0.999  # [m] of error that is left; the share of it that a step without hope leaves


@lru_cache(maxsize=64)
def pose_errors(form: Structure) -> Program:
    """A program  q (n,), target (4, 4), numbers of an arm → (12, 1 + n): the error of the tip's pose, and its slope by q.

    Rows: p - p*  [m],  then the nine of  w (R - R*) / √2  [m]: for a small angle θ their norm is w θ.
    """

    def errors(q: Array, target: Array, *values: Array) -> np.ndarray:
        arm = skeleton(form, values)

        def off(x: Array) -> np.ndarray:
            pose = forward_kinematics(arm, x)
            turn = (pose[:3, :3] - target[:3, :3]) * (ARM_OF_ANGLE / np.sqrt(2.0))
            return scalar.array([*(pose[:3, 3] - target[:3, 3]), *turn.flatten()])

        return scalar.array(np.concatenate([off(q).reshape(12, 1), scalar.jacobian(off, q)], axis=1))

    return trace("pose_errors", errors, {"q": (len(form) - 1,), "target": (4, 4), **shapes(form)})


def reaching(
    model: Model, poses: np.ndarray, turned: np.ndarray, starts: int, seed: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joint positions within the limits that come as near to each pose as a descent from random starts does.

    Args:
        model: the arm, with a tip.   poses: (k, 4, 4) of the tip.   turned: (k,) whether the pose's rotation counts.
        starts: how many for each pose.   seed: of the starts.
    Returns:
        q, off, angle: (k, starts, n) [rad | m]; (k, starts) [m] and [rad], how far off the tip is.
    Raises:
        ModelError: the arm branches and names no tip.
    """
    program, values, count = pose_errors(structure(model)), numbers(model), len(poses)
    low, high = ranges(model)
    q = np.random.default_rng(seed).uniform(low, high, (count * starts, model.n))
    targets = np.repeat(poses, starts, axis=0)
    rows = np.ones((count * starts, 12, 1))
    rows[~np.repeat(turned, starts), 3:] = 0.0
    error, slope = _split(program, rows, q, targets, *values)
    damping, done = np.full(len(q), DAMPING), np.zeros(len(q), dtype=bool)
    for _ in range(STEPS):
        normal = slope.transpose(0, 2, 1) @ slope
        normal += damping[:, None, None] * (np.eye(model.n) * (1e-6 + normal.max(axis=(1, 2)))[:, None, None])
        step = np.linalg.solve(normal, -(slope.transpose(0, 2, 1) @ error[..., None]))[..., 0]
        tried = np.clip(q + step, low, high)
        new_error, new_slope = _split(program, rows, tried, targets, *values)
        old, new = (error**2).sum(axis=1), (new_error**2).sum(axis=1)
        better = new < old
        done |= (new < NOTHING**2) | (damping >= HARDEST) | (better & (new > STALLED * old))
        q[better], error[better], slope[better] = tried[better], new_error[better], new_slope[better]
        damping = np.clip(np.where(better, damping * EASED, damping * HARDENED), SOFTEST, HARDEST)
        if done.all():
            break
    off = np.linalg.norm(error[:, :3], axis=1)
    half = np.linalg.norm(error[:, 3:], axis=1) / (2.0 * ARM_OF_ANGLE)  # sin(θ/2)
    angle = 2.0 * np.arcsin(np.minimum(half, 1.0))
    shape = (count, starts)
    return q.reshape(*shape, model.n), off.reshape(shape), angle.reshape(shape)


def _split(program: Program, rows: np.ndarray, *inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    both = interpret(program, *inputs) * rows
    return both[..., 0], both[..., 1:]

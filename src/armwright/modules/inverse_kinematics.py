"""Joint positions that bring the tip to poses: damped least squares over many starts and poses at once. [Marquardt1963]"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from armwright import scalar
from armwright.kinematics import forward_kinematics
from armwright.model import Model
from armwright.modules.parametric_model import (
    Structure,
    parameter_shapes,
    parameters_of,
    parametric_model,
    structure,
)
from armwright.modules.statics import ranges
from armwright.program import Program, interpret, trace
from armwright.scalar import Array

STEPS = 60
ANGLE_WEIGHT = 0.3  # [m/rad]: a turn by 1 rad counts as this distance, about half the reach of an arm
DAMPING, DECREASE, INCREASE = 1e-2, 0.3, 4.0  # at first; factors after a step that helped and after one that did not
LEAST_DAMPING, MOST_DAMPING = 1e-9, 1e6  # at the most a descent ends
CONVERGED, STALLED = 1e-9, 0.999  # a descent ends at this error [m], or where a step leaves this share of the error


@lru_cache(maxsize=64)
def pose_errors(form: Structure) -> Program:
    """Program  q (n,), target (4, 4), parameters of an arm → (12, 1 + n): the error of the tip's pose, and its slope by q.

    Rows: p - p*  [m],  then the nine of  w (R - R*) / √2  [m]: for a small angle θ their norm is w θ.
    """

    def errors(q: Array, target: Array, *values: Array) -> np.ndarray:
        arm = parametric_model(form, values)

        def error(x: Array) -> np.ndarray:
            pose = forward_kinematics(arm, x)
            turn = (pose[:3, :3] - target[:3, :3]) * (ANGLE_WEIGHT / np.sqrt(2.0))
            return scalar.array([*(pose[:3, 3] - target[:3, 3]), *turn.flatten()])

        return scalar.array(np.concatenate([error(q).reshape(12, 1), scalar.jacobian(error, q)], axis=1))

    return trace("pose_errors", errors, {"q": (len(form) - 1,), "target": (4, 4), **parameter_shapes(form)})


def inverse_kinematics(
    model: Model, poses: np.ndarray, turned: np.ndarray, starts: int, seed: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joint positions within the limits near each pose, by descent from random starts.

    Args:
        model: the arm, with a tip.   poses: (k, 4, 4) of the tip.   turned: (k,) true where the pose's rotation counts.
        starts: how many for each pose.   seed: of the starts.
    Returns:
        q, distance, angle: (k, starts, n) [rad | m]; (k, starts) [m] and [rad], from the tip to the pose.
    Raises:
        ModelError: the arm branches and names no tip.
    """
    program, values, count = pose_errors(structure(model)), parameters_of(model), len(poses)
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
        new_q = np.clip(q + step, low, high)
        new_error, new_slope = _split(program, rows, new_q, targets, *values)
        old, new = (error**2).sum(axis=1), (new_error**2).sum(axis=1)
        better = new < old
        done |= (new < CONVERGED**2) | (damping >= MOST_DAMPING) | (better & (new > STALLED * old))
        q[better], error[better], slope[better] = new_q[better], new_error[better], new_slope[better]
        damping = np.clip(np.where(better, damping * DECREASE, damping * INCREASE), LEAST_DAMPING, MOST_DAMPING)
        if done.all():
            break
    distance = np.linalg.norm(error[:, :3], axis=1)
    half = np.linalg.norm(error[:, 3:], axis=1) / (2.0 * ANGLE_WEIGHT)  # sin(θ/2)
    angle = 2.0 * np.arcsin(np.minimum(half, 1.0))
    shape = (count, starts)
    return q.reshape(*shape, model.n), distance.reshape(shape), angle.reshape(shape)


def _split(program: Program, rows: np.ndarray, *inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    both = interpret(program, *inputs) * rows
    return both[..., 0], both[..., 1:]

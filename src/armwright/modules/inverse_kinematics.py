"""Joint positions that bring the tip to poses, one descent from each of many starts: all arms of a structure share their code."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from armwright.ik.chain import angles_between
from armwright.ik.descent import descent
from armwright.ik.family import Family
from armwright.ik.task_loop import TaskLoop
from armwright.kernels.batch import Kernel
from armwright.kernels.target import select_target
from armwright.kinematics import forward_kinematics
from armwright.model import Model
from armwright.model.parametric_model import Structure, structure
from armwright.modules.statics import ranges
from armwright.program import trace
from armwright.scalar import Array

ANGLE_WEIGHT = 0.3  # [m/rad]: a turn by 1 rad counts as this distance, about half the reach of an arm
TOLERANCE = 1e-9  # [m and rad], where a descent ends
ATTEMPTS = 8  # descents for one result, at most: where that from its own start gets slow, from the first of all starts


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
    native, bounds, count = _native(structure(model)), ranges(model), len(poses) * starts
    q = np.random.default_rng(seed).uniform(*bounds, (count, model.n))
    tasks = np.repeat(native.family.tasks(model, bounds, poses, turned), starts, axis=0)
    q = native.descend(tasks, q)
    reached, targets = native.poses(q, tasks), np.repeat(poses, starts, axis=0)
    distance = np.linalg.norm(reached[:, :3, 3] - targets[:, :3, 3], axis=1)
    angle = angles_between(reached[:, :3, :3], targets[:, :3, :3])
    shape = (len(poses), starts)
    return q.reshape(*shape, model.n), distance.reshape(shape), angle.reshape(shape)


class _Native:
    """Native code for all arms of a structure."""

    def __init__(self, form: Structure):
        self.family = Family(form, ANGLE_WEIGHT)
        n, size = self.family.n, self.family.task_size
        self._loop = TaskLoop(descent(self.family, TOLERANCE, near=False), ATTEMPTS)

        def pose(q: Array, task: Array) -> np.ndarray:
            return forward_kinematics(self.family.of(task).model, q)

        self.poses = Kernel(trace("pose", pose, {"q": (n,), "task": (size,)}), select_target())

    def descend(self, tasks: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """(k, n) joint positions for tasks (k, …), each from its own start (k, n) first."""
        attempts = np.concatenate([starts, np.zeros((len(tasks), 1))], axis=1)
        return self._loop.run(tasks, attempts, np.arange(float(len(tasks))))[:, : self.family.n]


_native = lru_cache(maxsize=64)(_Native)

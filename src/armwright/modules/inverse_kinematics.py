"""Joint positions that bring the tip to poses, one descent from each of many starts: all arms of a structure share their code."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from armwright.ik.chain import angles_between
from armwright.ik.descent import descent
from armwright.ik.family import Family
from armwright.kernels.batch import Kernel
from armwright.kernels.loop import LoopArrays, NativeLoop, Tasks
from armwright.kernels.stages import Call, Exchange
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
        self.family, self._target = Family(form, ANGLE_WEIGHT), select_target()
        n, size = self.family.n, self.family.task_size
        program = descent(self.family, TOLERANCE, near=False)
        self._loop = NativeLoop((Exchange(size, n + 1, n + 3, ATTEMPTS, 1), Call(program)), self._target)

        def pose(q: Array, task: Array) -> np.ndarray:
            return forward_kinematics(self.family.of(task).model, q)

        self.poses = Kernel(trace("pose", pose, {"q": (n,), "task": (size,)}), self._target)

    def descend(self, tasks: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """(k, n) joint positions for tasks (k, …), each from its own start (k, n) first."""
        lanes, count = self._loop.lanes(self._target.width), len(tasks)
        lanes.blocks["over"].fill(2.0)
        lanes.blocks["task_number"].fill(-1.0)
        attempts = np.concatenate([starts, np.zeros((count, 1))], axis=1)
        results = np.empty((count, self.family.n + 3))
        work = Tasks(np.array([0, count]), tasks, attempts, np.arange(float(count)), results)
        self._loop.run(lanes, 0.0, (0, 2**62), LoopArrays(tasks=work))
        return results[:, : self.family.n]


_native = lru_cache(maxsize=64)(_Native)

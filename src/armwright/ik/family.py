"""Arms of one structure: one compiled descent serves them all, with an arm's geometry and limits as numbers of the task."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.ik.chain import JointChain
from armwright.model import Model
from armwright.model.parametric_model import Structure, parameter_shapes, parameters_of, parametric_model
from armwright.scalar import Array

KEPT = ("rotation", "position", "offset", "tip_rotation", "tip_position")  # parameters that poses depend on


@dataclass(frozen=True)
class Family:
    """Arms of one structure.

    Tasks are those of `JointChain`, then the weight of angles [m/rad] of this target (0: its rotation does not count), then the
    arm: lowest and highest positions, and parameters.

    Attributes:
        form: kinds and parents of the joints.   weight: [m/rad], of angles where they count.
    """

    form: Structure
    weight: float

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.form) - 1

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Of the numbers that describe an arm."""
        shapes = parameter_shapes(self.form)
        return {"low": (self.n,), "high": (self.n,), **{name: shapes[name] for name in KEPT}}

    @property
    def task_size(self) -> int:
        """Numbers of a task."""
        return JointChain.task_size + 1 + sum(int(np.prod(shape)) for shape in self.shapes.values())

    def of(self, task: Array) -> JointChain:
        """The chain that a task is for, of symbols."""
        at, parts = JointChain.task_size + 1, {}
        for name, shape in self.shapes.items():
            size = int(np.prod(shape))
            parts[name], at = task[at : at + size].reshape(shape), at + size
        none = {name: scalar.zeros(*shape) for name, shape in parameter_shapes(self.form).items() if name not in KEPT}
        model = parametric_model(self.form, tuple((parts | none)[name] for name in parameter_shapes(self.form)))
        return JointChain(model, None, task[JointChain.task_size], bounds=(parts["low"], parts["high"]))

    def tasks(
        self, model: Model, bounds: tuple[np.ndarray, np.ndarray], poses: np.ndarray, turned: np.ndarray
    ) -> np.ndarray:
        """(k, task_size) tasks of an arm for poses (k, 4, 4), whose rotation counts where `turned`."""
        values = dict(zip(parameter_shapes(self.form), parameters_of(model), strict=True))
        arm = np.concatenate([*bounds, *(np.ravel(values[name]) for name in KEPT)])
        count = len(poses)
        columns = [poses[:, :3, 3], poses[:, :3, :3].reshape(count, 9), np.zeros((count, 1))]
        return np.concatenate([*columns, self.weight * turned[:, None], np.tile(arm, (count, 1))], axis=1)

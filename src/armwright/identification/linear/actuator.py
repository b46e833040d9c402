"""An identified model between a controller and the arm: an amplifier or a torque loop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from armwright import scalar
from armwright.control.wrapper import Wrapper
from armwright.errors import ScenarioError
from armwright.identification.linear.state_space import StateSpace, check_single
from armwright.interfaces import JointReference, Measurement
from armwright.model import Model
from armwright.scalar import Array

SAME = 1e-6  # relative difference of two periods


@dataclass(frozen=True, eq=False)
class IdentifiedActuator(Wrapper):
    """Inner commands of every joint passed through an identified model:  x' = A x + B u,  y = C x + D u + offset.

    One model serves all joints, each with a state of its own; it begins at rest at the commands that were in force.

    Args:
        inner: any controller.   model: with one input and one output, of the loop's period.
    Raises:
        ScenarioError: the model has several inputs or outputs.
    Example:
        >>> u = np.repeat(np.random.default_rng(0).standard_normal(60), 10)
        >>> y = np.concatenate([[0.0], 0.5 * u[:-1]])  # the drive gives half, a row later
        >>> model = aw.identification.fit_arx(u, y, 0.002, order=1, delay=1).state_space
        >>> pid = aw.JointPID(kp=[900.0, 250.0], kd=[180.0, 50.0])
        >>> aw.identification.IdentifiedActuator(pid, model).model.d.shape
        (1, 1)
    """

    model: StateSpace

    def __post_init__(self) -> None:
        super().__post_init__()
        check_single(self.model)

    def configure(self, arm: Model, period: float) -> Self:
        """The law for an arm and a sample period [s].

        Args:
            arm: the model.   period: [s].
        Raises:
            ScenarioError: not the period that the model was identified at.
        """
        if not math.isclose(period, self.model.period, rel_tol=SAME):
            expected = f"{self.model.period:g} s, at which the model was identified"
            raise ScenarioError(place="period of the loop", value=period, expected=expected)
        return super().configure(arm, period)

    def memory(self, arm: Model, y: Measurement) -> Array:
        """Initial states (order × n,) at rest with the applied outputs; 0 for a model without a rest state."""
        order, gain = len(self.model.a), float(self.model.gain[0, 0])
        if gain == 0.0 or not np.isfinite(gain):
            return scalar.zeros(order * arm.n)
        rest = np.linalg.solve(np.eye(order) - self.model.a, self.model.b[:, 0]) / gain
        return scalar.array((rest[:, None] * (y.applied - self.model.offset[0])).ravel())

    def changed(self, r: JointReference, y: Measurement, u: Array, s: Array) -> tuple[Array, Array]:
        """Outputs (n,) of the model, and its states (order × n,) at the next tick."""
        model = self.model
        x = s.reshape(len(model.a), len(u))
        out = model.c[0] @ x + model.d[0, 0] * u + model.offset[0]
        return out, (model.a @ x + model.b * u).ravel()

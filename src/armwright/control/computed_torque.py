"""Computed torque: inverse dynamics turns the arm into a set of double integrators.  [SicilianoEtAl2009]"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from armwright import scalar
from armwright.actuators import with_goals
from armwright.control.commands import torque_commands
from armwright.control.gains import check_model, model_for, per_joint
from armwright.dynamics import inverse_dynamics
from armwright.interfaces import JointReference, Measurement
from armwright.model import Model
from armwright.model.simplify import simplified
from armwright.parameters import ZERO, Numbers
from armwright.scalar import Array, Scalar


@dataclass(frozen=True, eq=False)
class ComputedTorque:
    """tau = ID(q, q̇, q̈_r + kd (q̇_r - q̇) + kp (q_r - q) + ki ∫ (q_r - q) dt), as commands in each joint's own unit, eq. (11).

    With an exact model every joint's error dies away as  ë + kd ė + kp e = 0.

    Args:
        kp: [1/s²].   kd: [1/s].   ki: [1/s³].
        model: the arm that is reckoned with, which may differ from the simulated one; absent: that, as its record has it.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> control = aw.ComputedTorque(kp=100.0, kd=20.0)
        >>> loop = aw.Loop(control, aw.trajectories.Step([0.0, 0.0], [0.5, -0.5]), period=0.002)
        >>> run = aw.simulate(aw.Scenario("two-link", 1.0, loop=loop))
        >>> run.q.values[-1].round(3)
        array([ 0.5, -0.5])
    """

    gain_units: ClassVar[dict[str, str]] = {"kp": "1/s²", "ki": "1/s³", "kd": "1/s"}
    kp: Numbers
    kd: Numbers
    ki: Numbers = ZERO
    model: Model | None = None
    period: float | None = None  # [s] of the loop, which fits the controller to it

    def __post_init__(self) -> None:
        check_model("ComputedTorque", self.model)

    def configure(self, arm: Model, period: float) -> ComputedTorque:
        """The controller for an arm and a sample period [s]: one gain per joint.

        Args:
            arm: the model.   period: [s].
        Raises:
            ScenarioError: a gain of the wrong length, or one below 0; names it and the joints. A model of other joints.
        """
        model = model_for("ComputedTorque", self.model, arm)
        gains = {name: per_joint(arm, "ComputedTorque", name, getattr(self, name)) for name in ("kp", "kd", "ki")}
        return replace(self, **gains, model=model, period=period)

    def init(self, arm: Model, y: Measurement) -> Array:
        """Initial state: the integral of the error, 0."""
        return scalar.zeros(arm.n)

    def step(self, t: Scalar, r: JointReference, y: Measurement, s: Array) -> tuple[Array, Array]:
        """One tick: commands (n,) and the next state."""
        assert self.model is not None
        assert self.period is not None
        error = r.q - y.q
        qdd = r.qdd + self.kd * (r.qd - y.qd) + self.kp * error + self.ki * s
        tau = inverse_dynamics(simplified(self.model), y.q, y.qd, scalar.array(qdd))
        u = with_goals(self.model, torque_commands(self.model, y.qd, tau), y.q)
        return scalar.array(u), scalar.array(np.asarray(s + self.period * error, dtype=object))

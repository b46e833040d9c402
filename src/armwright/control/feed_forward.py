"""Feed-forward: the model's command for the reference, added to that of any controller.  [SicilianoEtAl2009]"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from armwright import scalar
from armwright.actuators.friction import link_friction
from armwright.control.commands import torque_commands
from armwright.control.gains import check_model, model_for
from armwright.control.wrapper import Wrapper
from armwright.dynamics import holding_torques, inverse_dynamics, mass_matrix
from armwright.dynamics.gears import motor_torques, without_rotors
from armwright.errors import ScenarioError
from armwright.interfaces import JointReference, Measurement
from armwright.model import Model
from armwright.model.simplify import simplified
from armwright.scalar import Array

INERTIAS = ("joint", "full")


@dataclass(frozen=True, eq=False)
class FeedForward(Wrapper):
    """u = inner + the command that gives, at the reference (q_r, q̇_r, q̈_r),  tau = g(q_r) + f(q̇_r) + inertia.

    Torques become commands by eq. (11) at the reference's speed: a voltage has its back EMF too.

    Args:
        inner: any controller.
        gravity: whether gravity and springs g + s at q_r are added.
        friction: whether the record's friction f at q̇_r is added; dry friction has the sign of q̇_r, and is 0 at rest.
        inertia: "joint": M_ii(q_r) q̈_r of every joint by itself; "full": M(q_r) q̈_r + C(q_r, q̇_r) q̇_r; absent: none.
        model: the arm that is reckoned with; absent: the simulated one as its record has it.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> control = aw.FeedForward(aw.JointPID(kp=100.0, kd=20.0), inertia="full")
        >>> move = aw.trajectories.Quintic([0.0, 0.0], [0.5, -0.5], duration=0.5)
        >>> loop = aw.Loop(control, move, period=0.002)
        >>> run = aw.simulate(aw.Scenario("two-link", 0.6, loop=loop))
        >>> run.q.values[-1].round(3)
        array([ 0.501, -0.5  ])
    """

    gravity: bool = True
    friction: bool = False
    inertia: str | None = None
    model: Model | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_model("FeedForward", self.model)
        for name in ("gravity", "friction"):
            value: Any = getattr(self, name)
            if not isinstance(value, (bool, np.bool_)):
                raise ScenarioError(place=f"FeedForward.{name}", value=value, expected="true or false")
        if self.inertia is not None and self.inertia not in INERTIAS:
            raise ScenarioError(place="FeedForward.inertia", value=self.inertia, choices=INERTIAS)

    def configure(self, arm: Model, period: float) -> Self:
        """The controller for an arm and a sample period [s].

        Args:
            arm: the model.   period: [s].
        Raises:
            ScenarioError: a model of other joints.
        """
        model = model_for("FeedForward", self.model, arm)
        return replace(super().configure(arm, period), model=model)

    def memory(self, arm: Model, y: Measurement) -> Array:
        """Initial memory: empty."""
        return scalar.zeros(0)

    def changed(self, r: JointReference, y: Measurement, u: Array, s: Array) -> tuple[Array, Array]:
        """The inner command plus that for the reference."""
        assert self.model is not None
        return u + torque_commands(self.model, r.qd, self.torques(r)), s

    def torques(self, r: JointReference) -> np.ndarray:
        """Motor torques (n,) at a reference [N m | N], referred to the joints."""
        assert self.model is not None
        model = self.model if self.friction else self.model.replace(friction=None)
        if not self.gravity:
            model = model.replace(gravity=[0.0, 0.0, 0.0], springs=None)
        if self.inertia == "full":
            return inverse_dynamics(simplified(model), r.q, r.qd, r.qdd)
        holding = holding_torques(simplified(model), r.q) if self.gravity else scalar.zeros(model.n)
        asked, qdd = holding + link_friction(model, r.qd), scalar.zeros(model.n)
        if self.inertia == "joint":  # rotors are accelerated by the motors, before the gears
            qdd = r.qdd
            asked = asked + np.diag(mass_matrix(simplified(without_rotors(model, model.names)), r.q)) * qdd
        return motor_torques(model, r.qd, qdd, scalar.array(asked), -scalar.array(holding))

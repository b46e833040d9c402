"""Friction compensation by the measured speed, with a dead band for joints at rest.  [ArmstrongHelouvry1991]"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

from armwright import scalar
from armwright.actuators import friction_torques
from armwright.actuators.coupling import from_joints, shares_of
from armwright.control.commands import torque_commands
from armwright.control.gains import per_joint
from armwright.control.wrapper import Wrapper
from armwright.dynamics.inverse import external_torques
from armwright.interfaces import JointReference, Measurement
from armwright.model import Model
from armwright.parameters import ONE, Numbers
from armwright.scalar import Array


@dataclass(frozen=True, eq=False)
class FrictionCompensation(Wrapper):
    """u = inner + share · the command of the record's friction f(v).

        v = q̇                                 where the joint moves, |q̇| > rest_speed
        v = sgn(q_r - q) rest_speed           at rest beyond the dead band
        v = 0                                 at rest, |q_r - q| ≤ dead_band

    Friction by loads is that of a motor that moves the joint at constant speed.
    A share above 1 over-compensates: the joint oscillates about its reference in a limit cycle.

    Args:
        inner: any controller.   dead_band: [rad | m] of the error.   rest_speed: [rad/s | m/s] above 0.
        share: of the record's friction.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> pid = aw.JointPID(kp=[400, 900, 300, 150, 30, 20], kd=[40, 90, 30, 12, 3, 2])
        >>> control = aw.FrictionCompensation(pid, dead_band=1e-3, rest_speed=0.01, share=0.8)
        >>> control.share
        0.8
    """

    dead_band: Numbers
    rest_speed: Numbers
    share: Numbers = ONE

    def configure(self, arm: Model, period: float) -> Self:
        """The controller for an arm and a sample period [s]: one number per joint.

        Args:
            arm: the model.   period: [s].
        Raises:
            ScenarioError: a number of the wrong length or size; names it and the joint.
        """
        law, least = "FrictionCompensation", 1e-300
        values = {name: per_joint(arm, law, name, getattr(self, name)) for name in ("dead_band", "share")}
        rest_speed = per_joint(arm, law, "rest_speed", self.rest_speed, low=least)
        return replace(super().configure(arm, period), rest_speed=rest_speed, **values)

    def memory(self, arm: Model, y: Measurement) -> Array:
        """Initial memory: empty."""
        return scalar.zeros(0)

    def changed(self, r: JointReference, y: Measurement, u: Array, s: Array) -> tuple[Array, Array]:
        """The inner command plus that for friction."""
        assert self.arm is not None
        error = r.q - y.q
        beyond = scalar.less(self.dead_band, scalar.abs(error))
        pushed = scalar.where(beyond, scalar.sign(error) * self.rest_speed, 0.0 * error)
        speed = scalar.where(scalar.less(self.rest_speed, scalar.abs(y.qd)), y.qd, pushed)
        external = external_torques(self.arm, y.q, y.qd)
        friction = friction_torques(self.arm, scalar.array(speed), external)
        torque = from_joints(shares_of(self.arm), friction)
        return u + self.share * torque_commands(self.arm, scalar.zeros(len(u)), scalar.array(torque)), s

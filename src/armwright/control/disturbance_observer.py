"""Disturbance observer: estimates the torque beside a joint's nominal inertia and compensates it.  [OhnishiEtAl1996]"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from armwright import scalar
from armwright.actuators import drive_torque
from armwright.actuators.coupling import from_joints, shares_of, to_joints
from armwright.control.commands import torque_commands
from armwright.control.gains import check_time, per_joint
from armwright.control.wrapper import Wrapper
from armwright.interfaces import JointReference, Measurement
from armwright.model import Model
from armwright.scalar import Array


@dataclass(frozen=True, eq=False)
class DisturbanceObserver(Wrapper):
    """u = inner - the command of d̂,  d̂ = Q(s) [J q̈ - tau] of every joint,  Q(s) = ω / (s + ω),  ω = 2π hz.

    Sampled exactly for a torque held over a period T, without an acceleration that is measured:

        d̂_k = e^{-ωT} d̂_{k-1} + (1 - e^{-ωT}) [J (q̇_k - q̇_{k-1}) / T - tau_{k-1}]

    tau is what the drives did with their last command, `y.applied`, at the mean measured speed: a limit winds nothing up.
    Gravity, friction, coupling and loads all count as a disturbance. In steady state d̂ is the disturbance itself, and the
    inner controller needs no integrator.

    Args:
        inner: any controller.
        inertia: [kg m² | kg] nominal J, rotor included; one number for all joints, (n,), or a `Batch` of either.
        hz: bandwidth of Q.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> pd = aw.JointPID(kp=[900.0, 250.0], kd=[180.0, 50.0])  # no gravity, no integrator
        >>> control = aw.DisturbanceObserver(pd, inertia=[9.7, 0.85], hz=10.0)
        >>> loop = aw.Loop(control, aw.trajectories.Step([0.0, 0.0], [0.5, -0.5]), period=0.002)
        >>> run = aw.simulate(aw.Scenario("two-link", 1.5, loop=loop))
        >>> run.q.values[-1].round(2)
        array([ 0.5, -0.5])
    """

    inertia: Any
    hz: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_time("DisturbanceObserver", "hz", self.hz)

    def configure(self, arm: Model, period: float) -> Self:
        """The controller for an arm and a sample period [s].

        Args:
            arm: the model.   period: [s].
        Raises:
            ScenarioError: an inertia of the wrong length, or one not above 0; names it and the joint.
        """
        least = float(np.nextafter(0.0, 1.0))
        inertia = per_joint(arm, "DisturbanceObserver", "inertia", self.inertia, low=least)
        return replace(super().configure(arm, period), inertia=inertia)

    def memory(self, arm: Model, y: Measurement) -> Array:
        """Initial memory: disturbance 0 (n,) [N m | N], the measured speed (n,), and a flag 0 for the first estimate."""
        return scalar.array(np.concatenate([scalar.zeros(arm.n), y.qd, scalar.zeros(1)]))

    def changed(self, r: JointReference, y: Measurement, u: Array, s: Array) -> tuple[Array, Array]:
        """The inner command minus that of the estimated disturbance."""
        assert self.arm is not None
        assert self.period is not None
        n, shares = len(u), shares_of(self.arm)
        last, speed, begun = s[:n], s[n : 2 * n], s[2 * n]
        tau = to_joints(shares, drive_torque(self.arm, 0.5 * (speed + y.qd), y.applied))
        keep = math.exp(-2.0 * math.pi * self.hz * self.period)
        seen = self.inertia * (y.qd - speed) / self.period - tau
        # before the first tick no period has passed, in which a speed could have changed
        disturbance = scalar.array(begun * (keep * last + (1.0 - keep) * seen))
        u = u - torque_commands(self.arm, scalar.zeros(n), from_joints(shares, disturbance))
        return u, np.concatenate([disturbance, y.qd, scalar.array([1.0 + 0.0 * begun])])

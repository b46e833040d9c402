"""PD, PI and PID control of single joints.  [AstromHagglund2006]"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from armwright import scalar
from armwright.actuators import with_goals
from armwright.actuators.coupling import from_joints, shares_of
from armwright.control.anti_windup import RULES, LimitedStage, shortfall
from armwright.control.commands import command_signs, torque_commands
from armwright.control.gains import check_delay_ticks, check_model, check_time, model_for, per_joint, positive_limit
from armwright.dynamics import holding_torques
from armwright.errors import ScenarioError
from armwright.interfaces import JointReference, Measurement
from armwright.model import Model
from armwright.model.simplify import simplified
from armwright.parameters import UNSET, ZERO, Numbers, NumbersOrNone
from armwright.scalar import Array, Scalar
from armwright.simulation.checks import check_choice

GAINS = ("kp", "ki", "kd", "speed_feedforward", "acceleration_feedforward", "slack")


@dataclass(frozen=True, eq=False)
class JointPID:
    """u = kp e + ki ∫ e dt + kd d + kv q̇_r + ka q̈_r + gravity, each in its joint's command unit U = V, A, N m or N.

    Gains are one number or one for each joint, or a `Batch` of such. They are above 0 whatever a gear's sense: a voltage or
    current through a negative ratio is turned round.

    A servo's goal is its measured position and the sum, in rad: with kp = 1 and no other gain it is the reference.

    Args:
        kp: [U/rad | U/m].   ki: [U/(rad s) | U/(m s)].   kd: [U s/rad | U s/m].
        derivative: "error": d = q̇_r - q̇, or "measurement": d = -q̇. A reference that jumps has no speed, and gives no kick.
        cutoff_hz: of a low-pass filter; q̇ is then the filtered difference of measured positions, else the measured speed.
        speed_feedforward: kv [U s/rad | U s/m].   acceleration_feedforward: ka [U s²/rad | U s²/m].
        gravity: whether the command that holds the arm at its measured position is added, by `model`.
        limit: [U] the most that is commanded, either way; absent: no limit of its own.
        anti_windup: "none", "clamping" or "back-calculation", by the limit and by what the drives really did.
        tracking_time: [s] in which back-calculation takes the integrator back.
        delay_ticks: whole ticks that commands take to the drives, for anti-windup; absent: those of the loop's timing.
        slack: [U] by how much a drive may miss a command and still do it, such as half of a converter's resolution.
        model: the arm that gravity is reckoned with; absent: the simulated one as its record has it.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> control = aw.JointPID(kp=[900.0, 250.0], kd=[180.0, 50.0], gravity=True)
        >>> loop = aw.Loop(control, aw.trajectories.Step([0.0, 0.0], [0.5, -0.5]), period=0.002)
        >>> run = aw.simulate(aw.Scenario("two-link", 1.0, loop=loop))
        >>> run.q.values[-1].round(2)
        array([ 0.5 , -0.49])
    """

    # U: the unit of the command, Q: rad or m
    gain_units: ClassVar[dict[str, str]] = {"kp": "U/Q", "ki": "U/(Q s)", "kd": "U s/Q"}
    kp: Numbers
    ki: Numbers = ZERO
    kd: Numbers = ZERO
    derivative: Literal["error", "measurement"] = "error"
    cutoff_hz: float | None = None
    speed_feedforward: Numbers = ZERO
    acceleration_feedforward: Numbers = ZERO
    gravity: bool = False
    limit: NumbersOrNone = UNSET
    anti_windup: Literal["none", "clamping", "back-calculation"] = "none"
    tracking_time: float | None = None
    delay_ticks: int | None = None
    slack: Numbers = ZERO
    model: Model | None = None
    period: float | None = None  # [s] of the loop, which fits the controller to it

    def __post_init__(self) -> None:
        check_choice("JointPID.derivative", self.derivative, ("error", "measurement"))
        check_choice("JointPID.anti_windup", self.anti_windup, RULES)
        check_delay_ticks("JointPID", self.delay_ticks)
        check_model("JointPID", self.model)
        if not isinstance(self.gravity, (bool, np.bool_)):
            raise ScenarioError(place="JointPID.gravity", value=self.gravity, expected="true or false")
        if self.cutoff_hz is not None:
            check_time("JointPID", "cutoff_hz", self.cutoff_hz)
        check_tracking("JointPID", self.anti_windup, self.tracking_time)

    def configure(self, arm: Model, period: float) -> JointPID:
        """The controller for an arm and a sample period [s]: one gain per joint.

        Args:
            arm: the model.   period: [s].
        Raises:
            ScenarioError: a gain of the wrong length, or one below 0; names it and the joints. A model of other joints.
        """
        model = model_for("JointPID", self.model, arm)
        gains = {name: per_joint(arm, "JointPID", name, getattr(self, name)) for name in GAINS}
        limit = positive_limit(arm, "JointPID", "limit", self.limit)
        ticks = self.delay_ticks or 0  # the loop has filled them in
        return replace(self, **gains, limit=limit, model=model, delay_ticks=ticks, period=period)

    def init(self, arm: Model, y: Measurement) -> Array:
        """Initial state: integrator 0, and the commands that were in force."""
        parts = [scalar.zeros(arm.n), *[y.applied] * (1 + (self.delay_ticks or 0))]
        if self.cutoff_hz is not None:
            parts += [y.q, y.qd]
        return scalar.array(np.concatenate(parts))

    def step(self, t: Scalar, r: JointReference, y: Measurement, s: Array) -> tuple[Array, Array]:
        """One tick: commands (n,) and the next state."""
        assert self.model is not None
        assert self.period is not None
        n, h, signs = len(r.q), self.period, command_signs(self.model)
        end = (2 + (self.delay_ticks or 0)) * n
        integral, asked, rest = s[:n], s[n:end], s[end:]
        speed = y.qd
        if self.cutoff_hz is not None:
            keep = math.exp(-2.0 * math.pi * self.cutoff_hz * h)
            speed = keep * rest[n:] + (1.0 - keep) * (y.q - rest[:n]) / h
            rest = np.concatenate([y.q, speed])
        slope = (r.qd - speed) if self.derivative == "error" else -1.0 * speed
        feedforward = self.kd * slope + self.speed_feedforward * r.qd + self.acceleration_feedforward * r.qdd
        if self.gravity:
            weight = from_joints(shares_of(self.model), holding_torques(simplified(self.model), y.q))
            feedforward = feedforward + signs * torque_commands(self.model, scalar.zeros(n), weight)
        missing = signs * shortfall(y.applied, asked[:n], self.slack)
        stage = LimitedStage(self.kp, self.ki, self.limit, h, self.anti_windup, self.tracking_time)
        done = stage.step(r.q - y.q, integral, feedforward=feedforward, missing=missing)
        u = scalar.array(with_goals(self.model, signs * done.output, y.q))
        return u, scalar.array(np.concatenate([done.integral, asked[n:], u, rest]))


def check_tracking(law: str, rule: str, tracking_time: float | None) -> None:
    """Refuses a tracking time without back-calculation, and back-calculation without a tracking time.

    Raises:
        ScenarioError: says which of the two is missing.
    """
    if (rule == "back-calculation") != (tracking_time is not None):
        expected = "a time [s] with anti_windup = 'back-calculation', none with other rules"
        raise ScenarioError(
            f"anti_windup = {rule!r}", place=f"{law}.tracking_time", value=tracking_time, expected=expected
        )
    if tracking_time is not None:
        check_time(law, "tracking_time", tracking_time)

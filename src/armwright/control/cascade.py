"""Cascade control as in servo drives: nested position, speed and current loops, each at its own rate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np

from armwright import scalar
from armwright.actuators import with_goals
from armwright.control.anti_windup import RULES, LimitedStage, shortfall, within
from armwright.control.commands import command_signs
from armwright.control.gains import check_delay_ticks, check_whole, per_joint, positive_limit
from armwright.control.joint_pid import check_tracking
from armwright.errors import ScenarioError
from armwright.interfaces import JointReference, Measurement
from armwright.model import Model
from armwright.parameters import UNSET, ZERO, Numbers, NumbersOrNone
from armwright.scalar import Array, Scalar
from armwright.simulation.checks import check_choice

GAINS = ("position_kp", "speed_feedforward", "speed_kp", "speed_ki", "current_kp", "current_ki", "slack")
LIMITS = ("speed_limit", "effort_limit", "voltage_limit")
RATES = ("position", "speed")
SLOWEST = 1_000_000  # ticks: every number up to it is exact in single precision, too


@dataclass(frozen=True, eq=False)
class Cascade:
    """Position P, speed PI and, for drives that take voltages, current PI; every stage limits its output.

        ω = kp (q_r - q) + kv q̇_r      every `position_every` ticks, held in between
        i = PI(ω - q̇)                  every `speed_every` ticks
        u = PI(i - measured current)   every tick, in volts

    Without a current loop, i is the command. Gains are one number or one for each joint, or a `Batch` of such, and above 0
    whatever a gear's sense. A stage's integrator waits, too, while the stage behind it is cut off.

    Args:
        position_kp: [1/s].   speed_feedforward: kv, 1 for all of the reference's speed.
        speed_kp: [U s/rad | U s/m] with U the unit of the speed stage's output.   speed_ki: [U/rad | U/m].
        current_kp: [V/A].   current_ki: [V/(A s)].   Absent: no current loop.
        speed_limit: [rad/s | m/s].   effort_limit: [U] of the speed stage.   voltage_limit: [V]; absent: none.
        position_every, speed_every: ticks from one of the loop's own to the next.   position_phase, speed_phase: its first tick,
            counted from where the controller begins.
        anti_windup: "none", "clamping" or "back-calculation".   tracking_time: [s] of the latter.
        delay_ticks: whole ticks that commands take to the drives, for anti-windup; absent: those of the loop's timing.
        slack: [U] by which a drive may miss a command.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> control = aw.Cascade(position_kp=8.0, speed_kp=[100.0, 20.0])
        >>> loop = aw.Loop(control, aw.trajectories.Step([-1.57, 0.0], [-1.2, 0.2]), 0.002)
        >>> run = aw.simulate(aw.Scenario("two-link", 1.0, loop=loop, start=[-1.57, 0.0]))
        >>> run.q.values[-1].round(2)  # sags, without an integrator
        array([-1.24,  0.15])
    """

    gain_units: ClassVar[dict[str, str]] = {  # U: the unit of the command, Q: rad or m
        "position_kp": "1/s", "speed_kp": "U s/Q", "speed_ki": "U/Q", "current_kp": "V/A", "current_ki": "V/(A s)",
    }  # fmt: skip
    position_kp: Numbers
    speed_kp: Numbers
    speed_ki: Numbers = ZERO
    current_kp: NumbersOrNone = UNSET
    current_ki: Numbers = ZERO
    speed_feedforward: Numbers = ZERO
    speed_limit: NumbersOrNone = UNSET
    effort_limit: NumbersOrNone = UNSET
    voltage_limit: NumbersOrNone = UNSET
    position_every: int = 1
    speed_every: int = 1
    position_phase: int = 0
    speed_phase: int = 0
    anti_windup: Literal["none", "clamping", "back-calculation"] = "clamping"
    tracking_time: float | None = None
    delay_ticks: int | None = None
    slack: Numbers = ZERO
    signs: Any = None  # (n,) of the drives, which the loop fits
    arm: Model | None = None  # likewise
    period: float | None = None  # [s] of the loop, which fits the controller to it

    def __post_init__(self) -> None:
        check_choice("Cascade.anti_windup", self.anti_windup, RULES)
        check_tracking("Cascade", self.anti_windup, self.tracking_time)
        check_delay_ticks("Cascade", self.delay_ticks)
        for loop in RATES:
            every, phase = getattr(self, f"{loop}_every"), getattr(self, f"{loop}_phase")
            expected = f"a whole number of ticks, 1 to {SLOWEST}"
            check_whole("Cascade", f"{loop}_every", every, 1, expected)
            if every > SLOWEST:
                raise ScenarioError(place=f"Cascade.{loop}_every", value=every, expected=expected)
            check_whole("Cascade", f"{loop}_phase", phase, 0, f"a tick from 0 to {loop}_every - 1")
            if phase >= every:
                expected = f"a tick from 0 to {loop}_every - 1 = {every - 1}"
                raise ScenarioError(place=f"Cascade.{loop}_phase", value=phase, expected=expected)
        if self.current_kp is None and self.voltage_limit is not None:
            what, expected = "goes with a current loop", "current_kp beside it"
            raise ScenarioError(what, place="Cascade.voltage_limit", value=self.voltage_limit, expected=expected)

    def configure(self, arm: Model, period: float) -> Cascade:
        """The controller for an arm and a sample period [s]: one gain per joint.

        Args:
            arm: the model.   period: [s].
        Raises:
            ScenarioError: a gain of the wrong length, or one below 0; names it and the joints. A current loop over a drive that
                takes no voltage, or whose current is not known.
        """
        if self.current_kp is not None:
            for body in arm.coordinates:
                if body.drive.command != "voltage" or body.drive.torque_constant is None:
                    what = f"joint {body.joint!r} of {arm.name} is driven by {body.drive.command}"
                    expected = "voltage drives with a torque constant under a current loop"
                    raise ScenarioError(what, place="Cascade.current_kp", value=self.current_kp, expected=expected)
        values = {name: getattr(self, name) for name in GAINS if getattr(self, name) is not None}
        gains = {name: per_joint(arm, "Cascade", name, value) for name, value in values.items()}
        limits: dict[str, Any] = {name: positive_limit(arm, "Cascade", name, getattr(self, name)) for name in LIMITS}
        if self.current_kp is None:
            limits["voltage_limit"] = None
        ticks = self.delay_ticks or 0  # the loop has filled them in
        return replace(self, **gains, **limits, delay_ticks=ticks, signs=command_signs(arm), arm=arm, period=period)

    def init(self, arm: Model, y: Measurement) -> Array:
        """Initial state: ticks to wait for each slower loop, integrators and speed command 0, the commands that were in force."""
        n, waits = arm.n, np.array([getattr(self, f"{loop}_phase") for loop in self._slower], dtype=float)
        output = y.applied if self.current_kp is None else y.current
        parts = [waits, scalar.zeros(n), scalar.zeros(n), self.signs * output, scalar.zeros(n), scalar.zeros(n)]
        return scalar.array(np.concatenate([*parts, *[y.applied] * (1 + (self.delay_ticks or 0))]))

    def step(self, t: Scalar, r: JointReference, y: Measurement, s: Array) -> tuple[Array, Array]:
        """One tick: commands (n,) and the next state."""
        assert self.period is not None
        n, signs, slower = len(r.q), self.signs, self._slower
        waits, s = s[: len(slower)], s[len(slower) :]
        due = {loop: scalar.equal(wait, 0.0) for loop, wait in zip(slower, waits, strict=True)}
        speed, integral, effort, inner, cut = (s[k * n : (k + 1) * n] for k in range(5))
        asked = s[5 * n :]
        missing = signs * shortfall(y.applied, asked[:n], self.slack)
        wanted = self.position_kp * (r.q - y.q) + self.speed_feedforward * r.qd
        wanted = within(wanted, self.speed_limit)
        speed = _held(due.get("position", 1.0), wanted, speed)
        last = self.current_kp is None
        stage = self._stage(self.speed_kp, self.speed_ki, self.effort_limit, self.period * self.speed_every)
        done = stage.step(speed - y.qd, integral, missing=missing if last else 0.0, ahead=0.0 if last else cut)
        turn = due.get("speed", 1.0)
        effort, integral = _held(turn, done.output, effort), _held(turn, done.integral, integral)
        u = effort
        if not last:
            stage = self._stage(self.current_kp, self.current_ki, self.voltage_limit, self.period)
            final = stage.step(effort - signs * y.current, inner, missing=missing)
            u, inner, cut = final.output, final.integral, final.cut
        u = scalar.array(signs * u if self.arm is None else with_goals(self.arm, signs * u, y.q))
        pairs = zip(slower, waits, strict=True)
        waits = [scalar.where(due[loop], getattr(self, f"{loop}_every") - 1.0, wait - 1.0) for loop, wait in pairs]
        return u, scalar.array(np.concatenate([waits, speed, integral, effort, inner, cut, asked[n:], u]))

    def _stage(self, kp: Array, ki: Array, limit: Array, period: float) -> LimitedStage:
        return LimitedStage(kp, ki, limit, period, self.anti_windup, self.tracking_time)

    @property
    def _slower(self) -> list[str]:
        """The loops that are not due in every tick; each has a counter of the ticks until it is, first in the state."""
        return [loop for loop in RATES if getattr(self, f"{loop}_every") > 1]


def _held(due: Scalar, new: Array, old: Array) -> Array:
    """The new values where it is their turn, else the old ones."""
    return scalar.array(np.array([scalar.where(due, a, b) for a, b in zip(new, old, strict=True)], dtype=object))

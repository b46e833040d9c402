"""Sensors of the joints: encoders on the motor or the link, speed from positions, noise. Design section 4, step 1."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.model.joint_signals import joint_signal
from armwright.parameters import UNSET, ZERO, Batch, Numbers, NumbersOrNone
from armwright.scalar import Array, Scalar
from armwright.signals import Signal
from armwright.simulation.checks import check_choice, check_numbers, one_each
from armwright.simulation.plant.view import PlantView

VELOCITIES = (
    "exact",  # as a tachometer without fault would tell
    "difference",  # of the last two positions, over the period
    "filtered",  # the same behind a first-order low-pass filter
    "observer",  # a tracking observer of second order, both poles at -2π cutoff
)
SIDES = ("motor", "link")
SIGNALS = {"q": "position", "qd": "velocity", "current": "current"}


@dataclass(frozen=True)
class Sensors:
    """Sensors of every joint with their errors; without arguments, everything exactly.

    Counts, cutoff and noise may each be a `Batch`, one for each lane.

    Args:
        counts: of the encoders in one turn, or one count for each joint; absent: positions are not quantised.
        side: "motor" or "link": where the encoder sits. A motor's counts are finer by the gear ratio, also of a prismatic joint
            (rad/m).
        counts_per_m: of linear encoders, on prismatic joints with side = "link", which have no turns; one number, or one for
            each joint, of which those of revolute joints are not used.
        velocity: "exact", "difference", "filtered" or "observer".
        cutoff_hz: of the filter or observer.
        position_noise: standard deviation [rad | m] at the joint.   velocity_noise: [rad/s | m/s].
        current_noise: [A].
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> control = aw.JointPID(kp=[900.0, 250.0], kd=[180.0, 50.0], gravity=True)
        >>> sensors = aw.Sensors(counts=4096, side="link", velocity="difference")
        >>> goal = aw.trajectories.Step([0.0, 0.0], [0.5, -0.5])
        >>> loop = aw.Loop(control, goal, period=0.002, sensors=sensors)
        >>> aw.simulate(aw.Scenario("two-link", 1.0, loop=loop)).q.values[-1].round(2)
        array([ 0.5 , -0.49])
    """

    counts: NumbersOrNone = UNSET
    side: Literal["motor", "link"] = "motor"
    velocity: Literal["exact", "difference", "filtered", "observer"] = "exact"
    cutoff_hz: NumbersOrNone = UNSET
    position_noise: Numbers = ZERO
    velocity_noise: Numbers = ZERO
    current_noise: Numbers = ZERO
    counts_per_m: NumbersOrNone = UNSET

    def __post_init__(self) -> None:
        check_choice("sensors.velocity", self.velocity, VELOCITIES)
        check_choice("sensors.side", self.side, SIDES)
        if self.counts is not None:
            expected = "counts above 0 in one turn"
            check_numbers("sensors.counts", self.counts, _positive, expected, per_joint=True, batch=True)
        if self.counts_per_m is not None:
            expected = "counts above 0 in one metre"
            check_numbers("sensors.counts_per_m", self.counts_per_m, _positive, expected, per_joint=True, batch=True)
            if self.side == "motor":
                what, expected = "goes with side = 'link'", "sensors.counts, of a motor's encoder in one turn"
                raise ScenarioError(what, place="sensors.counts_per_m", value=self.counts_per_m, expected=expected)
        filtered = self.velocity in ("filtered", "observer")
        if not filtered and self.cutoff_hz is not None:
            what = f"goes with velocity = 'filtered' or 'observer', not {self.velocity!r}"
            raise ScenarioError(what, place="sensors.cutoff_hz", value=self.cutoff_hz)
        if filtered:
            check_numbers("sensors.cutoff_hz", self.cutoff_hz, _positive, "a frequency above 0", batch=True)
        for name in ("position_noise", "velocity_noise", "current_noise"):
            check_numbers(f"sensors.{name}", getattr(self, name), _not_negative, "a number of 0 or more", batch=True)

    def check(self, arm: Model) -> None:
        """Refuses counts that are not one for each joint of the arm, or whose lengths on prismatic joints are not known.

        Raises:
            ScenarioError: names the counts and the joints, and the key that would do.
        """
        for name in ("counts", "counts_per_m"):
            if getattr(self, name) is not None:
                one_each(f"sensors.{name}", getattr(self, name), arm)
        sliding = [body for body in arm.coordinates if body.kind.units.linear]
        if self.counts_per_m is not None and not sliding:
            what, expected = f"{arm.name} has no prismatic joint", "sensors.counts, in one turn"
            raise ScenarioError(what, place="sensors.counts_per_m", value=self.counts_per_m, expected=expected)
        if self.counts is None:
            return
        if self.side == "link" and sliding and self.counts_per_m is None:
            what = f"the link side of prismatic joint {sliding[0].joint!r} has no turns"
            expected = "sensors.counts_per_m for it, or side = 'motor'"
            raise ScenarioError(what, place="sensors.counts", value=self.counts, expected=expected)
        direct = [
            body.joint
            for body in sliding
            if not scalar.is_symbolic(body.drive.gear_ratio) and body.drive.gear_ratio == 1.0
        ]
        if self.side == "motor" and direct:  # 1 rad/m: no motor in the record, or one that is linear itself
            what = f"the motor of prismatic joint {direct[0]!r} has no gear from turns to metres"
            expected = "its motor.gear_ratio [rad/m] in the record, or side = 'link' and sensors.counts_per_m"
            raise ScenarioError(what, place="sensors.counts", value=self.counts, expected=expected)

    def exact(self) -> Sensors:
        """The sensors without noise."""
        return replace(self, position_noise=0.0, velocity_noise=0.0, current_noise=0.0)

    def signals(self, arm: Model) -> tuple[Signal, ...]:
        """Position, velocity and current of every joint."""
        return tuple(joint_signal(arm, name, about=f"measured {what}") for name, what in SIGNALS.items())

    def draws(self, arm: Model) -> int:
        """Random numbers that a measurement takes: two for a normal one."""
        noisy = (self.position_noise, self.velocity_noise, self.current_noise)
        return 2 * arm.n * sum(_may_be_noisy(noise) for noise in noisy)

    def init(self, plant: PlantView) -> np.ndarray:
        """Memory (k,) before the first tick: the arm had been measured where it is, by the same encoder."""
        if self.velocity == "exact":
            return np.zeros(0)
        q, qd = self._true(plant)
        q = self._quantised(plant.arm, q)
        if self.velocity == "difference":
            return q - 0.0 * qd
        return np.concatenate([q, qd])

    def measure(self, plant: PlantView, s: Array, w: Array) -> tuple[dict[str, Array], Array]:
        """Measured q, qd and current, each (n,), and the memory for the next time; arguments as `Sensor` has them."""
        arm, period = plant.arm, plant.period
        n, normal = arm.n, iter(_normal(w))
        (q, qd), current, memory = self._true(plant), plant.current, s

        def noisy(values: Array, deviation: float) -> Array:
            return (
                values + deviation * scalar.array([next(normal) for _ in range(n)])
                if _may_be_noisy(deviation)
                else values
            )

        position = self._quantised(arm, noisy(q, self.position_noise))
        if self.velocity == "exact":
            speed, memory = qd, memory
        elif self.velocity == "difference":
            speed, memory = (position - memory) / period, position
        elif self.velocity == "filtered":
            keep = self._pole(period)
            speed = keep * memory[n:] + (1.0 - keep) * (position - memory[:n]) / period
            memory = np.concatenate([position, speed])
        else:
            speed, memory = self._observed(period, position, memory)
        measured = [position, noisy(speed, self.velocity_noise)]
        if self.side == "motor":
            measured = [plant.joints_of_motors(each) for each in measured]
        return {"q": measured[0], "qd": measured[1], "current": noisy(current, self.current_noise)}, memory

    def _true(self, plant: PlantView) -> tuple[Array, Array]:
        """Positions and velocities (n,) on the encoder's side, referred to the joints."""
        return (plant.q, plant.qd) if self.side == "link" else (plant.motor_q, plant.motor_qd)

    def _pole(self, period: float) -> Scalar:
        """exp(-2π f Ts): what a first-order filter keeps over a period."""
        assert self.cutoff_hz is not None
        if scalar.is_symbolic(self.cutoff_hz):
            return scalar.exp(-2.0 * np.pi * period * self.cutoff_hz)
        return math.exp(-2.0 * math.pi * self.cutoff_hz * period)

    @property
    def quantised(self) -> bool:
        """True where positions are measured in counts."""
        return self.counts is not None or self.counts_per_m is not None

    @property
    def noisy_current(self) -> bool:
        """True where measured currents are not the true ones."""
        return _may_be_noisy(self.current_noise)

    def _quantised(self, arm: Model, q: Array) -> np.ndarray:
        if not self.quantised:
            return q
        pairs = zip(q, self._resolutions(arm), strict=True)
        return scalar.array(
            [value if step is None else scalar.floor(value / step + 0.5) * step for value, step in pairs]
        )

    def counts_of(self, arm: Model) -> np.ndarray:
        """(n,) one count of each encoder, referred to its joint [rad | m]; 0 where positions are not quantised."""
        return np.array([0.0 if step is None else step for step in self._resolutions(arm)], dtype=float)

    def _resolutions(self, arm: Model) -> list[Scalar | None]:
        """One count of each encoder, referred to its joint [rad | m]; None where positions are not quantised."""
        counts: dict[str, Any] = {"turn": self.counts, "metre": self.counts_per_m}
        keys = {"turn": "sensors.counts", "metre": "sensors.counts_per_m"}
        each = {unit: one_each(keys[unit], value, arm) for unit, value in counts.items() if value is not None}
        steps: list[Scalar | None] = []
        for i, body in enumerate(arm.coordinates):
            linear = self.side == "link" and body.kind.units.linear
            ratio = body.drive.gear_ratio if self.side == "motor" else 1.0
            unit, length = ("metre", 1.0) if linear else ("turn", 2.0 * np.pi)  # [m], [rad]
            steps.append(length / (each[unit][i] * scalar.abs(ratio)) if unit in each else None)
        return steps

    def _observed(self, period: float, position: Array, memory: Array) -> tuple[np.ndarray, np.ndarray]:
        """Tracking observer: q̂ and ω̂ predicted, then corrected by the position with both poles at exp(-2π cutoff Ts)."""
        n = len(position)
        pole = self._pole(period)
        ahead = memory[:n] + period * memory[n:]
        missed = position - ahead
        q = ahead + (1.0 - pole * pole) * missed
        speed = memory[n:] + (1.0 - pole) ** 2 / period * missed
        return speed, np.concatenate([q, speed])


def _may_be_noisy(deviation: Any) -> bool:
    """True for a standard deviation above 0, or one that differs by lane: then lanes with 0 draw numbers too.

    So a part of the lanes draws the same numbers as all of them, also where all of its deviations are 0.
    """
    return isinstance(deviation, Batch) or scalar.is_symbolic(deviation) or deviation > 0.0


def _not_negative(values: np.ndarray) -> np.ndarray:
    return (values >= 0.0) & np.isfinite(values)


def _positive(values: np.ndarray) -> np.ndarray:
    return (values > 0.0) & np.isfinite(values)


def _normal(w: Array) -> list[Scalar]:
    """Standard normal numbers from pairs of uniform ones.  √(-2 ln w₁) cos 2π w₂  [BoxMuller1958]"""
    pairs = zip(w[0::2], w[1::2], strict=True)
    return [scalar.sqrt(-2.0 * scalar.log(a)) * scalar.cos(2.0 * np.pi * b) for a, b in pairs]

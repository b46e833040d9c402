"""The border between servos on a bus and the mechanics they move: goals go out, measurements come in, time is pushed.

Positions are counts of the servo's own encoder, as real numbers without its offset, and speeds counts per second: the side that
owns the arm knows each joint's zero, direction and counts per radian.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Goal:
    """Command to a servo's inner loop.

    Attributes:
        torque: the motor is on.   mode: of `value`: "position" [counts], "speed" [counts/s], "duty" [1] or "current" [A].
        speed: [counts/s] and acceleration: [counts/s²] at which a goal position is approached, inf if not limited.
        limit: largest duty [1], 0 to 1.   current: largest current [A], inf if not limited.
        gains: the registers P, I and D, in their own unit.   dead_band: [counts] below and above the goal.
    """

    torque: bool = False
    mode: str = "position"
    value: float = 0.0
    speed: float = math.inf
    acceleration: float = math.inf
    limit: float = 1.0
    current: float = math.inf
    gains: tuple[int, int, int] = (0, 0, 0)
    dead_band: tuple[int, int] = (0, 0)


@dataclass(frozen=True, slots=True)
class Measurement:
    """Values that a servo measures.

    Attributes:
        position: [counts] of the encoder, without offset.   speed: [counts/s].   load: duty [1], -1 to 1.   current: [A].
        voltage: of the supply [V].   temperature: [°C].
    """

    position: float
    speed: float = 0.0
    load: float = 0.0
    current: float = 0.0
    voltage: float = 7.4
    temperature: float = 30.0


class Plant(Protocol):
    """The mechanics behind the servos, one joint for each, in their order on the bus. It starts at time 0."""

    def command(self, servo: int, goal: Goal) -> None:
        """Puts a goal into force at the present time; called when a goal changes."""
        ...

    def advance(self, until: float) -> None:
        """Simulates on to a time [s] that is not before the present one."""
        ...

    def measure(self, servo: int) -> Measurement:
        """Present measurement of the servo."""
        ...


class KinematicPlant:
    """Joints without mass that go to their goals at the goals' speeds: a stand-in for tests and first steps.

    Args:
        positions: [counts] at time 0, one for each servo.   fastest: [counts/s] where a goal's speed is not limited.
        voltage: of the supply [V].
    """

    def __init__(self, positions: Sequence[float], fastest: float = 3400.0, voltage: float = 7.4):
        self.positions, self.speeds = list(positions), [0.0] * len(positions)
        self.goals = [Goal(value=position) for position in positions]
        self.fastest, self.voltage, self.time = fastest, voltage, 0.0

    def command(self, servo: int, goal: Goal) -> None:
        """Puts a goal into force."""
        self.goals[servo] = goal

    def advance(self, until: float) -> None:
        """Moves every joint towards its goal."""
        seconds, self.time = until - self.time, until
        if seconds <= 0.0:
            return
        for k, goal in enumerate(self.goals):
            far = {"position": goal.value - self.positions[k], "speed": math.inf * goal.value}.get(goal.mode, 0.0)
            most = min(goal.speed if goal.mode == "position" else abs(goal.value), self.fastest) * seconds
            way = max(min(far, most), -most) if goal.torque and far == far else 0.0
            self.positions[k] += way
            self.speeds[k] = way / seconds

    def measure(self, servo: int) -> Measurement:
        """Position and speed of a joint."""
        return Measurement(self.positions[servo], self.speeds[servo], voltage=self.voltage)

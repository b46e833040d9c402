"""Units of the bus: positions in counts, torques in thousandths of the rated torque.

One count and one thousandth are a number of [rad | m] and of the command's unit [A | N m | N]. Both ends of the bus multiply
and round by the functions here, so that a value that crosses it is the same one at both ends, to the bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.errors import BusError, Problem
from armwright.model import Body, Model
from armwright.scalar import Array
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Loop

COUNTS_PER_TURN = 360_000  # milli-degrees, as the LWA 4P's drives count: 57295.7795131 in a radian
COUNTS_PER_METRE = 1e6  # micrometres
THOUSAND = 1000  # thousandths in rated torque
MOST = 2**31 - 1  # of a 32-bit position
OTHERS = {  # commands that no frame carries: what drives take, and where it may run
    "voltage": ("take voltages", ""),
    "position": ("take goals, as servos do", "; servos have a serial line (--serial)"),
}


@dataclass(frozen=True, eq=False)
class BusUnits:
    """Units of all joints of an arm.

    Attributes:
        count: (n,) one count [rad | m].   thousandth: (n,) one thousandth of the rated command [A | N m | N].
        torque: (n,) of a unit of command [N m/A | 1].   signs: (n,) ±1 of a command that turns its joint forward.
    """

    count: np.ndarray
    thousandth: np.ndarray
    torque: np.ndarray
    signs: np.ndarray

    @classmethod
    def of(cls, scenario: Scenario) -> BusUnits:
        """The units of a scenario's arm: its encoders' counts, its drives' limits as rated torque.

        Raises:
            BusError: a drive that takes voltages, that has no limit, or that several joints turn; positions that 32 bits do not
                hold.
        """
        arm = scenario.arm
        sensors = (scenario.loop or Loop()).joint_sensors
        turn = np.broadcast_to(COUNTS_PER_TURN if sensors.counts is None else sensors.counts, arm.n).astype(float)
        metre = COUNTS_PER_METRE if sensors.counts_per_m is None else sensors.counts_per_m
        metre = np.broadcast_to(metre, arm.n).astype(float)
        linear = np.array([body.kind.units.linear for body in arm.coordinates])
        count = np.where(linear, 1.0 / metre, 2.0 * np.pi / turn)
        problems = [
            *_other_commands(arm),
            *(problem for body in arm.coordinates for problem in _refused(body, arm.name)),
        ]
        if problems:
            raise BusError.of(*problems)
        most = np.array([_most(body) for body in arm.coordinates])
        torque = np.array([abs(_torque_of_command(body)) for body in arm.coordinates])
        signs = np.array([np.sign(_torque_of_command(body)) for body in arm.coordinates])
        for body, step in zip(arm.coordinates, count, strict=True):
            farthest = max(map(abs, body.limits.position))
            if farthest / step > MOST:
                what = f"{farthest / step:.3g} counts at the end of joint {body.joint!r}"
                expected = "positions that 32 bits hold: fewer counts, or position limits in the record"
                raise BusError(what, place="loop.sensors.counts", expected=expected)
        return cls(count, most / THOUSAND, torque, signs)

    @property
    def limit(self) -> np.ndarray:
        """(n,) the command of rated torque [A | N m | N]."""
        return THOUSAND * self.thousandth

    def counts(self, q: Array) -> Array:
        """Positions [rad | m] converted to counts, whole numbers."""
        return scalar.floor(q / self.count + 0.5)

    def position(self, counts: Array) -> Array:
        """Counts converted to positions [rad | m]."""
        return counts * self.count

    def thousandths(self, u: Array) -> Array:
        """Commands [A | N m | N] converted to thousandths of the rated one, whole numbers."""
        return scalar.floor(u / self.thousandth + 0.5)

    def command(self, thousandths: Array) -> Array:
        """Thousandths converted to commands [A | N m | N]."""
        return thousandths * self.thousandth


def _torque_of_command(body: Body) -> float:
    """Torque [N m | N] at the joint of a unit of command."""
    drive = body.drive
    if drive.command == "torque":
        return 1.0
    assert drive.torque_constant is not None  # a drive that takes currents has one
    return float(drive.gear_ratio * drive.torque_constant)


def _most(body: Body) -> float:
    """The command of the largest torque that a drive gives."""
    torque = abs(_torque_of_command(body))
    return float(min(body.limits.torque / torque, body.limits.current if body.drive.command == "current" else np.inf))


def _other_commands(arm: Model) -> list[Problem]:
    """A problem for each command that drives take and no frame carries, with the joints of all that take it."""
    problems = []
    for command, (words, more) in OTHERS.items():
        joints = [body.joint for body in arm.coordinates if body.drive.command == command]
        if joints:
            what = f"drives of {arm.name} {words}: {', '.join(joints)}"
            problems.append(Problem(what, "command", command, f"'current' or 'torque', as CiA 402 drives take{more}"))
    return problems


def _refused(body: Body, arm: str) -> list[Problem]:
    """Reasons why a drive cannot be one on the bus."""
    limits, place = body.limits, f"joint {body.joint!r} limits"
    if body.drive.coupling:
        what = f"the motor of joint {body.joint!r} is turned by other joints too"
        return [Problem(what, "motor.coupling", expected="one drive for each joint")]
    if body.drive.command in OTHERS:
        return []
    problems = []
    if not np.isfinite(_most(body)):
        expected = "torque_n_m or current_a in the record: the bus carries thousandths of the rated torque"
        problems.append(Problem("no limit of torque", place, expected=expected, file=arm))
    if not np.all(np.isfinite(limits.position)) or not np.isfinite(limits.velocity):
        expected = "position and velocity limits in the record, which the drive watches"
        problems.append(Problem("no limit", place, expected=expected, file=arm))
    return problems

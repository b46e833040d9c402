"""An arm's servos from the side of the computer that commands them: identity, readings, goals and stop, whatever the motion.

These conditions hold for everything that moves the arm over the bus. In this order:

    1. goals keep the limits of the record, of the encoders and of the calibration; nothing is sent before that
    2. every servo has the model, mode of operation, firmware, offset and limits of the stored calibration; until here, all that
       is sent are instructions that read
    3. goal acceleration, goal speed and torque limit are written, the present position becomes the goal, torque is switched on
    4. every cycle: read; stop if a goal is farther than a step from the measured position, or a servo was silent too long;
       write goals
    5. stop: the present position becomes the goal, with torque on, since an arm without it falls

An XL330 or XL430 gets its bus watchdog. An STS servo has none: if the computer dies, it keeps its last goal.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import tau

import numpy as np

from armwright.errors import BusError, Problem, check_known
from armwright.model import Model
from armwright.trajectory.limits import MotionLimits
from armwright.twin.serial.arm_plant import Mounting
from armwright.twin.serial.calibration import Calibration, registers_of, stored_servo
from armwright.twin.serial.client import PATIENCE, Port, ServoClient
from armwright.twin.serial.dynamixel import TIMED_PROFILE
from armwright.twin.serial.frames import FEETECH
from armwright.twin.serial.registers import ServoModel, servo_model
from armwright.twin.serial.servo_arm import Line, check_baud, ids_of, mountings_of

MISSED = 3  # cycles in a row in which a servo may be silent
MARGIN, SLOW = 1.5, 0.2  # of the goals' largest speed, and [rad/s]: the least goal speed
QUICK, BRISK = 4.0, 20.0  # of the goals' largest acceleration, and [rad/s²]: the least goal acceleration
FEETECH_MODES, DYNAMIXEL_MODES = (0,), (3, 4, 5)  # of the register `operating_mode` in which goals are positions
WATCHDOG, WATCH = 0.1, 0.02  # [s] of silence after which servos that watch the bus stop; of one count of the register
ROUNDING = 1e-9  # of positions and speeds at their limits
MEASURED = ("present_position", "present_velocity", "present_voltage")  # and the load
GOAL, Q, QD, LOAD, VOLTAGE = range(5)  # rows of a reading
HOW = "--calibration FILE; `armwright capture ARM --serial PORT --calibrate FILE` writes one, and LeRobot's is read too"


@dataclass(frozen=True)
class ServoSettings:
    """Limits of what moves an arm of servos.

    Attributes:
        rate: cycles a second [1/s].   step: [rad] that a goal may be away from the measured position.
        torque: largest duty, 0 to 1.   release: True: torque is switched off at the end of a complete run; the arm then falls.
        approach: [rad/s] largest speed of a joint on the way from where the arm stands to where a motion begins.
        patience: [s] for the answers to an instruction.
    """

    rate: float = 50.0
    step: float = 0.3
    torque: float = 0.5
    release: bool = False
    approach: float = 0.2
    patience: float = PATIENCE

    def __post_init__(self) -> None:
        for name, most in (("rate", 1000.0), ("step", tau), ("torque", 1.0), ("approach", tau), ("patience", 60.0)):
            value = getattr(self, name)
            if not 0.0 < value <= most:
                raise BusError(place=name, value=value, expected=f"a number above 0, at most {most:g}")


@dataclass(frozen=True, eq=False)
class ServoFit:
    """Servos on the joints of an arm, and the positions that they may go to.

    Attributes:
        arm: the model.   model: of the servos.   ids, mountings: (n,) of the joints.   calibration: stored; None: there is none.
        allowed: (n, 2) [rad] within the limits of the record, the encoders and the calibration.
    """

    arm: Model
    model: ServoModel
    ids: list[int]
    mountings: list[Mounting]
    calibration: Calibration | None
    allowed: np.ndarray

    @classmethod
    def of(cls, arm: Model, line: Line, calibration: Calibration | None = None) -> ServoFit:
        """The fit of a line's servos, with ids, zeros and directions of the calibration where it has them.

        Raises:
            BusError: ids, zeros or joints that the arm does not have, or that contradict the calibration; no such baud rate.
        """
        model = servo_model(line.model)
        check_baud(model, line.baud)
        if calibration is not None:
            line = _calibrated(arm, line, model, calibration)
        ids, mountings = ids_of(arm, line.ids), mountings_of(arm, line, model)
        ends = np.tile([0.0, model.counts - 1.0], (arm.n, 1))
        if calibration is not None:
            stored = [calibration.joints[name] for name in arm.names]
            ends = np.array([[max(each.range_min, 0), min(each.range_max, model.counts - 1)] for each in stored])
        turns = np.sort([[at.position(end) for end in pair] for at, pair in zip(mountings, ends, strict=True)])
        limits = MotionLimits.of(arm).position
        allowed = np.stack([np.maximum(limits[:, 0], turns[:, 0]), np.minimum(limits[:, 1], turns[:, 1])], axis=1)
        return cls(arm, model, ids, mountings, calibration, allowed)

    def check_goals(self, times: np.ndarray, q: np.ndarray, qd: np.ndarray) -> None:
        """Refuses goals beyond the limits of positions and speeds.

        Args:
            times: (k,) [s].   q, qd: (k, n) [rad], [rad/s].
        Raises:
            BusError: names the joint, the first value beyond a limit, its time and whose limit it is.
        """
        limits = MotionLimits.of(self.arm)
        others = "its encoder" if self.calibration is None else "its encoder and its calibration"
        for i, name in enumerate(self.arm.names):
            for what, values, (low, high), whose in (
                ("position", q[:, i], limits.position[i], "the record"),
                ("position", q[:, i], self.allowed[i], others),
                ("speed", qd[:, i], (-limits.velocity[i], limits.velocity[i]), "the record"),
            ):
                beyond = ~((values >= low - ROUNDING) & (values <= high + ROUNDING))
                if beyond.any():
                    k = int(np.argmax(beyond))
                    unit = "rad/s" if what == "speed" else "rad"
                    raise BusError(
                        f"its {what} is {values[k]:.4g} {unit} at {times[k]:g} s",
                        place=f"joint {name!r}",
                        expected=f"{low:.4g} to {high:.4g}, the limits of {whose}",
                    )

    def goal_limits(self, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Goal speeds [rad/s] and accelerations [rad/s²] (n,) for goals with these speeds and accelerations (k, n)."""
        limits = MotionLimits.of(self.arm)
        speed = np.minimum(np.maximum(MARGIN * np.abs(qd).max(axis=0), SLOW), limits.velocity)
        return speed, np.minimum(np.maximum(QUICK * np.abs(qdd).max(axis=0), BRISK), limits.acceleration)


def _calibrated(arm: Model, line: Line, model: ServoModel, calibration: Calibration) -> Line:
    """The line with the ids of a calibration, and its zeros and directions where it has them."""
    file = calibration.file
    for name in arm.names:
        check_known(BusError, name, calibration.joints, "has no such joint", place="calibration", file=file)
    servos = {name: calibration.joints[name] for name in arm.names}
    ids = [servo.id for servo in servos.values()]
    if line.ids is not None and list(line.ids) != ids:
        raise BusError(place="ids", value=list(line.ids), expected=f"{ids}, or none beside the calibration", file=file)
    zeros, turned = line.zeros, line.reversed
    if any(servo.zero is not None for servo in servos.values()):
        if zeros is not None:
            raise BusError("the calibration has zeros", place="zeros", value=list(zeros), expected="none", file=file)
        zeros = [model.counts / 2.0 if servo.zero is None else servo.zero for servo in servos.values()]
    if any(servo.reversed is not None for servo in servos.values()):
        if turned:
            what = "the calibration has directions"
            raise BusError(what, place="reversed", value=list(turned), expected="none", file=file)
        turned = [name for name, servo in servos.items() if servo.reversed]
    for name, servo in servos.items():
        if servo.drive_mode and "drive_mode" not in model.by_name:
            what = f"{model.name} has no drive mode"
            raise BusError(
                what, place=f"joint {name!r} drive_mode", value=servo.drive_mode, expected="0, and --reverse", file=file
            )
    return Line(line.model, ids, line.baud, zeros, turned)


class ArmServos:
    """An arm's servos on an open port.

    Args:
        port: open.   fit: of the servos.   patience: [s] for the answers to an instruction.

    Attributes:
        client: of the port.   written: (n,) [rad] goals in force; NaN before the first.
        silent: (n,) cycles in a row without an answer that has no error.
    """

    def __init__(self, port: Port, fit: ServoFit, patience: float = PATIENCE):
        self.fit, self.client = fit, ServoClient(port, fit.model, patience)
        self.written, self.silent = np.full(fit.arm.n, np.nan), np.zeros(fit.arm.n, dtype=int)
        self._load = "present_load" if "present_load" in fit.model.by_name else "present_pwm"
        self._returned = np.zeros(fit.arm.n, dtype=bool)  # servos that answer again
        self._prepared: dict[int, dict[str, int]] = {}  # values of registers since `prepare`, by joint

    def read_calibration(self, line: Line | None = None) -> Calibration:
        """Calibration that the servos hold, with the zeros and directions of a line where it has them; only reads.

        Raises:
            BusError: a servo that does not answer, or that is of another model.
        """
        fit, found = self.fit, {}
        for i, (number, name) in enumerate(zip(fit.ids, fit.arm.names, strict=True)):
            values = {register: self.client.read(number, register) for register in registers_of(fit.model)}
            expected = fit.model.by_name["model_number"].default
            if values["model_number"] != expected:
                place, words = f"model of servo {number}, joint {name!r}", f"{expected}, {fit.model.name}"
                raise BusError(place=place, value=values["model_number"], expected=words)
            said = {} if line is None or line.zeros is None else {"zero": float(line.zeros[i])}
            said |= {} if line is None or not line.reversed else {"reversed": name in line.reversed}
            found[name] = stored_servo(fit.model, number, values, **said)
        return Calibration(found)

    def identify(self) -> None:
        """Compares the servos with the stored calibration, where there is one, and their modes with those of goals; only reads.

        Raises:
            BusError: a servo that does not answer, another model, another mode, a difference from the calibration.
        """
        found = self.read_calibration()
        if self.fit.calibration is not None:
            self.fit.calibration.check(found)
        modes = FEETECH_MODES if self.fit.model.framing is FEETECH else DYNAMIXEL_MODES
        for number, name in zip(self.fit.ids, self.fit.arm.names, strict=True):
            mode = self.client.read(number, "operating_mode")
            if mode not in modes:
                place = f"operating mode of servo {number}, joint {name!r}"
                raise BusError(place=place, value=mode, expected=f"{modes[0]}, goals of position")
            if found.joints[name].drive_mode & TIMED_PROFILE:
                place = f"drive mode of servo {number}, joint {name!r}"
                expected = "goal speeds, not profiles by time (bit 2)"
                raise BusError(place=place, value=found.joints[name].drive_mode, expected=expected)

    def check_permitted(self) -> None:
        """Refuses to move an arm without a stored calibration, or with other servos than it names.

        Raises:
            BusError: says what is missing, or what differs.
        """
        if self.fit.calibration is None:
            raise BusError("there is none to compare the servos with", place="calibration", expected=HOW)
        self.identify()

    def positions(self) -> np.ndarray:
        """Positions (n,) [rad] of all joints, each read by itself.

        Raises:
            BusError: a servo does not answer.
        """
        counts = [self.client.read(number, "present_position") for number in self.fit.ids]
        return np.array([at.position(count) for at, count in zip(self.fit.mountings, counts, strict=True)])

    def prepare(self, speed: np.ndarray, acceleration: np.ndarray, torque: float) -> None:
        """Writes limits, then the present position as goal, then torque.

        Args:
            speed, acceleration: (n,) for goals [rad/s], [rad/s²].   torque: largest duty.
        Raises:
            BusError: a servo does not answer, or answers with an error.
        """
        units, registers, client = self.fit.model.units, self.fit.model.by_name, self.client
        for i, number in enumerate(self.fit.ids):
            count, written = abs(self.fit.mountings[i].radians), dict[str, int]()
            for name, value in (
                ("profile_acceleration", acceleration[i] / (count * units["acceleration"])),
                ("profile_velocity", speed[i] / (count * units["speed"])),
                ("torque_limit" if "torque_limit" in registers else "goal_pwm", torque / units["duty"]),
            ):
                high = registers[name].high
                most = registers[name].largest if high is None else high
                client.write(number, name, round(min(max(value, 1.0), most)))
                written[name] = client.read(number, name)  # which a firmware may have limited
            self._prepared[i] = {"torque_enable": 1, **written}
            client.write(number, "goal_position", self._nearest_goal(i, client.read(number, "present_position")))
            client.write(number, "torque_enable", 1)
            if "bus_watchdog" in registers:
                self._prepared[i]["bus_watchdog"] = round(WATCHDOG / WATCH)
                client.write(number, "bus_watchdog", self._prepared[i]["bus_watchdog"])
        self.written = self.positions()

    def _nearest_goal(self, joint: int, count: int) -> int:
        """The goal that is nearest to a position [counts]: a Dynamixel refuses one beyond its limits of position."""
        if self.fit.calibration is None:
            return count
        stored = self.fit.calibration.joints[self.fit.arm.names[joint]]
        return min(max(count, stored.range_min), stored.range_max)

    def confirm(self, joints: Iterable[int] | None = None) -> None:
        """Refuses servos that no longer have what `prepare` wrote: one that restarted has other limits and no torque or
        watchdog, one whose watchdog stopped it takes no goals.

        Args:
            joints: by number; default all.
        Raises:
            BusError: names the joint and the register; a servo that does not answer.
        """
        for i in self._prepared if joints is None else joints:
            number = self.fit.ids[i]
            for name, value in self._prepared[i].items():
                found = self.client.read(number, name)
                if found != value:
                    place = f"{name} of joint {self.fit.arm.names[i]!r}, servo {number}"
                    what = "the servo has restarted, or its watchdog has stopped it"
                    raise BusError(what, place=place, value=found, expected=f"{value}, as it was written")

    def read(self) -> np.ndarray:
        """Goal in force [rad], position [rad], speed [rad/s], load [1] and voltage [V] (5, n); NaN of a silent servo."""
        fit, row = self.fit, np.full((5, len(self.fit.ids)), np.nan)
        read = self.client.sync_read(fit.ids, (*MEASURED, self._load))
        row[GOAL] = self.written
        per_load = 1e-3 if self._load == "present_load" else fit.model.units["duty"]
        for i, (number, at) in enumerate(zip(fit.ids, fit.mountings, strict=True)):
            if number in read:
                values = read[number]
                row[Q:, i] = (
                    at.position(values["present_position"]),
                    values["present_velocity"] * fit.model.units["speed"] * at.radians,
                    values[self._load] * per_load * at.direction,
                    0.1 * values["present_voltage"],
                )
        alarmed = np.array([number in self.client.alarms for number in fit.ids])
        silent = np.where(np.isnan(row[Q]) | alarmed, self.silent + 1, 0)
        self._returned, self.silent = (self.silent > 0) & (silent == 0), silent
        return row

    def command(self, goals: np.ndarray, row: np.ndarray, step: float, when: str) -> None:
        """Writes goals, if they are near enough to what was measured.

        Args:
            goals: (n,) [rad].   row: (5, n) the reading of this cycle.   step: [rad].   when: of the cycle, for errors.
        Raises:
            BusError: a goal that is no number, beyond the limits, or too far from its joint; a servo that is silent, answers with
                errors, or answers again after it has restarted.
        """
        fit = self.fit
        for i, name in enumerate(fit.arm.names):
            if self.silent[i] >= MISSED:
                error = self.client.alarms.get(fit.ids[i])
                what = "was silent" if error is None else f"answers with {self.client.alarm(error)}"
                raise BusError(f"{what} for {MISSED} cycles", place=f"joint {name!r}, servo {fit.ids[i]}")
            low, high = fit.allowed[i]
            if not low - ROUNDING <= goals[i] <= high + ROUNDING:
                what, expected = f"its goal is {goals[i]:.4g} rad {when}", f"{low:.4g} to {high:.4g}, its limits"
                raise BusError(what, place=f"joint {name!r}", expected=expected)
            if abs(goals[i] - row[Q][i]) > step:
                what = f"is {abs(goals[i] - row[Q][i]):.3g} rad from its goal {when}"
                raise BusError(what, place=f"joint {name!r}", expected=f"at most {step:g}")
        self.confirm(np.flatnonzero(self._returned).tolist())
        counts = [round(at.counts(q)) for at, q in zip(fit.mountings, goals, strict=True)]
        self.client.sync_write("goal_position", dict(zip(fit.ids, counts, strict=True)))
        self.written = np.array(goals, dtype=float)

    def hold(self) -> list[Problem]:
        """Makes the present position the goal of every servo that `prepare` reached and that answers; torque stays on.

        Returns:
            problems: joints that could not be stopped, and joints without torque.
        """
        client, watched = self.client, "bus_watchdog" in self.fit.model.by_name
        lost, off = list[str](), list[str]()
        for i in self._prepared:
            number, name = self.fit.ids[i], repr(self.fit.arm.names[i])
            try:
                if watched:
                    client.write(number, "bus_watchdog", 0, despite_alarm=True)
                position = client.read(number, "present_position", despite_alarm=True)
                client.write(number, "goal_position", self._nearest_goal(i, position), despite_alarm=True)
                if not client.read(number, "torque_enable", despite_alarm=True):
                    off.append(name)
            except BusError:
                lost.append(name)  # the others are to stop all the same
        then = "their watchdog stops them" if watched else "they go to their last goals and hold them"
        found = [(lost, f"servos that did not answer when they were to stop: if they have power, {then}")]
        found += [(off, "servos whose torque is off: nothing holds these joints")]
        return [Problem(what, f"joints {', '.join(names)}") for names, what in found if names]

    def release(self) -> None:
        """Switches torque off; an arm that nothing else holds falls.

        Raises:
            BusError: servos that do not answer; those that do are released all the same.
        """
        problems = list[Problem]()
        for number in self.fit.ids:
            try:
                self.client.write(number, "torque_enable", 0, despite_alarm=True)
            except BusError as error:
                problems += error.problems
        if problems:
            raise BusError.of(*problems)

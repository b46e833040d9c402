"""A motion played by an arm of bus servos, and what they measured on the way.

In this order; whatever fails ends it:

    1. the motion keeps the limits of the record and of the encoders; nothing is sent before that
    2. every id answers as the model that was named
    3. every joint stands within `step` of where the motion begins
    4. goal acceleration, goal speed and torque limit are written, the present position becomes the goal, torque is switched on
    5. every cycle: read, stop if a joint is farther than `step` from its goal, write goals
    6. stop: the present position becomes the goal, with torque on, since an arm without it falls

An STS servo has no watchdog of the bus: if the computer dies, it keeps its last goal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import tau
from pathlib import Path

import numpy as np

from armwright.entry import AnyArm, AnyMotion, as_arm, as_motion
from armwright.errors import BusError, RunStopped
from armwright.model import Model
from armwright.results.csv_tables import write_table
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.motion import Motion
from armwright.twin import clock
from armwright.twin.serial.arm_plant import Mounting
from armwright.twin.serial.client import Port, ServoClient
from armwright.twin.serial.frames import FEETECH
from armwright.twin.serial.registers import ServoModel, servo_model
from armwright.twin.serial.servo_arm import Line, ids_of, mountings_of

MISSED = 3  # cycles in a row in which a servo may be silent
MARGIN, SLOW = 1.5, 0.2  # of the motion's largest speed, and [rad/s]: the least goal speed
QUICK, BRISK = 4.0, 20.0  # of the motion's largest acceleration, and [rad/s²]: the least goal acceleration
FEETECH_MODES, DYNAMIXEL_MODES = (0,), (3, 4, 5)  # of the register `operating_mode` in which goals are positions
WATCHDOG, WATCH = 0.1, 0.02  # [s] of silence after which servos that watch the bus stop; of one count of the register
ROUNDING = 1e-9  # of positions and speeds at their limits
MEASURED = ("present_position", "present_velocity", "present_voltage")  # and the load


@dataclass(frozen=True)
class CaptureSettings:
    """How a motion is played.

    Attributes:
        rate: cycles a second [1/s].   step: [rad] that a goal may be away from the measured position.
        torque: largest duty, 0 to 1.   release: whether torque is switched off at the end; the arm then falls.
    """

    rate: float = 50.0
    step: float = 0.3
    torque: float = 0.5
    release: bool = False

    def __post_init__(self) -> None:
        for name, most in (("rate", 1000.0), ("step", tau), ("torque", 1.0)):
            value = getattr(self, name)
            if not 0.0 < value <= most:
                raise BusError(place=name, value=value, expected=f"a number above 0, at most {most:g}")


@dataclass(frozen=True, eq=False)
class CapturePlan:
    """A motion that keeps all limits, in goals for servos.

    Attributes:
        arm, motion: what is moved, and how.   model: of the servos.   ids, mountings: (n,) of the joints.
        times: (k,) [s] of cycles.   goals: (k, n) [rad].   speed, acceleration: (n,) [rad/s], [rad/s²] for goals.
        settings: of the run.
    """

    arm: Model
    motion: Motion
    model: ServoModel
    ids: list[int]
    mountings: list[Mounting]
    times: np.ndarray
    goals: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    settings: CaptureSettings

    def rows(self) -> list[list[str]]:
        """A row for each joint: its id, range [rad], range [counts], largest speed and goal speed [rad/s]."""
        rates = np.abs(np.diff(self.goals, axis=0)).max(axis=0, initial=0.0) * self.settings.rate
        found = []
        for i, name in enumerate(self.arm.names):
            low, high = self.goals[:, i].min(), self.goals[:, i].max()
            ends = sorted(round(self.mountings[i].counts(q)) for q in (low, high))
            words = (f"{low:.4g} to {high:.4g}", f"{ends[0]} to {ends[1]}", f"{rates[i]:.3g}", f"{self.speed[i]:.3g}")
            found.append([name, str(self.ids[i]), *words])
        return found


@dataclass(eq=False)
class Captured:
    """Rows of a run: times [s] when each reading began and ended, and what was read and commanded.

    Attributes:
        names: of the joints.   began, ended: (k,) [s].   rows: (5, n) each: goal in force [rad], q [rad], qd [rad/s], load [1],
            voltage [V]; NaN of a servo that was silent.   missed: answers that did not come.   reason: why it ended.
    """

    names: tuple[str, ...]
    began: list[float] = field(default_factory=list)
    ended: list[float] = field(default_factory=list)
    rows: list[np.ndarray] = field(default_factory=list)
    missed: int = 0
    reason: str = "the motion's end"

    def write(self, path: Path) -> None:
        """Writes a CSV file.

        Raises:
            OutputError: it cannot be written.
        """
        values = np.array(self.rows).reshape(len(self.rows), 5, len(self.names))
        columns = {"t [s]": np.array(self.began), "t_end [s]": np.array(self.ended)}
        for k, (quantity, unit) in enumerate(
            (("goal", "rad"), ("q", "rad"), ("qd", "rad/s"), ("load", "1"), ("voltage", "V"))
        ):
            columns |= {f"{quantity}_{name} [{unit}]": values[:, k, i] for i, name in enumerate(self.names)}
        write_table(path, columns)


def plan_capture(
    arm: AnyArm, motion: AnyMotion, line: Line | None = None, settings: CaptureSettings | None = None
) -> CapturePlan:
    """The goals of a motion, checked against the limits of the record and of the encoders; nothing is sent.

    Args:
        arm: whose servos are moved.   motion: of all joints, from its beginning.   line: of the servos.   settings: of the run.
    Raises:
        BusError: a motion beyond a limit; names the joint, the value and the time.
    """
    arm, line, settings = as_arm(arm), line or Line(), settings or CaptureSettings()
    motion, model, limits = as_motion(motion, arm), servo_model(line.model), MotionLimits.of(arm)
    if not np.isfinite(motion.duration):
        raise BusError("does not end", place="motion", expected="one of finite duration")
    times = np.arange(int(np.ceil(motion.duration * settings.rate)) + 1) / settings.rate
    q, qd, qdd = motion.at(motion.time + np.minimum(times, motion.duration))
    mountings = mountings_of(arm, line, model)
    for i, name in enumerate(arm.names):
        counts = np.array([0.0, model.counts - 1.0])
        turn = np.sort([mountings[i].position(end) for end in counts])
        for what, values, (low, high) in (
            ("position", q[:, i], limits.position[i]),
            ("encoder", q[:, i], turn),
            ("speed", qd[:, i], (-limits.velocity[i], limits.velocity[i])),
        ):
            beyond = (values < low - ROUNDING) | (values > high + ROUNDING)
            if beyond.any():
                k = int(np.argmax(beyond))
                unit = "rad/s" if what == "speed" else "rad"
                raise BusError(
                    f"its {'position' if what == 'encoder' else what} is {values[k]:.4g} {unit} at {times[k]:g} s",
                    place=f"joint {name!r}",
                    expected=f"{low:.4g} to {high:.4g}, the limits of {'its encoder' if what == 'encoder' else 'the record'}",
                )
    speed = np.minimum(np.maximum(MARGIN * np.abs(qd).max(axis=0), SLOW), limits.velocity)
    quick = np.minimum(np.maximum(QUICK * np.abs(qdd).max(axis=0), BRISK), limits.acceleration)
    return CapturePlan(arm, motion, model, ids_of(arm, line.ids), mountings, times, q, speed, quick, settings)


def capture(plan: CapturePlan, port: Port, stopped: Callable[[], bool] = lambda: False) -> Captured:
    """Plays a motion, and returns what the servos measured.

    Args:
        plan: what `plan_capture` returned.   port: open.   stopped: is asked once a cycle; True ends the run.
    Returns:
        captured: the rows.
    Raises:
        BusError: servos that are other ones, that do not answer, or stand elsewhere than the motion begins: before torque.
        RunStopped: a servo that was silent, or too far from its goal; `run` is what was captured.
    """
    client = ServoClient(port, plan.model)
    _check_identity(client, plan)
    q = _positions(client, plan)
    for i, name in enumerate(plan.arm.names):
        if abs(plan.goals[0, i] - q[i]) > plan.settings.step:
            expected = f"within {plan.settings.step:g} of {plan.goals[0, i]:.4g}, where the motion begins"
            raise BusError(place=f"position of joint {name!r} [rad]", value=round(float(q[i]), 4), expected=expected)
    found = Captured(tuple(plan.arm.names))
    try:
        _prepare(client, plan)
        _play(client, plan, found, stopped)
    except BusError as error:
        found.reason = str(error)
        found.missed = client.missed
        _hold(client, plan)
        stop = RunStopped.of(*error.problems)
        stop.run = found
        raise stop from None
    except BaseException:
        _hold(client, plan)
        raise
    found.missed = client.missed
    _hold(client, plan)
    if plan.settings.release:
        for number in plan.ids:
            client.write(number, "torque_enable", 0)
    return found


def _check_identity(client: ServoClient, plan: CapturePlan) -> None:
    for number, name in zip(plan.ids, plan.arm.names, strict=True):
        model = client.read(number, "model_number")
        expected = plan.model.by_name["model_number"].default
        if model != expected:
            raise BusError(
                place=f"model of servo {number}, joint {name!r}", value=model, expected=f"{expected}, {plan.model.name}"
            )
        mode, modes = (
            client.read(number, "operating_mode"),
            FEETECH_MODES if plan.model.framing is FEETECH else DYNAMIXEL_MODES,
        )
        if mode not in modes:
            raise BusError(
                place=f"operating mode of servo {number}, joint {name!r}",
                value=mode,
                expected=f"{modes[0]}, goals of position",
            )


def _positions(client: ServoClient, plan: CapturePlan) -> np.ndarray:
    """Positions (n,) [rad] of all joints, each read by itself."""
    counts = [client.read(number, "present_position") for number in plan.ids]
    return np.array([at.position(count) for at, count in zip(plan.mountings, counts, strict=True)])


def _prepare(client: ServoClient, plan: CapturePlan) -> None:
    """Writes limits, then the present position as goal, then torque."""
    units, registers = plan.model.units, plan.model.by_name
    for i, number in enumerate(plan.ids):
        count = abs(plan.mountings[i].radians)
        for name, value in (
            ("profile_acceleration", plan.acceleration[i] / (count * units["acceleration"])),
            ("profile_velocity", plan.speed[i] / (count * units["speed"])),
            ("torque_limit" if "torque_limit" in registers else "goal_pwm", plan.settings.torque / units["duty"]),
        ):
            most = registers[name].high
            client.write(number, name, min(max(round(value), 1), registers[name].largest if most is None else most))
        client.write(number, "goal_position", client.read(number, "present_position"))
        client.write(number, "torque_enable", 1)
        if "bus_watchdog" in plan.model.by_name:
            client.write(number, "bus_watchdog", round(WATCHDOG / WATCH))


def _play(client: ServoClient, plan: CapturePlan, found: Captured, stopped: Callable[[], bool]) -> None:
    """Cycles: a reading of all servos, then their goals."""
    names = (*MEASURED, "present_load" if "present_load" in plan.model.by_name else "present_pwm")
    silent = np.zeros(len(plan.ids), dtype=int)
    written, start = _positions(client, plan), clock.now()
    for time, goals in zip(plan.times, plan.goals, strict=True):
        clock.sleep_until(start + time)
        began = clock.now() - start
        read = client.sync_read(plan.ids, names)
        row = _row(plan, read, names[-1], written)
        found.began.append(began)
        found.ended.append(clock.now() - start)
        found.rows.append(row)
        silent = np.where(np.isnan(row[1]), silent + 1, 0)
        far = np.abs(goals - row[1]) > plan.settings.step
        for i, name in enumerate(plan.arm.names):
            if silent[i] >= MISSED:
                raise BusError(f"was silent for {MISSED} cycles", place=f"joint {name!r}, servo {plan.ids[i]}")
            if far[i]:
                what = f"is {abs(goals[i] - row[1][i]):.3g} rad from its goal at {time:g} s"
                raise BusError(what, place=f"joint {name!r}", expected=f"at most {plan.settings.step:g}")
        if stopped():
            found.reason = "it was stopped"
            return
        counts = [round(at.counts(q)) for at, q in zip(plan.mountings, goals, strict=True)]
        client.sync_write("goal_position", dict(zip(plan.ids, counts, strict=True)))
        written = goals


def _row(plan: CapturePlan, read: dict[int, dict[str, int]], load: str, goals: np.ndarray) -> np.ndarray:
    """Goal in force, position, speed, load and voltage (5, n) of a reading."""
    row, units = np.full((5, len(plan.ids)), np.nan), plan.model.units
    row[0] = goals
    for i, (number, at) in enumerate(zip(plan.ids, plan.mountings, strict=True)):
        if number in read:
            values = read[number]
            per_load = 1e-3 if load == "present_load" else units["duty"]
            row[1:, i] = (
                at.position(values["present_position"]),
                values["present_velocity"] * units["speed"] * at.radians,
                values[load] * per_load * at.direction,
                0.1 * values["present_voltage"],
            )
    return row


def _hold(client: ServoClient, plan: CapturePlan) -> None:
    """Makes the present position the goal of every servo that answers; torque stays on."""
    for number in plan.ids:
        try:
            if "bus_watchdog" in plan.model.by_name:
                client.write(number, "bus_watchdog", 0)
            client.write(number, "goal_position", client.read(number, "present_position"))
        except BusError:
            continue  # the others are to stop all the same

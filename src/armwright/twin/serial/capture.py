"""A motion played by an arm of bus servos, and what they measured on the way.

The conditions of `arm_servos.py` hold. Between switching torque on and the motion, the arm goes slowly from where it stands to
where the motion begins.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from armwright.entry import AnyArm, AnyMotion, as_arm, as_motion
from armwright.errors import BusError, Problem, RunStopped
from armwright.identification.logs.write import write_measured
from armwright.model import Model
from armwright.results.csv_tables import write_table
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.motion import Motion
from armwright.trajectory.rest_to_rest import Quintic
from armwright.twin import clock
from armwright.twin.serial.arm_servos import GOAL, LOAD, QD, VOLTAGE, ArmServos, Q, ServoFit, ServoSettings
from armwright.twin.serial.calibration import Calibration
from armwright.twin.serial.client import Port
from armwright.twin.serial.servo_arm import Line

COMPLETE = "the motion's end"  # why a run ended
LEAST = 0.5  # [s] of an approach
LATE, BEHIND = 0.5, 0.5  # of a period: a cycle that began later is counted; [s] that a run may be behind its times
COLUMNS = {"goal": (GOAL, "rad"), "q": (Q, "rad"), "qd": (QD, "rad/s"), "load": (LOAD, "1"), "voltage": (VOLTAGE, "V")}
BEFORE = "it was stopped before torque was switched on"
MOTOR = "motor_voltage"  # [V] of a motor, the load's part of the supply


@dataclass(frozen=True, eq=False)
class CapturePlan:
    """A motion that keeps all limits, in goals for servos.

    Attributes:
        fit: of the servos.   motion: to be played.   times: (k,) [s] of cycles.   goals: (k, n) [rad].
        speed, acceleration: (n,) [rad/s], [rad/s²] for goals.   settings: of the run.
    """

    fit: ServoFit
    motion: Motion
    times: np.ndarray
    goals: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    settings: ServoSettings

    def rows(self) -> list[list[str]]:
        """A row for each joint: its id, range [rad], range [counts], largest speed and goal speed [rad/s]."""
        rates = np.abs(np.diff(self.goals, axis=0)).max(axis=0, initial=0.0) * self.settings.rate
        found = []
        for i, name in enumerate(self.fit.arm.names):
            low, high = self.goals[:, i].min(), self.goals[:, i].max()
            ends = sorted(round(self.fit.mountings[i].counts(q)) for q in (low, high))
            words = (f"{low:.4g} to {high:.4g}", f"{ends[0]} to {ends[1]}", f"{rates[i]:.3g}", f"{self.speed[i]:.3g}")
            found.append([name, str(self.fit.ids[i]), *words])
        return found

    @property
    def longest_approach(self) -> Approach:
        """The approach from the farthest corner of all that is allowed."""
        low, high = self.fit.allowed.T
        farther = np.abs(low - self.goals[0]) > np.abs(high - self.goals[0])
        return approach(self.fit, np.where(farther, low, high), self.goals[0], self.settings)


@dataclass(frozen=True, eq=False)
class Approach:
    """The slow way to where a motion begins.

    Attributes:
        names: of the joints.   motion: of all of them.
    """

    names: tuple[str, ...]
    motion: Quintic

    @property
    def ways(self) -> np.ndarray:
        """(n,) [rad] of each joint, with their signs."""
        return np.asarray(self.motion.goal) - np.asarray(self.motion.start)

    def __str__(self) -> str:
        i = int(np.argmax(np.abs(self.ways)))
        return (
            f"{self.motion.duration:.3g} s to where the motion begins, {self.names[i]} farthest: {self.ways[i]:.3g} rad"
        )


def approach(fit: ServoFit, q: np.ndarray, goal: np.ndarray, settings: ServoSettings) -> Approach:
    """The slow way from where an arm stands: a polynomial of fifth degree, whose largest speed is that of the settings.

    A joint that stands beyond its limits, by a step at most, begins at the limit.

    Args:
        fit: of the servos.   q, goal: (n,) [rad].   settings: with the speed and the step.
    Raises:
        BusError: a joint that stands farther beyond its limits.
    """
    limits, peaks = MotionLimits.of(fit.arm), Quintic.PEAKS
    low, high = fit.allowed.T
    start = np.clip(q, low, high)
    for i, name in enumerate(fit.arm.names):
        if abs(start[i] - q[i]) > settings.step:
            expected = f"{low[i]:.4g} to {high[i]:.4g}, its limits, or at most {settings.step:g} beyond"
            raise BusError(place=f"position of joint {name!r} [rad]", value=round(float(q[i]), 4), expected=expected)
    ways = np.abs(goal - start)
    by_speed = peaks[0] * ways / np.minimum(settings.approach, limits.velocity)
    by_acceleration = np.sqrt(peaks[1] * ways / limits.acceleration)
    duration = max(LEAST, *by_speed, *by_acceleration)
    return Approach(tuple(fit.arm.names), Quintic(start, goal, duration=float(duration)))


@dataclass(eq=False)
class Captured:
    """Rows of a run: times [s] when each reading began and ended, and what was read and commanded.

    Attributes:
        names: of the joints.   began, ended: (k,) [s].   rows: (5, n) each: goal in force [rad], q [rad], qd [rad/s], load [1],
            voltage [V]; NaN of a servo that was silent.   missed: answers that did not come.
        late: cycles that began more than half a period late.   reason: why it ended.
    """

    names: tuple[str, ...]
    began: list[float] = field(default_factory=list)
    ended: list[float] = field(default_factory=list)
    rows: list[np.ndarray] = field(default_factory=list)
    missed: int = 0
    reason: str = COMPLETE
    late: int = 0

    @property
    def complete(self) -> bool:
        """True unless something ended it early."""
        return self.reason == COMPLETE

    def __str__(self) -> str:
        late = f", {self.late} of {len(self.rows)} cycles late" if self.late else ""
        return f"{self.reason}, {self.missed} answers missed{late}"

    def write(self, path: Path, arm: Model) -> Path:
        """Writes a CSV file, and beside it the log file NAME.log.toml, which `identify` and `validate` read.

        Its measurements are positions and the motors' voltages, at the times when readings began.

        Args:
            path: of the CSV file.   arm: that moved.
        Returns:
            log: path of the log file.
        Raises:
            OutputError: it cannot be written.
        """
        values = np.array(self.rows).reshape(len(self.rows), len(COLUMNS), len(self.names))
        columns = {"t [s]": np.array(self.began), "t_end [s]": np.array(self.ended)}
        for quantity, (k, unit) in COLUMNS.items():
            columns |= {f"{quantity}_{name} [{unit}]": values[:, k, i] for i, name in enumerate(self.names)}
        motors = values[:, LOAD] * values[:, VOLTAGE]
        columns |= {f"{MOTOR}_{name} [V]": motors[:, i] for i, name in enumerate(self.names)}
        write_table(path, columns)
        return write_measured(path, path.with_suffix(".log.toml"), arm, {"position": "q", "voltage": MOTOR})


def plan_capture(
    arm: AnyArm,
    motion: AnyMotion,
    line: Line | None = None,
    settings: ServoSettings | None = None,
    calibration: Calibration | None = None,
) -> CapturePlan:
    """The goals of a motion, checked against the limits of the record, of the encoders and of the calibration; sends nothing.

    Args:
        arm: whose servos are moved.   motion: of all joints, from its beginning.   line: of the servos.   settings: of the run.
        calibration: stored, which `capture` needs.
    Raises:
        BusError: a motion beyond a limit, which names the joint, the value and the time; a calibration of another arm.
    """
    arm, line, settings = as_arm(arm), line or Line(), settings or ServoSettings()
    motion, fit = as_motion(motion, arm), ServoFit.of(arm, line, calibration)
    if not np.isfinite(motion.duration):
        raise BusError("does not end", place="motion", expected="one of finite duration")
    times = np.arange(int(np.ceil(motion.duration * settings.rate)) + 1) / settings.rate
    q, qd, qdd = motion.at(motion.time + np.minimum(times, motion.duration))
    fit.check_goals(times, q, qd)
    slow = np.full((1, arm.n), settings.approach)
    return CapturePlan(fit, motion, times, q, *fit.goal_limits(np.concatenate([qd, slow]), qdd), settings)


def capture(
    plan: CapturePlan,
    port: Port,
    stopped: Callable[[], bool] = lambda: False,
    say: Callable[[str], None] = lambda text: None,
) -> Captured:
    """Plays a motion, and returns what the servos measured.

    Args:
        plan: what `plan_capture` returned.   port: open.   stopped: is asked once a cycle; True ends the run.
        say: is called with the length of the approach before the arm moves.
    Returns:
        captured: the rows of the motion; none of the approach.
    Raises:
        BusError: no calibration, servos that differ from it or do not answer, an arm that stands too far beyond its limits:
            before torque.
        RunStopped: a servo that was silent, has restarted or was too far from its goal, cycles longer than their period, a joint
            that could not be stopped or released at the end; `run` is what was captured.
    """
    servos = ArmServos(port, plan.fit, plan.settings.patience)
    servos.check_permitted()
    first = approach(plan.fit, servos.positions(), plan.goals[0], plan.settings)
    say(f"approach of {first}")
    found = Captured(tuple(plan.fit.arm.names))
    if stopped():
        found.reason = BEFORE
        return found
    with ending(servos, found, plan.settings):
        servos.prepare(plan.speed, plan.acceleration, plan.settings.torque)
        if go_to(servos, first, plan.settings, found, stopped):
            play(servos, plan.times, lambda k, row: plan.goals[k], plan.settings, found, stopped)
    return found


@contextlib.contextmanager
def ending(servos: ArmServos, found: Captured, settings: ServoSettings, run: Any = None) -> Iterator[None]:
    """Stops the arm at the end of what stands inside, whatever ends it, and releases it after a complete run if that was said.

    Raises:
        RunStopped: in place of a BusError, and if joints could not be stopped or released; its `run` is that of the arguments,
            else what was captured.
    """
    problems, held = list[Problem](), list[Problem]()
    try:
        yield
    except BusError as error:
        problems += error.problems
    finally:
        found.missed = servos.client.missed
        held += servos.hold()
    if settings.release and found.complete and not problems:
        try:
            servos.release()
        except BusError as error:
            problems += error.problems
    if problems or held:
        stop = RunStopped.of(*problems, *held)
        found.reason = str(BusError.of(*problems)) if problems else f"{found.reason}; {stop}"
        stop.run = run or found
        raise stop from None


def go_to(
    servos: ArmServos, way: Approach, settings: ServoSettings, found: Captured, stopped: Callable[[], bool]
) -> bool:
    """Goes an approach to its end; False if it was stopped.

    Raises:
        BusError: a servo that was silent, or too far from its goal.
    """
    duration = way.motion.duration
    times = np.arange(int(np.ceil(duration * settings.rate)) + 1) / settings.rate
    goals = way.motion.at(np.minimum(times, duration))[0]
    aside = Captured(found.names)
    done = play(servos, times, lambda k, row: goals[k], settings, aside, stopped, " of the approach")
    found.reason = found.reason if done else f"{aside.reason} on the way to its beginning"
    return done


def play(
    servos: ArmServos,
    times: np.ndarray,
    goal: Callable[[int, np.ndarray], np.ndarray],
    settings: ServoSettings,
    found: Captured,
    stopped: Callable[[], bool],
    part: str = "",
) -> bool:
    """Cycles: a reading of all servos, then their goals; False if it was stopped.

    Args:
        servos: with torque on.   times: (k,) [s] of cycles.   goal: of a cycle's number and its reading (5, n): (n,) [rad].
        settings: of the run.   found: takes the rows.   stopped: is asked once a cycle.   part: of the run, for errors.
    Raises:
        BusError: a servo that was silent or has restarted, a goal that is too far from its joint or beyond its limits, cycles
            that take longer than their period.
    """
    start = clock.now()
    for k, time in enumerate(times):
        clock.sleep_until(start + time)
        began = clock.now() - start
        found.late += began - time > LATE / settings.rate
        if began - time > BEHIND and not servos.silent.any():  # else the wait for an answer is the cause
            what = (
                f"the cycle at {time:g} s{part} began {began - time:.3g} s late; a cycle took {began / max(k, 1):.3g} s"
            )
            raise BusError(
                what, place="period", value=1.0 / settings.rate, expected="one that frames and adapter fit into"
            )
        row = servos.read()
        found.began.append(began)
        found.ended.append(clock.now() - start)
        found.rows.append(row)
        if stopped():
            found.reason = "it was stopped"
            return False
        servos.command(goal(k, row), row, settings.step, f"at {time:g} s{part}")
    servos.confirm()
    return True

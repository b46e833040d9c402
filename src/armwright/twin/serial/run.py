"""A scenario's controller run over a bus of servos: its commands are their goals.

The rehearsal is the same run, simulated: positions and goals are whole counts, speeds are made of positions, and a goal comes
into force when the frames of a cycle have passed the line. With `--go`, the conditions of `arm_servos.py` hold.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from armwright import scalar
from armwright.description.paths import path_name
from armwright.entry import AnyScenario
from armwright.errors import BusError, Problem
from armwright.export.controller.recording import record
from armwright.export.controller.stages import ControllerStages
from armwright.model import Model
from armwright.results.result import Result
from armwright.results.table import Table, number
from armwright.scalar import Array
from armwright.simulation.scenario import Scenario
from armwright.trajectory.limits import MotionLimits
from armwright.twin.law import Law
from armwright.twin.on_bus import OnBus, checked_run, replaced, speeds_on_bus
from armwright.twin.rehearsal import SimulatedRun
from armwright.twin.run import LEAST_ERROR, MARGIN
from armwright.twin.safety import reduced
from armwright.twin.serial.arm_plant import LIMIT, Mounting, require_servos
from armwright.twin.serial.arm_servos import MEASURED, ArmServos, Q, ServoFit, ServoSettings
from armwright.twin.serial.bus import wire_time
from armwright.twin.serial.calibration import Calibration
from armwright.twin.serial.capture import BEFORE, COLUMNS, Captured, approach, ending, go_to, play
from armwright.twin.serial.client import Port
from armwright.twin.serial.frames import BROADCAST
from armwright.twin.serial.registers import ServoModel
from armwright.twin.serial.servo import TICK
from armwright.twin.serial.servo_arm import Line


@dataclass(frozen=True, eq=False)
class ServoUnits:
    """Units of positions and goals on the line: whole counts of each encoder.

    Attributes:
        zero: (n,) [counts] at q = 0.   radians: (n,) of one count [rad], with the sign of its direction.
    """

    zero: np.ndarray
    radians: np.ndarray

    @classmethod
    def of(cls, mountings: Sequence[Mounting]) -> ServoUnits:
        """Units of servos that sit so on their joints."""
        return cls(np.array([at.zero for at in mountings]), np.array([at.radians for at in mountings]))

    @property
    def count(self) -> np.ndarray:
        """(n,) one count [rad]."""
        return np.abs(self.radians)

    def counts(self, q: Array) -> Array:
        """Positions [rad] converted to counts, whole numbers."""
        return scalar.floor(self.zero + q / self.radians + 0.5)

    def position(self, counts: Array) -> Array:
        """Counts converted to positions [rad]."""
        return (counts - self.zero) * self.radians

    thousandths = counts  # by which `OnBus` knows the whole numbers of commands
    command = position


@dataclass(frozen=True, eq=False)
class ServoRehearsal(SimulatedRun):
    """A simulated run over a bus of servos.

    Attributes:
        scenario: as it runs over the line.   stages: the controller's programs.   recording: references, measurements, goals.
        source: the scenario without the line, at this speed and torque.   fit: of the servos.   settings: of the run.
        line_time: [s] that the frames of a cycle take.
    """

    fit: ServoFit
    settings: ServoSettings
    line_time: float

    @property
    def times(self) -> np.ndarray:
        """(ticks,) [s] of the cycles."""
        return self.stages.period * np.arange(self.recording.ticks)

    def tables(self) -> list[Table]:
        """A row for each joint: its id, its range, its goals' range, largest speed beside what the record allows, and error."""
        arm, u = self.scenario.arm, self.recording.u
        allowed = [body.limits.velocity for body in arm.coordinates]
        columns = (self.q.min(axis=0), self.q.max(axis=0), u.min(axis=0), u.max(axis=0))
        columns = (*columns, self.largest_speed, allowed, self.largest_error)
        heads = ("joint", "id", "lowest [rad]", "highest [rad]", "lowest goal [rad]", "highest goal [rad]")
        heads = (*heads, "velocity [rad/s]", "allowed [rad/s]", "error [rad]")
        ids = self.fit.ids
        rows = [[name, str(ids[i]), *(number(each[i], ".4g") for each in columns)] for i, name in enumerate(arm.names)]
        return [Table(self.heading, heads, rows)]

    def sentences(self) -> list[str]:
        """The time that frames take, and a step at the start."""
        share = self.line_time / self.stages.period
        return [
            f"frames of a cycle take {1e3 * self.line_time:.3g} ms, {share:.0%} of its period",
            *self.step_at_start(),
        ]


def rehearse_servos(
    scenario: AnyScenario,
    line: Line | None = None,
    *,
    calibration: Calibration | None = None,
    settings: ServoSettings | None = None,
    speed: float = 1.0,
) -> ServoRehearsal:
    """The simulated run of a scenario's controller over a bus of servos.

    Args:
        scenario: as it was written.   line: of the servos.   calibration: stored.
        settings: of the run; its rate is that of the scenario's loop.   speed: of the reference, in parts of it.
    Returns:
        rehearsal: of all ticks, whose limits were checked.
    Raises:
        BusError: all that is wrong: drives that follow no goals, no controller, duration or positions to follow, a measurement
            that frames do not carry, a period that they do not fit into; a motion or goals beyond the limits.
        ScenarioError: a controller that cannot be traced, or a motion that diverges.
    """
    line, settings = line or Line(), settings or ServoSettings()
    scenario, problems = checked_run(scenario, "whole counts of the servos")
    arm = scenario.arm
    require_servos(arm)
    if np.any(scenario.initial_state[0, arm.n : 2 * arm.n]):
        problems.append(Problem("the arm moves at the start", "start.qd", expected="0: it begins at rest"))
    if scenario.inputs.enabled is not None:
        problems.append(Problem("servos that are off", "inputs.enabled", expected="none: all servos are on in a run"))
    if problems:
        raise BusError.of(*problems)
    source = reduced(scenario, speed)
    source = replaced(source, vary={**source.vary, **_vary(arm, settings.torque)})
    fit = ServoFit.of(source.arm, line, calibration)
    needed = line_time(fit.model, arm.n, line.baud)
    if needed >= source.tick:
        what = f"frames of a cycle take {1e3 * needed:.3g} ms"
        raise BusError(what, place="loop.period", value=source.tick, expected="a period that they fit into")
    on_line = scenario_on_line(source, fit, needed)
    stages = ControllerStages.of(on_line)
    settings = replace(settings, rate=1.0 / source.tick)
    found = ServoRehearsal(on_line, stages, record(stages, on_line.ticks), source, fit, settings, needed)
    found.check_limits(ServoUnits.of(fit.mountings).count)
    fit.check_goals(found.times, found.recording.u, np.zeros_like(found.recording.u))
    return found


def goal_limits(arm: Model) -> tuple[np.ndarray, np.ndarray]:
    """Speeds [rad/s] and accelerations [rad/s²] (n,) of goals: the record's of firmware, at most those of its joints."""
    limits, loops = MotionLimits.of(arm), [body.drive.firmware for body in arm.coordinates]
    speed = np.array([np.inf if each is None or each.speed is None else float(each.speed) for each in loops])
    quick = np.array(
        [np.inf if each is None or each.acceleration is None else float(each.acceleration) for each in loops]
    )
    return np.minimum(speed, limits.velocity), np.minimum(quick, limits.acceleration)


def _vary(arm: Model, duty: float) -> dict[str, float]:
    """Numbers of firmware that a run limits, by the paths of their parameters, where those of the record are larger."""
    found = {}
    for i, body in enumerate(arm.coordinates):
        firmware, (speed, quick) = body.drive.firmware, goal_limits(arm)
        assert firmware is not None
        for name, value, most in (
            (LIMIT, firmware.limit, duty if firmware.output == "duty" else np.inf),
            ("goal_speed_rad_per_s", firmware.speed, speed[i]),
            ("goal_acceleration_rad_per_s2", firmware.acceleration, quick[i]),
        ):
            if value is not None and float(value) > most:
                found[f"{path_name(body.joint)}.firmware.{name}"] = float(most)
    return found


def line_time(model: ServoModel, joints: int, baud: int) -> float:
    """Time [s] of a cycle's frames: a reading of all servos with their return delays as from the factory, and their goals.

    Args:
        model: of the servos.   joints: how many.   baud: [bit/s].
    """
    framing, word = model.framing, model.framing.word
    load = "present_load" if "present_load" in model.by_name else "present_pwm"
    read = [model.by_name[name] for name in (*MEASURED, load)]
    span = max(each.end for each in read) - min(each.address for each in read)
    asking = len(framing.pack(BROADCAST, 0, bytes(2 * word + joints)))
    answers = joints * len(framing.status(1, 0, bytes(span)))
    writing = len(framing.pack(BROADCAST, 0, bytes(2 * word + joints * (1 + model.by_name["goal_position"].size))))
    delay = TICK * (model.by_name["return_delay_time"].default or 0)
    return wire_time(asking + answers + writing, baud) + joints * delay


def scenario_on_line(scenario: Scenario, fit: ServoFit, delay: float) -> Scenario:
    """The scenario as run over the line: positions and goals in whole counts, which act behind the frames of a cycle.

    Args:
        scenario: with a sampled loop and a controller.   fit: of the servos.   delay: [s] of a cycle's frames.
    Raises:
        BusError: a measurement that frames do not carry.
    """
    loop = scenario.loop
    assert loop is not None
    sensors = replace(speeds_on_bus(scenario), counts=None, counts_per_m=None)  # `OnBus` rounds positions
    law = OnBus(loop.controller, units=ServoUnits.of(fit.mountings), sensors=sensors.exact())
    timing = replace(loop.timing, preset="ideal", command_delay=loop.timing.command_delay + delay)
    measured = replace(sensors, velocity="exact", cutoff_hz=None)  # speeds are made of positions at the other end
    return replaced(scenario, loop=replace(loop, controller=law, period=scenario.tick, sensors=measured, timing=timing))


@dataclass(frozen=True, eq=False)
class ServoRun(Result):
    """A run over a bus of servos.

    Attributes:
        rehearsal: the same run as it was simulated.   captured: the readings of all cycles.
    """

    rehearsal: ServoRehearsal
    captured: Captured = field(repr=False)

    @property
    def time(self) -> np.ndarray:
        """(k,) [s] when readings began."""
        return np.array(self.captured.began)

    @property
    def q(self) -> np.ndarray:
        """(k, n) measured positions [rad]; NaN of a servo that was silent."""
        return np.array(self.captured.rows).reshape(-1, len(COLUMNS), self.rehearsal.scenario.arm.n)[:, Q]

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.rehearsal.scenario.arm.name}: run over servos of {len(self.q)} cycles"

    @property
    def complete(self) -> bool:
        """True if the run reached its end."""
        return self.captured.complete and len(self.q) == self.rehearsal.recording.ticks

    @property
    def good(self) -> bool:
        """True for a complete run."""
        return self.complete

    def sentences(self) -> list[str]:
        """Cause of the end, and the numbers of missed answers and late cycles."""
        return [f"ended by {self.captured}"]

    def tables(self) -> list[Table]:
        """A row for each joint: its largest error, and its largest difference from the simulated run."""
        q, simulated = self.q, self.rehearsal
        differences = [q - values[: len(q)] for values in (simulated.reference, simulated.q)]
        columns = [np.nanmax(np.abs(each), axis=0, initial=0.0) for each in differences]
        names = self.rehearsal.scenario.arm.names
        rows = [[name, *(number(each[k], ".4g") for each in columns)] for k, name in enumerate(names)]
        return [Table(self.heading, ("joint", "largest error [rad]", "from the simulation [rad]"), rows)]


def run_on_servos(
    rehearsal: ServoRehearsal,
    port: Port,
    *,
    stopped: Callable[[], bool] = lambda: False,
    following_error: float | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> ServoRun:
    """The run of a controller over a bus of servos.

    The arm goes slowly to where the scenario begins, and the controller commands goals. Whatever ends the run, the present
    position becomes the goal, with torque on.

    Args:
        rehearsal: with a calibration.   port: open.   stopped: is asked once a cycle; True ends the run.
        following_error: [rad] at which the run ends; default: twice the rehearsal's largest, and at least 0.0175.
        say: is called with the length of the approach before the arm moves.
    Returns:
        run: what was measured; not complete if it was stopped.
    Raises:
        BusError: no calibration, servos that differ from it or do not answer, an arm too far beyond its limits: before torque.
        RunStopped: as of `capture`, and a following error that is too large; `run` is what was recorded.
    """
    fit, settings = rehearsal.fit, rehearsal.settings
    most = np.maximum(MARGIN * rehearsal.largest_error, LEAST_ERROR)
    if following_error is not None:
        if not following_error > 0.0:
            raise BusError(place="following_error", value=following_error, expected="a number above 0 [rad]")
        most = np.full(fit.arm.n, following_error)
    law, servos = Law(rehearsal), ArmServos(port, fit, settings.patience)
    servos.check_permitted()
    start = rehearsal.scenario.initial_state[0, : fit.arm.n]
    first = approach(fit, servos.positions(), start, settings)
    say(f"approach of {first}")
    found = Captured(tuple(fit.arm.names))
    run = ServoRun(rehearsal, found)
    if stopped():
        found.reason = BEFORE
        return run
    seen = np.array(start)

    def goal(tick: int, row: np.ndarray) -> np.ndarray:
        """The controller's goals; a servo that is silent is where it was last."""
        seen[:] = np.where(np.isnan(row[Q]), seen, row[Q])
        if tick == 0:
            law.begin(seen, servos.written)
        error = np.abs(rehearsal.reference[tick] - seen)
        if np.any(error > most):
            i = int(np.argmax(error / most))
            what = f"following error {error[i]:.4g} rad at {rehearsal.times[tick]:g} s"
            raise BusError(what, place=f"joint {fit.arm.names[i]!r}", expected=f"at most {most[i]:.4g}")
        return law.command(tick, rehearsal.recording.r[tick], seen, servos.written)

    with ending(servos, found, settings, run):
        servos.prepare(*goal_limits(fit.arm), settings.torque)
        if go_to(servos, first, settings, found, stopped):
            play(servos, rehearsal.times, goal, settings, found, stopped)
    return run

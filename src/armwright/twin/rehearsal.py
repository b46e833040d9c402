"""Rehearsal: a run over a bus, simulated beforehand, with its commands, ranges and speeds."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armwright.entry import AnyScenario, as_scenario
from armwright.errors import BusError
from armwright.export.controller.recording import ControllerRecording, record
from armwright.export.controller.stages import ControllerStages
from armwright.results.result import Result
from armwright.results.table import Table, number
from armwright.simulation.loop.references import AWAY, reference_rows
from armwright.simulation.scenario import Scenario
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.online import filtered
from armwright.twin.bus import BITRATE, BusLoad
from armwright.twin.drive import SPEEDING
from armwright.twin.on_bus import scenario_on_bus
from armwright.twin.safety import reduced
from armwright.twin.units import BusUnits

PROPORTION = 1.5  # of the speed in proportion: a reduced run may overshoot a little more
SLOW = 0.02  # of the speed limit: slower than that a joint may be at any setting
RISE = 0.25  # [s] of a limited move from rest to its speed, where the record states no acceleration
ROUNDED = 0.05  # [s] of the rise of its acceleration, where the record states no jerk


@dataclass(frozen=True, eq=False)
class SimulatedRun(Result):
    """A controller's run over any bus, simulated beforehand.

    Attributes:
        scenario: as it runs over the bus.   stages: the controller's programs.   recording: references, measurements, commands.
        source: the scenario without the bus, at this speed and torque.
    """

    scenario: Scenario
    stages: ControllerStages
    recording: ControllerRecording
    source: Scenario

    @property
    def q(self) -> np.ndarray:
        """(ticks, n) measured positions [rad | m]."""
        return self.recording.y[:, : self.scenario.arm.n]

    @property
    def reference(self) -> np.ndarray:
        """(ticks, n) reference positions [rad | m]."""
        return self.recording.r[:, : self.scenario.arm.n]

    @property
    def largest_error(self) -> np.ndarray:
        """(n,) the largest difference of reference and measured position [rad | m]."""
        return np.abs(self.reference - self.q).max(axis=0)

    @property
    def largest_speed(self) -> np.ndarray:
        """(n,) [rad/s | m/s] between successive samples that arrived."""
        came = np.flatnonzero(~self.recording.lost)
        steps = np.diff(self.q[came], axis=0) / np.diff(came)[:, None]
        return np.abs(steps).max(axis=0, initial=0.0) / self.stages.period

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.scenario.arm.name}: rehearsal of {self.recording.ticks * self.stages.period:.4g} s"

    def step_at_start(self) -> list[str]:
        """A sentence where the reference begins away from the arm's initial position."""
        start, first = self.scenario.initial_state[0, : self.scenario.arm.n], self.reference[0]
        step = np.abs(first - start)
        if step.max() < AWAY:
            return []
        body = self.scenario.arm.coordinates[int(step.argmax())]
        pose = ", ".join(f"{value + 0.0:.4g}" for value in first.round(9))
        return [
            f"{body.joint}: the reference begins {step.max():.4g} {body.kind.units.position} from where the arm starts, "
            f"a step in the first tick; start q = [{pose}] begins on the reference"
        ]

    def check_limits(self, count: np.ndarray) -> None:
        """Refuses motions beyond the limits of joints.

        Args:
            count: (n,) of positions [rad | m].
        Raises:
            BusError: names the joint, the value, its time and the limit.
        """
        period = self.stages.period
        for i, body in enumerate(self.scenario.arm.coordinates):
            low, high = body.limits.position
            for name, path in (("reference", self.reference[:, i]), ("position", self.q[:, i])):
                beyond = (path < low - count[i]) | (path > high + count[i])
                if np.any(beyond):
                    tick = int(np.argmax(beyond))
                    what = f"the {name} is {path[tick]:.4g} at {tick * period:g} s"
                    raise BusError(what, place=f"joint {body.joint!r}", expected=f"{low:.4g} to {high:.4g}, its limits")
            fastest = self.largest_speed[i]
            if fastest > SPEEDING * body.limits.velocity:
                expected = (
                    f"at most {body.limits.velocity:g}, its limit, and {SPEEDING - 1.0:.0%} of it more in passing"
                )
                raise BusError(f"its speed is {fastest:.4g}", place=f"joint {body.joint!r}", expected=expected)


@dataclass(frozen=True, eq=False)
class Rehearsal(SimulatedRun):
    """A simulated run over a CAN bus.

    Attributes:
        scenario: as it runs over the bus.   stages: the controller's programs.   recording: references, measurements, commands.
        source: the scenario without the bus, at this speed and torque.   load: of the bus.   units: of the bus.
        full: the run at full speed and torque, of a reduced one.   speed, torque: of the run, in parts of the scenario's.
    """

    load: BusLoad
    units: BusUnits
    full: Rehearsal | None = None
    speed: float = 1.0
    torque: float = 1.0

    @property
    def largest_command(self) -> np.ndarray:
        """(n,) the largest command, as a share of the rated one."""
        return np.abs(self.recording.u).max(axis=0) / self.units.limit

    @property
    def reference_sha256(self) -> str:
        """Checksum of the reference of the run at full speed, whatever it was read from or planned with."""
        return hashlib.sha256((self.full or self).recording.r.tobytes()).hexdigest()

    def tables(self) -> list[Table]:
        """A row for each joint: its range, and the largest speed, command and error beside what the record allows."""
        arm = self.scenario.arm
        columns = (
            self.q.min(axis=0),
            self.q.max(axis=0),
            self.largest_speed,
            [b.limits.velocity for b in arm.coordinates],
        )
        columns = (*columns, 100.0 * self.largest_command, self.largest_error)
        heads = ("joint", "lowest [rad | m]", "highest [rad | m]", "velocity [rad/s | m/s]", "allowed [rad/s | m/s]")
        heads = (*heads, "command [% of rated]", "error [rad | m]")
        if self.full is not None:
            columns = (*columns, self.full.largest_speed, 100.0 * self.full.largest_command)
            heads = (*heads, "at full speed [rad/s | m/s]", "its command [% of rated]")
        rows = [[name, *(number(each[i], ".4g") for each in columns)] for i, name in enumerate(arm.names)]
        return [Table(self.heading, heads, rows)]

    def sentences(self) -> list[str]:
        """The load of the bus, and a step at the start."""
        return [str(self.load), *self.step_at_start()]


def rehearse(
    scenario: AnyScenario,
    *,
    bitrate: int = BITRATE,
    speed: float = 1.0,
    torque: float = 1.0,
    nodes: Sequence[int] | None = None,
) -> Rehearsal:
    """The simulated run of a scenario's controller over a bus.

    At reduced speed a motion is played more slowly. A pose or a step has no time to stretch: where a joint moves faster than in
    proportion, the reference is passed through a move within that share of the joints' speed and acceleration.

    Args:
        scenario: as it was written, without a bus.   bitrate: [bit/s].
        speed: of the reference, in parts of it.   torque: largest command, in parts of the rated one.
        nodes: numbers of the joints' nodes, to be checked; default: from 3.
    Returns:
        rehearsal: of all ticks, whose limits were checked.
    Raises:
        BusError: a scenario that a bus cannot carry, with all that is wrong; a motion beyond the limits of the record, or one
            that is not slower at a lower speed; names the joint.
        ScenarioError: a controller that cannot be traced, or a motion that diverges.
    Example:
        >>> speed = aw.Cascade(10.0, speed_kp=[15, 21, 16, 15, 1.4, 1.3], speed_ki=100.0)
        >>> move = aw.trajectories.Quintic(np.zeros(6), np.full(6, 0.1), duration=1.0)
        >>> scenario = aw.Scenario("lwa4p", 1.0, loop=aw.Loop(speed, move, period=0.004))
        >>> print(aw.bus.rehearse(scenario).sentences()[0])
        6 nodes at 4 ms and 500 kbit/s: load 69% to 84%, last answer after 1.43 to 1.73 ms
    """
    scenario = as_scenario(scenario)
    source = reduced(scenario, speed, torque)
    found = _rehearsed(source, bitrate, nodes)
    if speed < 1.0 or torque < 1.0:
        full = _rehearsed(scenario, bitrate, nodes)
        moves = _speeds(full)
        if np.any(_too_fast(found, moves, speed)):
            found = _rehearsed(_limited_move(source, moves, speed), bitrate, nodes)
        fast = _too_fast(found, moves, speed)
        if np.any(fast):
            i = int(np.argmax(fast))
            at = _speeds(found)[i], moves[i]
            what = f"its speed is {at[0]:.4g} at {speed:g} of the speed and {at[1]:.4g} at all of it"
            expected = f"about {speed * at[1]:.4g}: a start and a reference from which the arm moves slowly"
            raise BusError(what, place=f"joint {scenario.arm.names[i]!r}", expected=expected)
        found = replace(found, full=full, speed=float(speed), torque=float(torque))
    found.check_limits(found.units.count)
    return found


def _rehearsed(scenario: Scenario, bitrate: int, nodes: Sequence[int] | None) -> Rehearsal:
    """The simulated run, its limits unchecked."""
    on_bus = scenario_on_bus(scenario, bitrate=bitrate, nodes=nodes)
    stages = ControllerStages.of(on_bus)
    load = BusLoad(scenario.arm.n, on_bus.tick, bitrate)
    return Rehearsal(on_bus, stages, record(stages, on_bus.ticks), scenario, load, BusUnits.of(on_bus))


def _speeds(rehearsal: Rehearsal) -> np.ndarray:
    """(n,) the largest speed [rad/s | m/s], without the noise of measurements, in which a fast motion could hide."""
    loop = rehearsal.source.loop
    assert loop is not None
    sensors = loop.joint_sensors
    if not np.any(np.asarray(sensors.position_noise)):
        return rehearsal.largest_speed
    quiet = replace(rehearsal.source, loop=replace(loop, sensors=replace(sensors, position_noise=0.0)))
    return _rehearsed(quiet, rehearsal.load.bitrate, None).largest_speed


def _too_fast(slow: Rehearsal, full: np.ndarray, speed: float) -> np.ndarray:
    """(n,) True for joints whose largest speed did not fall in proportion to that at full speed, but for what is slow anyway."""
    limits = np.array([body.limits.velocity for body in slow.scenario.arm.coordinates])
    floor = SLOW * limits + 2.0 * slow.units.count / slow.stages.period
    return _speeds(slow) > PROPORTION * speed * full + floor


def _limited_move(scenario: Scenario, full: np.ndarray, speed: float) -> Scenario:
    """The scenario with its reference passed through a move within a share of each joint's speed and acceleration."""
    arm, loop, limits = scenario.arm, scenario.loop, MotionLimits.of(scenario.arm)
    assert loop is not None
    start = scenario.initial_state[0, : arm.n]
    rows = reference_rows(
        arm, start if loop.reference is None else loop.reference, scenario.tick * np.arange(scenario.ticks + 1)
    )
    most = speed * np.clip(full, SLOW * limits.velocity, limits.velocity)
    acceleration = np.minimum(speed * limits.acceleration, most / RISE)
    jerk = np.minimum(speed * limits.jerk, acceleration / ROUNDED)
    state = np.stack([start, np.zeros(arm.n), np.zeros(arm.n)])
    n, moved = arm.n, np.empty_like(rows)
    for row, asked in zip(moved, rows, strict=True):
        row[:] = state.ravel()
        state = filtered(state, asked[:n], asked[n : 2 * n], most, acceleration, jerk, scenario.tick)
    return replace(scenario, loop=replace(loop, reference=moved))

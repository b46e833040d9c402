"""Scenario: everything that decides a run, checked before it runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.interfaces import Sensor
from armwright.model import Model
from armwright.model.joint_signals import joint_signal
from armwright.model.vary import Varied
from armwright.parameters import (
    Batch,
    Draw,
    LaneFields,
    check_counts,
    has_draws,
    lane_counts,
    lane_values,
    resolved,
)
from armwright.signals import Layout
from armwright.simulation.inputs.acting import Held, Told, brake_of, held, numbers_of, schedules_of, wrench_of
from armwright.simulation.inputs.payload import payload_of
from armwright.simulation.inputs.schedule import Schedule
from armwright.simulation.integrate.events import EventFunction
from armwright.simulation.integrate.stepping import Adaptivity
from armwright.simulation.loop.controller import configured
from armwright.simulation.loop.sensors import Sensors
from armwright.simulation.loop.shaping import Shaping
from armwright.simulation.loop.state import LoopState
from armwright.simulation.loop.timing import Timing
from armwright.simulation.scenario_checks import check_scenario, is_time, start_state

MOST_STEPS = 2**53
BATCHED = (  # fields that may hold batches and draws
    "schedule", "command", "q0", "qd0", "initial_command", "wrench", "brake", "payload", "timing", "vary", "reference",
    "controller", "sensors",
)  # fmt: skip
STEP = 1e-3  # [s] of an integrator that is not told another


@dataclass(frozen=True, eq=False)
class Scenario:
    """An arm, what drives it, from where, and for how long.

    Lanes are simulations side by side that differ in some values. Such a value is given as a `Batch`, or drawn at random as a
    `Draw`: commands, schedules, references, gains of a controller, initial states, delays, noise of sensors, payloads, wrenches,
    brakes, and numbers of the record in `vary`.

    Args:
        arm: the model.
        duration: [s]; by default the time of the schedule's last row.
        step: [s] of the integrator, default 1 ms; with a `sample_period` it is that over `substeps`.
        schedule: commands over time, held between rows.
        command: (n,) constant commands, each in its joint's own unit [V | A | N m | N].
        controller: a control law instead: a plain function (t, r, y) → u, or a `Controller` with memory.
        reference: where the controller is to bring the arm: a pose, rows, a Schedule of poses or a `Trajectory`, a function of
            time; default: the initial position. Without a controller it is what `reduce` measures errors from.
        sample_period: [s] of the controller.   substeps: integration steps in each of its periods.
        sensors: an `aw.Sensors`, or several sensors; default: joint positions, velocities and currents, exactly.
        shaping, timing: what becomes of commands, and when; default: nothing, at once.
        initial_command: (n,) in force before the first tick; default: what holds the arm, within its drives' limits.
        vary: numbers of the record by name: `{"link6.mass_kg": Batch([0.1, 0.2])}`.
        wrench: of the environment on the tip, in base axes: (6,) [N, N m], or a Schedule with the columns
            `inputs.WRENCH`, held from row to row and landed on.
        payload: what the hand takes up and puts down: a `Payload` or several, in the order of their times.
        brake: 1 where the holding brakes of the record are applied, 0 where they are released: one for all, (brakes,),
            or a Schedule with a column for every joint that has one; absent: released.
        lanes: how many, where only draws say so; or a range of lanes to run of all that batches and draws describe, each as it
            is among the others.
        seed: of noise, jitter, losses and draws.
        document: the scenario file that it was read from, with all it named; a run keeps it, to be done again. None of what
            was made in Python, and of a copy that `dataclasses.replace` has changed.
        q0: (n,) [rad | m], default 0.   qd0: the same [rad/s | m/s].
        start: a run, or the `LoopState` of a `Simulation`, that goes on: time, plant, commands on their way, sensors, random
            numbers, and the controller if it is the same one. In place of q0 and qd0.
        integrator: a name of `integrators.RULES`: "rk3", "rk4", "semi_implicit_euler"; "rk45", which chooses its own steps
            within each tick; or "cvodes", slow and accurate, for some lanes.
        rtol, atol: of "rk45" and "cvodes": what each entry of the state may be wrong by in a step; default `TOLERANCES`.
        max_steps: of "rk45" in one tick; a lane that wants more is frozen and marked.
        events: of "rk45", by name: functions (t, x) of time and state whose changes of sign are found, landed on and told,
            as `events.joint_stops` makes them.
        record_every: rows are recorded every so many steps; 0 records the first and the last state only.
        record: "all", or "state" for q and qd alone, which many lanes over many rows may want, or "none" beside `reduce`.
        reduce: names of `reducers.REDUCERS`, worked out for each joint in the loop: ("rms_error", "peak_voltage", …).
        target: processor level to compile for, as in `compile`.
    Raises:
        ScenarioError: what cannot be run; one line that names the field, its value and what was expected.
    """

    arm: Model
    duration: float | None = None
    step: float | None = None
    schedule: Schedule | Batch | None = None
    command: Any = None
    q0: Any = None
    qd0: Any = None
    start: Any = None
    integrator: str = "rk3"
    record_every: int = 1
    record: str = "all"
    target: str | None = None
    controller: Any = None
    reference: Any = None
    sample_period: float | None = None
    substeps: int = 1
    sensors: Sensors | Sequence[Sensor] = field(default_factory=Sensors)
    shaping: Shaping = field(default_factory=Shaping)
    timing: Timing = field(default_factory=Timing)
    initial_command: Any = None
    vary: Mapping[str, Any] = field(default_factory=dict)
    lanes: int | range | None = None
    seed: int = 0
    rtol: float | None = None
    atol: float | None = None
    max_steps: int | None = None
    events: Mapping[str, EventFunction] = field(default_factory=dict)
    reduce: Sequence[str] = ()
    wrench: Any = None
    payload: Any = None
    brake: Any = None
    document: str | None = field(default=None, init=False, repr=False)
    _is_resolved: bool = field(default=False, repr=False)

    def __post_init__(self) -> None:
        check_scenario(self)
        if self.resolved is not self:  # which was checked when it was made
            return
        _ = self.started, self.commands, self.inputs, self.ticks, self.lane_count, self.initial_state, self.adaptivity
        _ = self.first_command, self.controller_fields

    @cached_property
    def resolved(self) -> Scenario:
        """The scenario with batches in place of draws, of the lanes to be run; itself where it has no draws and runs them all.

        Raises:
            ScenarioError: draws without a number of lanes, or a batch that does not have them all.
        """
        parts = {name: getattr(self, name) for name in BATCHED}
        drawn = any(has_draws(part) for part in parts.values())
        if self._is_resolved or not (drawn or isinstance(self.lanes, range)):
            return self
        lanes = self.lanes if isinstance(self.lanes, range) else range(self._described)
        parts["vary"] = {name: self._of_record(name, value) for name, value in self.vary.items()}
        found = {name: resolved(part, name, self.seed, lanes) for name, part in parts.items()}
        copy = replace(self, **found, lanes=lanes, _is_resolved=True)
        object.__setattr__(copy, "document", self.document)
        return copy

    @property
    def _described(self) -> int:
        """Number of lanes that the scenario describes."""
        counts = self._counts()
        if isinstance(self.lanes, int):
            counts["lanes"] = self.lanes
        lanes = check_counts(counts)
        if lanes is None:
            raise ScenarioError("lanes: expected a number beside draws, which do not say how many lanes there are")
        return lanes

    def _of_record(self, name: str, value: Any) -> Any:
        """A draw by the record as one of a normal distribution within the bounds that the record allows."""
        if not isinstance(value, Draw) or value.kind != "record":
            return value
        rows = Varied(self.arm, [name]).parameters
        without = [row.name for row in rows if row.std is None]
        if without:
            raise ScenarioError(
                f"vary[{name!r}]: the record gives {without[0]} no standard deviation; expected a Draw.normal(…)"
            )
        single, (low, high) = rows[0].entry is None, rows[0].bounds
        mean, std = ([getattr(row, of) for row in rows] for of in ("value", "std"))
        return Draw.normal(mean[0] if single else mean, std[0] if single else std, low, high)

    @cached_property
    def commands(self) -> Told:
        """Commands over time, for all lanes or a lane each; none where a controller commands, or someone from outside."""
        if self.sampled:
            return []
        if self.schedule is not None:
            return schedules_of("schedule", self.schedule, self.arm.names)
        return held("command", self.command, self.arm.names)

    @property
    def adaptivity(self) -> Adaptivity | None:
        """How the integrator chooses its steps; None for rules of fixed step."""
        return Adaptivity.of(self.integrator, self.substeps, self.rtol, self.atol, self.max_steps, self.events)

    @cached_property
    def inputs(self) -> dict[str, Held]:
        """What acts on the plant beside commands, by name: for all lanes, or a lane each."""
        found: dict[str, Held] = {}
        if self.wrench is not None:
            found["wrench"] = wrench_of(self.arm, self.wrench)
        if self.brake is not None:
            found["brake"] = brake_of(self.arm, self.brake)
        if self._payload is not None:
            found["payload"] = self._payload[1]
        return found

    @cached_property
    def _payload(self) -> tuple[tuple[str, ...], Held] | None:
        return None if self.payload is None else payload_of(self.arm, self.payload)

    @property
    def external(self) -> bool:
        """Whether nothing of the scenario drives the arm: `Simulation.step` is given the commands."""
        return self.controller is None and self.command is None and self.schedule is None

    @property
    def sampled(self) -> bool:
        """Whether the loop has sensors and a controller, or someone in its place."""
        return self.controller is not None or self.external

    @cached_property
    def sensor_list(self) -> tuple[Sensor, ...]:
        """All sensors, those of the joints first."""
        given = (self.sensors,) if isinstance(self.sensors, Sensors) else tuple(self.sensors)
        joints = [each for each in given if isinstance(each, Sensors)] or [Sensors()]
        return (joints[0], *(each for each in given if each is not joints[0]))

    @property
    def joint_sensors(self) -> Sensors:
        """Sensors of the joints."""
        return next(each for each in self.sensor_list if isinstance(each, Sensors))

    @property
    def command_layout(self) -> Layout:
        """Layout of the commands u."""
        return Layout((joint_signal(self.arm, "u"),))

    @property
    def payload_frames(self) -> tuple[str, ...]:
        """Frames that payloads hang on."""
        return () if self._payload is None else self._payload[0]

    @property
    def integration_step(self) -> float:
        """[s] of the integrator."""
        if self.sample_period is not None:
            return float(self.sample_period) / self.substeps
        return STEP if self.step is None else float(self.step)

    @property
    def tick(self) -> float:
        """[s] of the loop: the integrator's step, or the controller's sample period."""
        if not self.sampled:
            return self.integration_step
        return self.integration_step * self.substeps if self.sample_period is None else float(self.sample_period)

    @cached_property
    def ticks(self) -> int:
        """Number of steps, or of sample periods where a controller commands; the duration must hold a whole number of them."""
        duration, tick = self.duration, self.tick
        if duration is None and self.external:
            return 1
        if duration is None and self.controller is not None:
            raise ScenarioError("duration: expected one, since a controller does not say when to stop")
        if duration is None:
            duration = max((float(each.times[-1]) for each in self.commands if isinstance(each, Schedule)), default=0.0)
            if duration == 0:
                raise ScenarioError(
                    "duration: expected one, since the commands are constant and do not say when to stop"
                )
        if not (is_time(duration)):
            raise ScenarioError(f"duration = {duration!r}: expected a time above 0 s")
        what = "sample_period" if self.sampled else "step"
        ticks = round(duration / tick)
        if ticks < 1 or abs(ticks * tick - duration) > 1e-6 * tick:
            raise ScenarioError(
                f"duration = {duration:g} s is no whole number of {what}s of {tick:g} s; expected a multiple of the {what}"
            )
        if ticks > MOST_STEPS:
            raise ScenarioError(
                f"duration = {duration:g} s is {ticks:.3g} {what}s of {tick:g} s, more than can be counted"
            )
        if self.record_every and ticks % self.record_every:
            raise ScenarioError(f"record_every = {self.record_every} does not divide the {ticks} steps of the run")
        return ticks

    @cached_property
    def lane_count(self) -> int | None:
        """Number of lanes to be run; None for a single run without a lane axis."""
        if self.resolved is not self:
            return self.resolved.lane_count
        counts = self._counts()
        if self.lanes is not None:
            counts["lanes"] = self.lanes if isinstance(self.lanes, int) else len(self.lanes)
        return check_counts(counts)

    @property
    def first_lane(self) -> int:
        """Number of the first lane to be run, of all that are described."""
        return self.lanes.start if isinstance(self.lanes, range) else 0

    def _counts(self) -> dict[str, int]:
        """Number of lanes of every batch, by its path, and of a state to start from."""
        counts: dict[str, int] = {}
        for name in BATCHED:
            counts |= lane_counts(getattr(self, name), name)
        if self.started is not None and not self.started.single:
            counts["start"] = self.started.lanes
        return counts

    @cached_property
    def controller_fields(self) -> LaneFields:
        """The controller, configured for the arm and its sample period, with its fields that vary by lane."""
        return LaneFields(None) if self.controller is None else configured(self.controller, self.arm, self.tick)

    @cached_property
    def started(self) -> LoopState | None:
        """The state that the scenario starts from; None: at q0 and qd0, at rest as `Plant.initial` says."""
        return None if self.start is None else start_state(self)

    @cached_property
    def varied(self) -> Varied | None:
        """The arm with its varied parameters left open."""
        return Varied(self.arm, list(self.vary)) if self.vary else None

    @cached_property
    def parameters(self) -> np.ndarray:
        """(lanes or 1, k) values of the varied parameters."""
        if self.varied is None:
            return np.zeros((1, 0))
        rows = self.lane_count or 1
        columns = [self._column(name, value) for name, value in self.vary.items()]
        values = np.concatenate([np.broadcast_to(c, (rows, c.shape[1])) for c in columns], axis=1)
        self.varied.check(values)
        return values

    def _column(self, name: str, value: Any) -> np.ndarray:
        """(lanes or 1, k) of a varied parameter that is k numbers."""
        try:
            rows = np.asarray(lane_values(value), dtype=float)
        except (TypeError, ValueError):
            raise ScenarioError(f"vary: {name} = {value!r}: expected numbers") from None
        k = len(Varied(self.arm, [name]).parameters)
        if rows.shape[1:] != (() if k == 1 else (k,)):
            expected = "one number" if k == 1 else f"{k} numbers"
            lanes = not isinstance(value, Batch) and rows.shape[2:] == (() if k == 1 else (k,)) and rows.ndim > 1
            more = "; values that differ by lane are a Batch" if lanes else ""
            raise ScenarioError(f"vary: {name} has shape {rows.shape[1:]}; expected {expected}{more}")
        return rows.reshape(len(rows), k)

    @cached_property
    def initial_state(self) -> np.ndarray:
        """(lanes or 1, 2n) positions, then speeds."""
        if self.started is not None:
            return self.started.blocks["x"][:, : 2 * self.arm.n]  # what every plant's state begins with
        rows = self.lane_count or 1
        parts = [self._vectors(name, getattr(self, name)) for name in ("q0", "qd0")]
        return np.concatenate([np.broadcast_to(part, (rows, self.arm.n)) for part in parts], axis=1)

    @property
    def first_command(self) -> np.ndarray | None:
        """(lanes or 1, n) in force before the first tick; None: what holds the arm."""
        if self.initial_command is not None:
            return numbers_of("initial_command", self.initial_command, self.arm.names)
        return None if self.started is None else self.started.blocks.get("u")

    def _vectors(self, name: str, value: Any) -> np.ndarray:
        if value is None:
            return np.zeros((1, self.arm.n))
        return numbers_of(name, value, self.arm.names)

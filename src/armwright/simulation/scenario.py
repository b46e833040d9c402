"""Scenario: everything that decides a run, checked before it runs."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from armwright.entry import as_arm, expect
from armwright.errors import ArmwrightError, ScenarioError
from armwright.model import Model
from armwright.model.joint_signals import joint_signal
from armwright.model.payload import Payload
from armwright.model.vary import Varied
from armwright.notebook import repr_html, stated
from armwright.parameters import (
    Batch,
    Draw,
    LaneFields,
    check_counts,
    has_draws,
    lane_counts,
    numbers_by_lane,
    resolved,
)
from armwright.program import kept
from armwright.signals import Layout
from armwright.simulation.checks import check_time, is_whole
from armwright.simulation.inputs.input_schedule import (
    InputSchedule,
    brake_schedule,
    enabled_schedule,
    input_schedule,
    lane_numbers,
    supply_schedule,
    wrench_schedule,
)
from armwright.simulation.inputs.payload import carried, payload_of
from armwright.simulation.loop.controller import configured
from armwright.simulation.loop.state import LoopState, state_to_continue
from armwright.simulation.loop.timing import Delays
from armwright.simulation.scenario_parts import Inputs, Loop, Recording, Solver, Start

SCHEDULES = {  # of the inputs, by name
    "wrench": wrench_schedule,
    "brake": brake_schedule,
    "supply": supply_schedule,
    "enabled": enabled_schedule,
}
MOST_STEPS = 2**53
WITH_LANES = ("command", "loop", "inputs", "start", "recording", "vary")  # fields that may hold batches and draws
STEP = 1e-3  # [s] of an integrator, if nothing else is said
OPEN_ENDED = 10.0  # [s] over which a run that has no end keeps its accuracy, if nothing else is said


@dataclass(frozen=True, eq=False)
class Scenario:
    """An arm, what drives it, from where, and for how long.

    An arm is driven by commands over time, by the controller of a loop, or, without both, by `Simulation.step`.

    Lanes are simulations side by side that differ in some values. Such a value is given as a `Batch`, or drawn at random as a
    `Draw`: commands, schedules, references, gains of a controller, initial states, delays, noise of sensors, payloads, wrenches,
    brakes, and numbers of the record in `vary`.

    Args:
        arm: the model.
        duration: [s]; by default the time of the schedule's last row.
        command: (n,) constant commands, each in its joint's own unit [V | A | N m | N], or a `Schedule` that is held from row
            to row.
        loop: a sampled loop instead: controller, reference, sensors, timing.
        inputs: what acts on the arm beside commands: wrench, brakes, payloads. Without payloads the hand carries what the loop's
            reference does, the motion of a motion file.
        start: (n,) initial positions [rad | m], or a `Start` with speeds too; default 0. Or a run, or the `LoopState` of a
            `Simulation`, that goes on: time, plant, commands on their way, sensors, random numbers, and the controller if it
            is the same one.
        solver: the integrator and its step.
        recording: what is kept of the run.
        vary: numbers of the record by name: `{"link6.mass_kg": Batch([0.1, 0.2])}`.
        lanes: how many, where only draws say so; or a range of lanes to run of all that batches and draws describe, each as it
            is among the others.
        seed: of noise, jitter, losses and draws.
        first_lane: number of the first lane, in a part of a larger run that `resolved` made.
        source: the scenario file that it began as, whose comments and names of files `write_scenario` keeps; a copy that
            `dataclasses.replace` has changed has it too.
        document: the scenario file that it was read from, with all it named; a run keeps it, to be reproduced. None of a
            scenario made in Python, and of a copy that `dataclasses.replace` has changed.
        notes: about its file, which a run repeats.
    Raises:
        ScenarioError: what cannot be run; one line that names the field, its value and what was expected.
    Example:
        >>> start = [0.3, 0.5]
        >>> scenario = aw.Scenario("two-link", duration=0.2, command=[20.0, 5.0], start=start)
        >>> aw.simulate(scenario).q.values[-1].round(3)
        array([0.089, 0.897])
    """

    arm: Model
    duration: float | None = None
    command: Any = None
    loop: Loop | None = None
    inputs: Inputs = field(default_factory=Inputs)
    start: Any = None
    solver: Solver = field(default_factory=Solver)
    recording: Recording = field(default_factory=Recording)
    vary: Mapping[str, Any] = field(default_factory=dict)
    lanes: int | range | None = None
    seed: int = 0
    first_lane: int = field(default=0, repr=False)
    source: Any = field(default=None, repr=False)
    document: str | None = field(default=None, init=False, repr=False)
    notes: tuple[str, ...] = field(default=(), init=False, repr=False)

    def __repr__(self) -> str:
        return stated(self)

    _repr_html_ = repr_html

    def __post_init__(self) -> None:
        object.__setattr__(self, "arm", as_arm(self.arm))
        if not isinstance(self.start, (Start, LoopState)) and not hasattr(self.start, "data_vars"):  # which a run has
            object.__setattr__(self, "start", Start(self.start))
        if self.command is None and self.loop is None:
            object.__setattr__(self, "loop", Loop())
        self._check_fields()
        if self.resolved is self:  # else they were checked when that one was made
            self._check_values()

    def _check_fields(self) -> None:
        """Refuses fields of another type, and parts that do not fit together."""
        if self.command is not None and self.loop is not None:
            raise ScenarioError(
                "beside a command",
                place="loop",
                expected="one of them; sensors, filters and delays are those of a loop",
            )
        kinds: dict[str, type] = {"inputs": Inputs, "solver": Solver, "recording": Recording}
        for name, kind in (kinds if self.loop is None else kinds | {"loop": Loop}).items():
            expect(getattr(self, name), kind, name, f"an aw.{kind.__name__}(…)", ScenarioError)
        if self.loop is not None:
            try:
                self.loop.command_filter.check(self.arm)
                self.loop.joint_sensors.check(self.arm)
            except ScenarioError as error:
                raise error.within("loop") from None
            if self.recording.reference is not None:
                raise ScenarioError("beside a loop", place="recording.reference", expected="loop.reference instead")
        if not isinstance(self.vary, Mapping):
            raise ScenarioError(
                place="vary", value=self.vary, expected="numbers by name, such as {'link6.mass_kg': 0.1}"
            )
        if not is_whole(self.seed, 0) or self.seed >= 2**63:
            raise ScenarioError(place="seed", value=self.seed, expected="a whole number, 0 or more, of 63 bits")
        lanes = self.lanes
        part = isinstance(lanes, range) and lanes.step == 1 and 0 <= lanes.start < lanes.stop
        if lanes is not None and not part and not is_whole(lanes, 1):
            expected = "a number of lanes, or a range such as range(77, 78)"
            raise ScenarioError(place="lanes", value=lanes, expected=expected)
        self._check_step()

    def _check_step(self) -> None:
        """Refuses steps that do not fit the period of the loop."""
        step, substeps = self.solver.step, self.solver.substeps or 1
        if self.loop is None or self.loop.period is None:
            if substeps != 1 and (self.loop is None or self.loop.controller is None):
                expected = "a loop with a period, or a smaller step"
                raise ScenarioError("divides a period", place="solver.substeps", value=substeps, expected=expected)
            return
        part = float(self.loop.period) / substeps
        if step is not None and abs(step - part) > 1e-9 * part:
            expected = f"loop.period / solver.substeps = {part:g} s, or one of step and period"
            raise ScenarioError(place="solver.step", value=step, expected=expected)

    def _check_values(self) -> None:
        """Refuses values that do not fit the arm or each other, by working all of them out."""
        _ = self.started, self.commands, self.input_schedules, self.ticks, self.lane_count, self.initial_state
        _ = self.first_command, self.controller_fields

    @cached_property
    def resolved(self) -> Scenario:
        """The scenario with batches in place of draws, of the lanes to be run; itself where it has no draws and runs them all.

        Raises:
            ScenarioError: draws without a number of lanes, or a batch that does not have them all.
        """
        parts = self._with_lanes()
        try:
            draws = any(has_draws(part) for part in parts.values())
        except RecursionError:
            raise ScenarioError("lists in lists that do not end", place="scenario", expected="numbers") from None
        if not isinstance(self.lanes, range) and not draws:
            return self
        lanes = self.lanes if isinstance(self.lanes, range) else range(self._described)
        parts["vary"] = {name: self._of_record(name, value) for name, value in self.vary.items()}
        changes = {name: resolved(part, name, self.seed, lanes) for name, part in parts.items()}
        scenario = copy.copy(self)
        kept = {each.name: getattr(self, each.name) for each in fields(self)}  # and nothing that was computed from them
        object.__setattr__(scenario, "__dict__", kept | changes | {"lanes": len(lanes), "first_lane": lanes.start})
        scenario._check_fields()
        scenario._check_values()
        return scenario

    def _with_lanes(self) -> dict[str, Any]:
        """Fields that may hold batches and draws, by name."""
        parts = {name: getattr(self, name) for name in WITH_LANES}
        return parts if isinstance(self.start, Start) else {k: part for k, part in parts.items() if k != "start"}

    @property
    def _described(self) -> int:
        """Number of lanes that the scenario describes."""
        counts = self._counts()
        if isinstance(self.lanes, int):
            counts["lanes"] = self.lanes
        lanes = check_counts(counts)
        if lanes is None:
            expected = "a number beside draws, which do not say how many lanes there are"
            raise ScenarioError(place="lanes", value=None, expected=expected)
        return lanes

    def _of_record(self, name: str, value: Any) -> Any:
        """A draw by the record as one of a normal distribution within the bounds that the record allows."""
        if not isinstance(value, Draw) or value.kind != "record":
            return value
        rows = Varied(self.arm, [name]).parameters
        without = [row.name for row in rows if row.std is None]
        if without:
            what = f"the record has no standard deviation of {without[0]}"
            raise ScenarioError(what, place=f"vary[{name!r}]", value=value, expected="a Draw.normal(…)")
        single, (low, high) = rows[0].entry is None, rows[0].bounds
        mean, std = ([getattr(row, of) for row in rows] for of in ("value", "std"))
        return Draw.normal(mean[0] if single else mean, std[0] if single else std, low, high)

    @property
    def sampled(self) -> bool:
        """True where the arm is driven in a sampled loop, by a controller or from outside."""
        return self.loop is not None

    @property
    def controller(self) -> Any:
        """The controller of the loop; None without one."""
        return None if self.loop is None else self.loop.controller

    @property
    def external(self) -> bool:
        """True where nothing of the scenario drives the arm: `Simulation.step` takes the commands."""
        return self.loop is not None and self.loop.controller is None

    @property
    def reference(self) -> Any:
        """The reference of the controller, or of the errors in `reduce`; None: the initial position."""
        return self.recording.reference if self.loop is None else self.loop.reference

    @cached_property
    def commands(self) -> InputSchedule:
        """Commands over time, for all lanes or a lane each; none in a loop."""
        return [] if self.sampled else input_schedule("command", self.command, self.arm.names)

    @property
    def input_schedules(self) -> dict[str, InputSchedule]:
        """Inputs of the plant beside commands, by name: for all lanes, or a lane each."""
        return self._inputs[0]

    @property
    def carried(self) -> Any:
        """Bodies in the hand: those of `inputs`, else those that the loop's reference takes up and puts down; None: none."""
        return self.inputs.payload if self.inputs.payload is not None else self._carried_by_reference or None

    @property
    def _carried_by_reference(self) -> list[Payload]:
        return [] if self.loop is None else list(getattr(self.loop.reference, "payloads", ()))

    @property
    def carried_notes(self) -> list[str]:
        """Sentences about bodies that the reference takes up, where it takes up some."""
        bodies = self._carried_by_reference
        if self.inputs.payload is not None or not bodies:
            return ["inputs.payload stands in place of what the reference takes up"] if bodies else []
        return [f"the hand carries what the reference takes up: {', '.join(map(carried, bodies))}"]

    @property
    def payload_frames(self) -> tuple[str, ...]:
        """Frames that payloads hang on."""
        return self._inputs[1]

    @cached_property
    def _inputs(self) -> tuple[dict[str, InputSchedule], tuple[str, ...]]:
        schedules: dict[str, InputSchedule] = {}
        frames: tuple[str, ...] = ()
        try:
            for name, schedule_of in SCHEDULES.items():
                if (value := getattr(self.inputs, name)) is not None:
                    schedules[name] = schedule_of(self.arm, value)
            if self.carried is not None:
                frames, schedules["payload"] = payload_of(self.arm, self.carried)
        except ArmwrightError as error:
            raise error.within("inputs") from None
        return schedules, frames

    @property
    def command_layout(self) -> Layout:
        """Layout of the commands u."""
        return Layout((joint_signal(self.arm, "u"),))

    @property
    def substeps(self) -> int:
        """Equal steps of the integrator in a period; 1 where it chooses them."""
        return self.solver.substeps or 1

    @property
    def integration_step(self) -> float:
        """[s] of the integrator; where it chooses its steps, of the longest."""
        if self.loop is not None and self.loop.period is not None:
            return float(self.loop.period) / self.substeps
        if self.loop is None and self.solver.rule == "auto" and self.recording.period is not None:
            return float(self.recording.period)
        return STEP if self.solver.step is None else float(self.solver.step)

    @property
    def tick(self) -> float:
        """[s] of the loop: the integrator's step, or the controller's sample period."""
        if self.loop is None:
            return self.integration_step
        return self.integration_step * self.substeps if self.loop.period is None else float(self.loop.period)

    @property
    def without_global_error(self) -> Scenario:
        """The scenario for one of many runs, whose errors nobody reads."""
        return replace(self, solver=replace(self.solver, global_error=False))

    @property
    def horizon(self) -> float:
        """[s] of the run over which steps of "auto" keep its accuracy: what the solver says, else the duration."""
        stated = self.duration if self.solver.horizon is None else self.solver.horizon
        return OPEN_ENDED if stated is None else float(stated)

    @property
    def whole_times(self) -> tuple[float, ...]:
        """[s] times that hold a whole number of steps: the duration, and the recording period where there is one."""
        times = (self.ticks * self.tick, self.recording.period)
        return tuple(float(time) for time in times if time is not None)

    @cached_property
    def every(self) -> int:
        """Ticks from one recorded row to the next; 0: the first and the last alone."""
        period, tick = self.recording.period, self.tick
        if period is None:
            return 1 if self.recording.every is None else self.recording.every
        every = round(period / tick)
        if every < 1 or abs(every * tick - period) > 1e-9 * period:
            what = "loop.period" if self.sampled else "solver.step"
            raise ScenarioError(place="recording.period", value=period, expected=f"a multiple of {what} = {tick:g} s")
        return every

    @cached_property
    def ticks(self) -> int:
        """Number of steps, or of periods in a loop; the duration must hold a whole number of them."""
        if self.duration is not None:
            return self.ticks_of(self.duration)
        if self.external:
            return 1
        rows = self.commands if isinstance(self.commands, list) else []
        duration = max((float(each.times[-1]) for each in rows), default=0.0)
        if duration == 0.0:
            driver = "constant commands do" if self.loop is None else "a controller does"
            expected = f"a time above 0 [s], since {driver} not say when to stop"
            raise ScenarioError(place="duration", value=None, expected=expected)
        return self.ticks_of(duration)

    def ticks_of(self, duration: float) -> int:
        """Number of steps, or of periods in a loop, in a duration [s].

        Raises:
            ScenarioError: no whole number of them, too many to count, or rows that do not end with them.
        """
        check_time("duration", duration)
        tick = self.tick
        if duration > MOST_STEPS * tick:
            expected = f"at most 2^53 times {self._named_tick}"
            raise ScenarioError(place="duration", value=duration, expected=expected)
        ticks = round(duration / tick)
        rounding = 1e-6 * tick + 4.0 * np.finfo(float).eps * duration
        if ticks < 1 or abs(ticks * tick - duration) > rounding:
            raise ScenarioError(place="duration", value=duration, expected=f"a multiple of {self._named_tick}")
        if self.every and ticks % self.every:
            place, expected = "recording.every", f"a divisor of the {ticks} steps of the run"
            if self.recording.period is not None:
                place, expected = "recording.period", f"a divisor of the duration, {duration:g} s"
            raise ScenarioError(place=place, value=getattr(self.recording, place[10:]), expected=expected)
        return ticks

    @property
    def _of_tick(self) -> str:
        """The field that says how long a tick is."""
        if self.sampled:
            return "loop.period"
        return "recording.period" if self.solver.rule == "auto" else "solver.step"

    @property
    def _named_tick(self) -> str:
        """Length of a tick with the field that says it, as a default where the scenario does not."""
        field, tick = self._of_tick, self.tick
        if field == "recording.period" and self.recording.period is None:
            return f"{tick:g} s, the time from row to row; another recording.period changes it"
        if field == "solver.step" and self.solver.step is None:
            return f"{tick:g} s, the step; another solver.step changes it"
        return f"{field} = {tick:g} s"

    @cached_property
    def lane_count(self) -> int | None:
        """Number of lanes to be run; None for a single run without a lane axis."""
        if self.resolved is not self:
            return self.resolved.lane_count
        counts = self._counts()
        if isinstance(self.lanes, int):
            counts["lanes"] = self.lanes
        return check_counts(counts)

    def _counts(self) -> dict[str, int]:
        """Number of lanes of every batch, by its path, and of a state to start from."""
        counts: dict[str, int] = {}
        for name, part in self._with_lanes().items():
            counts |= lane_counts(part, name)
        if self.started is not None and not self.started.single:
            counts["start"] = self.started.lanes
        return counts

    @cached_property
    def controller_fields(self) -> LaneFields:
        """The controller, configured for the arm and its sample period, with its fields that vary by lane."""
        if self.loop is None or self.controller is None:
            return LaneFields(None)
        ticks = int(Delays.of(self.loop.timing, self.tick).commanded.max())
        return configured(self.controller, self.arm, self.tick, ticks)

    @cached_property
    def started(self) -> LoopState | None:
        """The state that the scenario goes on from; None: it begins with positions and speeds, as `Plant.initial` says."""
        return None if isinstance(self.start, Start) else self.continued(self.start)

    def continued(self, start: Any) -> LoopState:
        """A state that the scenario can go on from, of a run or of a `Simulation`.

        Raises:
            ScenarioError: as `state_to_continue`.
        """
        brakes = self.inputs.brake is not None
        return state_to_continue(start, self.arm, self.tick, self._of_tick, brakes=brakes)

    @cached_property
    def varied(self) -> Varied | None:
        """The arm with its varied parameters left open."""
        if not self.vary:
            return None
        return kept(("varied", self.arm.sha256, *self.vary), lambda: Varied(self.arm, list(self.vary)))

    @cached_property
    def parameters(self) -> np.ndarray:
        """(lanes or 1, k) values of the varied parameters."""
        if self.varied is None:
            return np.zeros((1, 0))
        rows = self.lane_count or 1
        columns = [self._column(name, value, self.varied.sizes[name]) for name, value in self.vary.items()]
        values = np.concatenate([np.broadcast_to(c, (rows, c.shape[1])) for c in columns], axis=1)
        self.varied.check(values)
        return values

    def _column(self, name: str, value: Any, k: int) -> np.ndarray:
        """(lanes or 1, k) of a varied parameter that is k numbers."""
        expected = "one number" if k == 1 else f"{k} numbers"
        try:
            rows = numbers_by_lane(value)
        except ValueError:
            raise ScenarioError(place=f"vary[{name!r}]", value=value, expected=expected) from None
        shape = () if k == 1 else (k,)
        if rows.shape[1:] != shape:
            lanes = not isinstance(value, Batch) and rows.shape[2:] == shape and rows.ndim > 1
            batch = "; values that differ by lane are a Batch" if lanes else ""
            raise ScenarioError(place=f"vary[{name!r}]", value=value, expected=f"{expected}{batch}")
        return rows.reshape(len(rows), k)

    @cached_property
    def initial_state(self) -> np.ndarray:
        """(lanes or 1, 2n) positions, then speeds."""
        if self.started is not None:
            return self.started.blocks["x"][:, : 2 * self.arm.n]  # what every plant's state begins with
        rows = self.lane_count or 1
        zero = np.zeros((1, self.arm.n))
        parts = [
            zero if value is None else lane_numbers(f"start.{name}", value, self.arm.names)
            for name, value in (("q", self.start.q), ("qd", self.start.qd))
        ]
        return np.concatenate([np.broadcast_to(part, (rows, self.arm.n)) for part in parts], axis=1)

    @cached_property
    def first_command(self) -> np.ndarray | None:
        """(lanes or 1, n) in force before the first tick; None: what holds the arm."""
        if self.loop is not None and self.loop.initial_command is not None:
            return lane_numbers("loop.initial_command", self.loop.initial_command, self.arm.names)
        return None if self.started is None else self.started.blocks.get("u")

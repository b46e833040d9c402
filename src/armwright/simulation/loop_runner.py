"""The loop of a scenario: compiled, begun, taken through ticks, and its state read; `Simulation` runs and steps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from armwright.entry import as_scenario, expect
from armwright.errors import ScenarioError
from armwright.kernels.loop import LaneGroup, LoopArrays, NativeLoop
from armwright.kernels.stages import SEEN, TURNS, state_blocks
from armwright.program.turns import alone
from armwright.results.reducers import Reduction, check_known
from armwright.simulation.auto_rule import auto_rule
from armwright.simulation.inputs.input_schedule import all_rows, landing_rows, values_at_ticks
from armwright.simulation.integrate.cvodes import GAVE_UP, Cvodes, check_lanes
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.integrate.stepping import begin_adaptive
from armwright.simulation.loop.compiled import CompiledLoop
from armwright.simulation.loop.config import LoopConfig, Sampling
from armwright.simulation.loop.controller import ControllerAdapter
from armwright.simulation.loop.initialisation import Initialisation
from armwright.simulation.loop.plant_programs import plant_derivative, plant_turn, plant_watched
from armwright.simulation.loop.python_controller import PythonController
from armwright.simulation.loop.references import PARAMETERS, LoopReference, start_notes
from armwright.simulation.loop.sensor_set import SensorSet
from armwright.simulation.loop.state import LoopState
from armwright.simulation.loop.timing import Delays
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.step_limits import StepLimit, check_inertia, full_voltage
from armwright.simulation.plant.varied_step_limits import VariedStepLimit
from armwright.simulation.scenario import Scenario


class LoopRunner:
    """The loop of a scenario in native code: it begins groups of lanes, takes them through ticks, and reads their state.

    Attributes:
        scenario: with batches in place of its draws.   arm: its model.   count: lanes.
        period: [s] of a tick.   step_length: [s] of the integrator.   substeps: of a tick.
        sampled: whether a loop drives the arm.   law: the controller of that loop, as the scenario has it; None without one.
        external: whether nothing of the scenario drives the arm, and `step` takes the commands.   command: layout of u.
        tick: that comes next.   origin: the tick that tables and records begin with.
        begun: the tick that the scenario starts with.
        config, initialisation, loop: what a tick is made of, how lanes begin, and both in native code.   width: lanes of a tile.
        inputs, rows: held from row to row, by block; and the ticks of their rows.
        reference, reduction: what is followed, and computed along the way; None where there is none.
        rule: that moves the plant: "auto" is rk3 in substeps of each lane's own.
        notes: what a user should know of how it is run.   plant: with the record's numbers.
        untraced: why the controller runs in Python; None where it is compiled, or there is none.
    """

    @alone
    def __init__(
        self, scenario: Scenario, *, loop: CompiledLoop | None = None, sampled: bool | None = None, lands: bool = False
    ):
        """`sampled`: whether "auto" chooses its rule as for a sampled loop; by default it does where the scenario has one.

        `lands`: as of `LoopConfig`.
        """
        expect(loop, CompiledLoop | None, "loop", "the `loop` of another simulation", ScenarioError)
        self.scenario = scenario = as_scenario(scenario).resolved
        self.arm, self.count = scenario.arm, scenario.lane_count or 1
        self.period, self.step_length, self.substeps = scenario.tick, scenario.integration_step, scenario.substeps
        self.sampled, self.law, self.external = scenario.sampled, scenario.controller, scenario.external
        self.command, self._followed, self._started = scenario.command_layout, scenario.reference, scenario.started
        self.inputs = dict(scenario.input_schedules) | ({} if self.sampled else {"u": scenario.commands})
        self._payload_frames = scenario.payload_frames
        self.notes: list[str] = [*scenario.notes, *scenario.carried_notes]
        limit = StepLimit(self.arm) if loop is None else loop.step_limit
        self._check_step(limit)
        self.rule = scenario.solver.rule
        if self.rule == "auto":
            often = (self.sampled if sampled is None else sampled) or limit.plant.turn is not None
            self.rule = auto_rule(limit, sampled=often)
        self.reduction = Reduction.of(scenario.recording.reduce, self.arm.n) if scenario.recording.reduce else None
        self.tick = self.origin = self.begun = 0 if self._started is None else self._started.tick
        self.reference = self.reference_of_ticks(
            1 if scenario.duration is None else scenario.ticks, first=scenario.duration is not None
        )
        if self.sampled and self._started is None and scenario.start.q is None:
            self.notes += start_notes(self.arm, self.reference)
        config, self.initialisation = self._configured()
        self.config = replace(config, lands=lands)
        target, outputs = scenario.solver.target, scenario.recording.what == "all"
        if loop is not None:
            loop.check(self.config, target, scenario.solver.device, outputs=outputs)
        self.loop = loop or self._compiled(target, outputs=outputs)
        self.width = self.loop.loops[0].target.width
        self.untraced, self.plant = self.loop.tick.untraced, self.config.bare
        called = self.untraced is not None and self.law is not None
        if called:
            lanes = "" if scenario.lane_count is None or self.controller.vectorised else " for every lane"
            self.notes.append(
                f"controller {self.controller.name!r} is not compiled ({self.untraced}): called in Python once a tick{lanes}, "
                "which is slower"
            )
        if self._started is not None:
            self.notes += self._begun_anew(self._started)
        self.rows = {name: landing_rows(schedule, self.period) for name, schedule in self.inputs.items()}
        if self.reference is not None and self.reference.rows is not None:
            self.rows["r"] = landing_rows(self.reference.rows, self.period)
        self._solver = self._cvodes() if scenario.solver.rule == "cvodes" else None
        self._in_python = PythonController(self.controller, self.arm, self.period) if called else None
        self._keep = self._kept_blocks()

    # Making.

    def _compiled(self, target: str | None, *, outputs: bool) -> CompiledLoop:
        """The loop in native code."""
        return CompiledLoop.of(self.config, target, outputs=outputs, device=self.scenario.solver.device)

    @property
    def controller(self) -> ControllerAdapter:
        """The controller of a sampled loop."""
        assert self.config.sampling is not None
        return self.config.sampling.controller

    def _check_step(self, limit: StepLimit | VariedStepLimit) -> None:
        """Refuses an arm that cannot move, and a step that is too large for one that can."""
        scenario, arm, name = self.scenario, self.arm, self.scenario.solver.rule
        check_inertia(arm, scenario.initial_state[0, : arm.n])
        if name not in INTEGRATORS:  # a step that is too long is taken again
            return
        commands = full_voltage(arm)[None] if self.sampled else all_rows(self.inputs["u"])
        if scenario.varied is not None:
            limit = VariedStepLimit(scenario.varied, scenario.parameters, scenario.lane_count is not None)
        substeps = None if scenario.loop is None or scenario.loop.period is None else self.substeps
        whole = () if self.sampled else scenario.whole_times
        limit.check_step(name, INTEGRATORS[name], self.step_length, commands, substeps, whole=whole)

    def reference_of_ticks(self, ticks: int, *, first: bool = False) -> LoopReference | None:
        """The reference of so many ticks from here, `first` when the scenario is checked; None where nobody asks."""
        scenario, reference = self.scenario, self._followed
        if not self.sampled and self.reduction is None:
            return None
        numbers = range(self.tick, self.tick + ticks + 1)
        state = {} if self._started is None else self._started.blocks
        start = state.get("r", scenario.initial_state)[:, : self.arm.n]
        if not first and _is_table(reference):
            # Rows count from where the scenario starts; the last one stays.
            rows = np.arange(numbers.start, numbers.stop) - self.begun
            reference = np.asarray(reference)[np.clip(rows, 0, len(reference) - 1)]
        try:
            return LoopReference.of(self.arm, reference, start, numbers, self.period)
        except ScenarioError as error:
            raise error.within("loop" if self.sampled else "recording") from None

    def _configured(self) -> tuple[LoopConfig, Initialisation]:
        """Parts of a tick, and initial values of its lanes."""
        scenario, n, sensors, controller = self.scenario, self.arm.n, None, None
        plant = Plant.of(self.arm, brakes=scenario.inputs.brake is not None)
        if self.reduction is not None:
            check_known(self.reduction, self.arm, plant.outputs(plant.initial(np.zeros(n), np.zeros(n)), np.zeros(n)))
            if self.reference is not None and "q" not in self.reference.layout:
                what, expected = "has no signal q", "a reference of the joints beside recording.reduce"
                raise ScenarioError(what, place="loop.reference", expected=expected)
        layouts = {"x": plant.layout}
        if scenario.loop is not None:
            assert self.reference is not None
            sensors = SensorSet.of(plant, scenario.loop.sensor_list, wrench=scenario.inputs.wrench is not None)
            controller = ControllerAdapter(scenario.controller_fields, sensors.y, self.reference.layout)
            layouts |= {"y": sensors.y, "r": self.reference.layout, "u_issued": self.command, "u": self.command}
        stored = {"none": (), "state": ("x",), "all": tuple(layouts)}[scenario.recording.what]
        config = LoopConfig(
            self.arm,
            scenario.varied,
            self.rule,
            scenario.solver.adaptivity,
            inputs={name: all_rows(schedule).shape[1] for name, schedule in self.inputs.items() if name != "u"},
            payload_frames=self._payload_frames,
            recorded={name: layouts[name] for name in stored},
            reduction=self.reduction,
            reference=self.reference,
        )
        start = scenario.initial_state if self._started is None else self._started.blocks["x"]
        first = (config, start, scenario.parameters, scenario.first_command, controller, sensors)
        initialisation = Initialisation(*first, self.period, scenario.solver.target)
        if scenario.loop is None or sensors is None or controller is None:
            return config, initialisation
        delays = Delays.of(scenario.loop.timing, self.period)
        outside = "it is commanded from outside" if self.external else None
        sampling = Sampling(
            controller, initialisation.states, sensors, scenario.loop.command_filter, delays, self.period,
            outside or initialisation.untraced,
        )  # fmt: skip
        return replace(config, sampling=sampling), initialisation

    def _cvodes(self) -> Cvodes:
        """CVODES for the plant."""
        assert self.scenario.solver.adaptivity is not None
        check_lanes(self.count)
        if self.plant.sticking is not None:
            raise ScenarioError(
                "follows no friction or gear loss that sticks",
                place="solver.integrator",
                value="cvodes",
                expected="'rk45', 'auto' or a fixed step; or a record with a smoothing speed in `friction`",
            )
        stiff, watched = bool(self.plant.stiff), plant_watched(self.config)
        derivative, shapes = plant_derivative(self.config), self.config.plant_shapes
        return Cvodes(derivative, shapes, self.scenario.solver.adaptivity, stiff, watched, plant_turn(self.config))

    def _kept_blocks(self) -> set[str]:
        """Names of the blocks that make the state of the loop."""
        stages = [loop.stages for loop in self.loop.loops]
        every = tuple(stage for part in stages for stage in part)
        kept = state_blocks(every) | {"x", "frozen"}
        if len(stages) > 1:  # a loop that is commanded from outside may be kept between both of its halves
            kept |= state_blocks((*stages[1], *stages[0]))
        if self._solver is not None:
            seen = {name + SEEN for name in self.loop.tick.seen}
            kept.add(GAVE_UP)
            kept |= {TURNS} if self.plant.turn is not None else set()
            kept |= {"u", *seen} & {name for loop in self.loop.loops for name in loop.sizes}
        begun = {"x_first", "allowed"}  # where ranges are measured from, and what a step may be wrong by
        kept |= begun & {name for loop in self.loop.loops for name in loop.sizes}
        if self.sampled and self._followed is None:
            kept.add("r")  # where it began, and stays
        return kept - {"reduced"}

    # Lanes.

    def lanes(self, count: int, first: int = 0) -> LaneGroup:
        """Memory of a group of lanes without blocks, from a place among those that are run."""
        return LaneGroup(count, self.width, first, self.scenario.first_lane)

    def begin(self, lanes: LaneGroup, state: LoopState | None) -> None:
        """Fills the blocks of a group of lanes with initial values, then with those of a state to go on from."""
        for loop in self.loop.loops:
            loop.extend(lanes)
        if self._solver is not None:
            self._solver.extend(lanes)
        values = self.initial_blocks(lanes)
        x = values["x"]
        for name, rows in values.items():
            if name in lanes.blocks:
                lanes.set(name, rows)
        for name, rows in self.rows.items():
            self.loop.loops[0].begin_rows(lanes, name, rows, self.tick)
        if self.scenario.solver.adaptivity is not None:
            horizon = self.scenario.horizon if self.config.is_ahead else None
            begin_adaptive(lanes, self.scenario.solver.adaptivity, self.plant.layout, x, horizon)
        for name, block in (("y_old", "y_kept"), ("u", "u"), ("u_queued", "u")):
            if name in lanes.rings:
                lanes.fill_ring(name, values[block])
        if state is not None:
            self._restore(lanes, state)
        if self._in_python is not None:
            self._in_python.begin(lanes, values["y"])

    def acting(self, lanes: LaneGroup) -> dict[str, np.ndarray]:
        """Inputs (count or 1, entries) that act on a group of lanes in the next tick; without payload and wrench, empty ones."""
        none = dict.fromkeys(("payload", "wrench"), np.zeros((1, 0)))
        return none | {name: self._in_force(name, lanes) for name in self.config.inputs}

    def _in_force(self, name: str, lanes: LaneGroup) -> np.ndarray:
        """Values (count or 1, entries) of an input's schedule that act on a group of lanes in the tick that comes next."""
        at = np.array([float(self.tick)])
        return lanes.own(values_at_ticks(self.inputs[name], at, self.period)[:, 0])

    def initial_blocks(self, lanes: LaneGroup) -> dict[str, np.ndarray]:
        """Initial values of blocks for a group of lanes, (count, …) each, or (1, …) where they are the same for all."""
        acting = self.acting(lanes)
        values = self.initialisation.blocks(lanes, acting, sampling=self.config.sampling)
        values |= {"p": lanes.own(self.scenario.parameters), "q_first": self.plant.part(values["x"], "q")}
        values |= {name + SEEN: acting[name] for name in self.config.inputs}
        if self.reference is not None and self.reference.final is not None:
            values["r_final"] = lanes.own(self.reference.final)
        if self.reference is not None and self.reference.values is not None:
            values[PARAMETERS] = lanes.own(self.reference.values)
        if self.reduction is not None:
            values["reduced"] = np.atleast_2d(self.reduction.begin())
        return values

    @property
    def initial(self) -> dict[str, np.ndarray]:
        """Initial values of the first lane's blocks, (entries,) each."""
        return {name: rows[0] for name, rows in self.initial_blocks(self.lanes(1)).items()}

    def _restore(self, lanes: LaneGroup, state: LoopState) -> None:
        """Fills the blocks of a group of lanes with those of a state, as far as this loop has them."""
        anew = self._anew(state)
        group = (
            np.arange(lanes.first, lanes.first + lanes.count) if state.lanes > 1 else np.zeros(lanes.count, dtype=int)
        )
        for name in self._keep - anew:
            if name in state.blocks and state.blocks[name].shape[1:] == lanes.blocks[name].shape[1:2]:
                lanes.set(name, state.blocks[name][group])
        for name, ring in lanes.rings.items():
            if name not in anew and name in state.rings and state.rings[name].shape[1:] == ring.shape[1:3]:
                lanes.set_ring(name, state.rings[name][group])
        if self._in_python is not None and "s" not in anew:
            self._in_python.restore(
                lanes,
                {lane: state.python[k] for lane, k in enumerate(group.tolist(), lanes.first) if k in state.python},
            )

    def _anew(self, state: LoopState) -> set[str]:
        """Blocks and rings that do not go on, since the state comes from another controller."""
        return {"s"} if self.law is not None and state.controller != self.controller.name else set()

    @property
    def state_entries(self) -> list[str]:
        """Names of the entries of the plant's state: "qd of joint2"."""
        names, layout = self.arm.names, self.plant.layout
        return [
            f"{part.name} of {names[i]}" if part.joints else part.name for part in layout for i in part.joints or (0,)
        ]

    def measured_in(self, state: LoopState | None) -> bool:
        """True for a state to go on from that has the measurement of its tick already.

        Raises:
            ScenarioError: it has, and this loop measures and commands in one go: sensors would measure twice.
        """
        if state is None or not state.measured:
            return False
        if len(self.loop.loops) == 1:
            what = f"the state at t = {state.time:g} s has its measurement already"
            expected = (
                "one from before `measurement` was asked, such as after `step`, for a controller that is compiled"
            )
            raise ScenarioError(what, place="start", expected=expected)
        return True

    def _begun_anew(self, state: LoopState) -> list[str]:
        """Notes of what does not go on from a state."""
        if self.law is None or state.controller in ("", self.controller.name):
            return []
        return [f"controller {self.controller.name!r} began anew at t = {state.time:g} s, behind {state.controller!r}"]

    def state_of(self, groups: list[LaneGroup]) -> LoopState:
        """The state of all lanes, which stand between two ticks."""
        first = groups[0]
        blocks = {name: np.concatenate([each.get(name) for each in groups]) for name in sorted(self._keep)}
        rings = {name: np.concatenate([each.get_ring(name) for each in groups]) for name in first.rings}
        python: Mapping[int, Any] = {} if self._in_python is None else self._in_python.memories(groups)
        name = "" if self.law is None else self.controller.name
        entries = self.plant.layout.entry_names(self.arm.names)
        return LoopState(self.tick, self.period, self.scenario.lane_count is None, entries, blocks, rings, python, name)

    def advance(
        self,
        lanes: LaneGroup,
        tick: int,
        end: int,
        last: int,
        record: np.ndarray | None,
        every: int,
        *,
        measured: bool = False,
        substeps: int | None = None,
    ) -> None:
        """Takes a group of lanes through ticks, from one to before another; in tick `last` nothing moves.

        `measured`: whether the stages before the controller are done for the first of them.   `substeps`: of each tick, by
        default the scenario's.
        """
        records, loops = {} if record is None else {"run": record}, self.loop.loops
        run = partial(
            self.run_loop, lanes=lanes, records=records, last=last, every=every, substeps=substeps or self.substeps
        )
        if len(loops) == 1 and self._solver is None:
            run(loops[0], ticks=(tick, end))
            return
        before, *after = loops
        for k in range(tick, end):
            if not (after and measured and k == tick):
                run(before, ticks=(k, k + 1))
            if self._in_python is not None:
                self._in_python.step(lanes, k)
            if after:
                run(after[0], ticks=(k, k + 1))
            if self._solver is not None and k < last:
                steady = 1 if self.sampled else last - k  # ticks in which schedules alone change anything
                self._solver.tick(lanes, k, self.period, self.rows, steady)

    def run_loop(
        self,
        loop: NativeLoop,
        lanes: LaneGroup,
        ticks: tuple[int, int],
        records: Mapping[str, np.ndarray],
        **counts: int,
    ) -> None:
        """Takes lanes through ticks of a loop in native code with this scenario's reference, schedules and random numbers.

        `records`, `counts`: as of `NativeLoop.run`.
        """
        table = None if self.reference is None else self.reference.table
        arrays = LoopArrays({} if table is None else {"r": table}, self.rows, records)
        loop.run(lanes, self.period, ticks, arrays, origin=self.origin, seed=self.scenario.seed, **counts)


def _is_table(reference: Any) -> bool:
    """True for rows of numbers, one a tick."""
    try:
        return isinstance(reference, (np.ndarray, list, tuple)) and np.ndim(reference) == 2
    except ValueError:  # lists of different lengths or depths, which are refused where the reference is read
        return False

"""Simulation of an arm with its motors: a loop that is run, stepped, stopped, saved and continued to the bit."""

from __future__ import annotations

import json
import os
import time as clock
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.interfaces import JointReference, Measurement
from armwright.kernels.loop import ENDLESS, Lanes
from armwright.kernels.stages import state_blocks
from armwright.signals import Values
from armwright.simulation.batch_runner import Progress, Work, handed_out, run_groups
from armwright.simulation.inputs.acting import numbers_of, rows_of
from armwright.simulation.inputs.schedule_ticks import held_values, landing_rows
from armwright.simulation.integrate.cvodes import Cvodes, check_lanes
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.integrate.stepping import Account, begin_adaptive
from armwright.simulation.loop.compiled import CompiledLoop
from armwright.simulation.loop.config import LoopConfig, Sampling
from armwright.simulation.loop.controller import ControllerAdapter, reference_of
from armwright.simulation.loop.initialisation import Initialisation
from armwright.simulation.loop.python_controller import PythonController
from armwright.simulation.loop.references import PARAMETERS, LoopReference
from armwright.simulation.loop.sensor_set import SensorSet, measurement_of
from armwright.simulation.loop.state import LoopState
from armwright.simulation.loop.tick import plant_derivative, plant_watched
from armwright.simulation.loop.timing import Delays
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.stability import Stability, check_inertia
from armwright.simulation.plant.varied_steps import VariedSteps
from armwright.simulation.results.dataset import Recorded, run_dataset
from armwright.simulation.results.provenance import provenance
from armwright.simulation.results.reducers import Reduction, check_known
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_checks import check_threads, checked_state

if TYPE_CHECKING:
    import xarray

AHEAD = 1024  # ticks whose reference is worked out at once while a loop is stepped
SLICE = 0.01  # [s] of a run in real time between two looks at the clock


class Simulation:
    """A scenario, compiled: run in one go, or stepped tick by tick, and continued from any state to the bit.

    Args:
        scenario: what to simulate. One without commands, schedule and controller is commanded by `step(command)`.
        loop: compiled code to use again, for commands over time alone; by default it is compiled.

    Attributes:
        tick: number of the tick that comes next.   period: [s] of a tick.
        notes: what a user should know of how it is run.
        untraced: why the controller runs in Python; None where it is compiled, or there is none.
    Raises:
        ScenarioError: a joint without inertia, or a step too large for the arm's fastest time constant.
    """

    def __init__(self, scenario: Scenario, *, loop: CompiledLoop | None = None):
        self.scenario = scenario = scenario.resolved
        self.arm = scenario.arm
        self.count, self.period = scenario.lane_count or 1, scenario.tick
        self.notes: list[str] = []
        self._check_step(loop)
        self._started = scenario.started
        self.inputs = dict(scenario.inputs)
        if scenario.sampled is False:
            self.inputs["u"] = scenario.commands
        self.reduction = Reduction.of(scenario.reduce, self.arm.n) if scenario.reduce else None
        self.tick = self.origin = 0 if self._started is None else self._started.tick
        self.reference = self._reference(
            1 if scenario.duration is None else scenario.ticks, first=scenario.duration is not None
        )
        self.config, self.initialisation = self._configured()
        if loop is not None:
            loop.check(self.config, scenario.target, outputs=scenario.record == "all")
        self.loop = loop or CompiledLoop.of(self.config, scenario.target, outputs=scenario.record == "all")
        self.untraced, self.plant = self.loop.tick.untraced, self.config.bare
        if self.untraced is not None and scenario.controller is not None:
            lanes = "" if scenario.lane_count is None or self.controller.vectorised else " for every lane"
            self.notes.append(
                f"controller {self.controller.name!r} is not compiled ({self.untraced}): called in Python once a tick{lanes}, "
                "which is slower"
            )
        if self._started is not None:
            self.notes += self._begun_anew(self._started)
        self.rows = {name: landing_rows(held, self.period) for name, held in self.inputs.items()}
        if self.reference is not None and self.reference.rows is not None:
            self.rows["r"] = landing_rows(self.reference.rows, self.period)
        self._solver = self._cvodes() if scenario.integrator == "cvodes" else None
        called = self.untraced is not None and scenario.controller is not None
        self._in_python = PythonController(self.controller, self.arm, self.period) if called else None
        self._lanes: Lanes | None = None  # of a loop that is stepped
        self._measured = self._measured_in(self._started)  # whether the tick that comes next has its measurement
        self._keep = self._kept_blocks()

    # Making.

    @property
    def controller(self) -> ControllerAdapter:
        """The controller of a sampled loop."""
        assert self.config.sampling is not None
        return self.config.sampling.controller

    def _check_step(self, loop: CompiledLoop | None) -> None:
        """Refuses an arm that cannot move, and a step that is too large for one that can."""
        scenario, arm, name = self.scenario, self.arm, self.scenario.integrator
        check_inertia(arm, scenario.initial_state[0, : arm.n])
        if name not in INTEGRATORS:
            return
        stability = Stability(arm) if loop is None else loop.stability
        commands = np.zeros((1, arm.n)) if scenario.sampled else rows_of(scenario.commands)
        if scenario.varied is not None:
            stability = VariedSteps(scenario.varied, scenario.parameters, scenario.lane_count is not None)
        stability.check_step(name, INTEGRATORS[name], scenario.integration_step, commands)

    def _reference(self, ticks: int, *, first: bool = False) -> LoopReference | None:
        """The reference of so many ticks from here, `first` when the scenario is checked; None where nobody asks."""
        scenario = self.scenario
        if not scenario.sampled and self.reduction is None:
            return None
        numbers = np.arange(self.tick, self.tick + ticks + 1)
        state = {} if self._started is None else self._started.blocks
        start = state.get("r", scenario.initial_state)[:, : self.arm.n]
        reference = scenario.reference
        if isinstance(reference, (np.ndarray, list, tuple)) and np.ndim(reference) == 2 and not first:
            begun = (
                0 if scenario.started is None else scenario.started.tick
            )  # the rows count from there; the last one stays
            reference = np.asarray(reference)[np.clip(numbers - begun, 0, len(reference) - 1)]
        return LoopReference.of(self.arm, reference, start, numbers, self.period)

    def _configured(self) -> tuple[LoopConfig, Initialisation]:
        """What a tick is made of, and how its lanes begin."""
        scenario, n, sensors, controller = self.scenario, self.arm.n, None, None
        plant = Plant.of(self.arm, brakes=scenario.brake is not None)
        if self.reduction is not None:
            check_known(self.reduction, self.arm, plant.outputs(plant.initial(np.zeros(n), np.zeros(n)), np.zeros(n)))
            if self.reference is not None and "q" not in self.reference.layout:
                raise ScenarioError(
                    "reduce: the reference has no signal q; expected a reference of the joints beside reduce"
                )
        layouts = {"x": plant.layout}
        if scenario.sampled:
            assert self.reference is not None
            sensors = SensorSet.of(plant, scenario.sensor_list, wrench=scenario.wrench is not None)
            controller = ControllerAdapter(scenario.controller_fields, sensors.y, self.reference.layout)
            layouts |= {"y": sensors.y, "r": self.reference.layout, "u_issued": scenario.command_layout}
            layouts |= {"u": scenario.command_layout}
        stored = {"none": (), "state": ("x",), "all": tuple(layouts)}[scenario.record]
        config = LoopConfig(
            self.arm,
            scenario.varied,
            scenario.integrator,
            scenario.adaptivity,
            scenario.substeps if scenario.sampled else 1,
            inputs={name: rows_of(held).shape[1] for name, held in scenario.inputs.items()},
            payload_frames=scenario.payload_frames,
            recorded={name: layouts[name] for name in stored},
            reduction=self.reduction,
            reference=self.reference,
        )
        start = scenario.initial_state if self._started is None else self._started.blocks["x"]
        first = (config, start, scenario.parameters, scenario.first_command, controller, sensors)
        initialisation = Initialisation(*first, self.period, scenario.target)
        if sensors is None or controller is None:
            return config, initialisation
        delays = Delays.of(scenario.timing, self.period)
        outside = None if scenario.controller is not None else "it is commanded from outside"
        sampling = Sampling(
            controller, initialisation.states, sensors, scenario.shaping, delays, self.period,
            outside or initialisation.untraced,
        )  # fmt: skip
        return replace(config, sampling=sampling), initialisation

    def _cvodes(self) -> Cvodes:
        """CVODES for the plant."""
        assert self.scenario.adaptivity is not None
        check_lanes(self.count)
        stiff, watched = bool(self.plant.stiff), plant_watched(self.config)
        return Cvodes(*plant_derivative(self.config), self.scenario.adaptivity, stiff, watched)

    def _kept_blocks(self) -> set[str]:
        """Names of the blocks that make the state of the loop."""
        stages = [loop.stages for loop in self.loop.loops]
        every = tuple(stage for part in stages for stage in part)
        kept = state_blocks(every) | {"x", "frozen"}
        if len(stages) > 1:  # a loop that is commanded from outside may be kept between both of its halves
            kept |= state_blocks((*stages[1], *stages[0]))
        if self._solver is not None:
            kept |= {"u", "x_seen"} & {name for loop in self.loop.loops for name in loop.sizes}
        if self.scenario.sampled and self.scenario.reference is None:
            kept.add("r")  # where it began, and stays
        return kept - {"reduced"}

    # Lanes.

    def _begin(self, lanes: Lanes, state: LoopState | None) -> None:
        """Fills the blocks of a group of lanes with initial values, then with those of a state to go on from."""
        for loop in self.loop.loops:
            loop.extend(lanes)
        if self._solver is not None:
            self._solver.extend(lanes)
        values = self.initial_blocks(lanes)
        x = values["x"]
        for name, given in values.items():
            if name in lanes.blocks:
                lanes.set(name, given)
        for name, rows in self.rows.items():
            self.loop.loops[0].begin_rows(lanes, name, rows, self.tick)
        if self.scenario.adaptivity is not None:
            begin_adaptive(lanes, self.scenario.adaptivity, self.plant.layout, x)
        for name, block in (("y_old", "y_kept"), ("u", "u"), ("u_queued", "u")):
            if name in lanes.rings:
                lanes.fill_ring(name, values[block])
        if state is not None:
            self._restore(lanes, state)
        if self._in_python is not None:
            self._in_python.begin(lanes, values["y"])

    def acting(self, lanes: Lanes) -> tuple[np.ndarray, np.ndarray]:
        """Payload and wrench (count or 1, entries) that act on a group of lanes in the tick that comes next."""
        at = np.array([float(self.tick)])
        payload, wrench = (
            lanes.own(held_values(self.inputs[name], at, self.period)[:, 0])
            if name in self.config.inputs
            else np.zeros((1, 0))
            for name in ("payload", "wrench")
        )
        return payload, wrench

    def initial_blocks(self, lanes: Lanes) -> dict[str, np.ndarray]:
        """Initial values of blocks for a group of lanes, (count, …) each, or (1, …) where they are the same for all."""
        values = self.initialisation.blocks(lanes, *self.acting(lanes), sampling=self.config.sampling)
        values |= {"p": lanes.own(self.scenario.parameters), "q_first": self.plant.part(values["x"], "q")}
        if self.reference is not None and self.reference.final is not None:
            values["r_final"] = lanes.own(self.reference.final)
        if self.reference is not None and self.reference.values is not None:
            values[PARAMETERS] = lanes.own(self.reference.values)
        if self.reduction is not None:
            values["reduced"] = np.atleast_2d(self.reduction.begin())
        return values

    def _restore(self, lanes: Lanes, state: LoopState) -> None:
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
        return {"s"} if self.scenario.controller is not None and state.controller != self.controller.name else set()

    def _measured_in(self, state: LoopState | None) -> bool:
        """Whether a state to go on from has the measurement of its tick already.

        Raises:
            ScenarioError: it has, and this loop measures and commands in one go: sensors would measure twice.
        """
        if state is None or not state.measured:
            return False
        if len(self.loop.loops) == 1:
            raise ScenarioError(
                f"start: the state at t = {state.time:g} s has its measurement already; expected one from before "
                "`measurement` was asked, such as after `step`, for a controller that is compiled"
            )
        return True

    def _begun_anew(self, state: LoopState) -> list[str]:
        """Notes of what does not go on from a state."""
        if self.scenario.controller is None or state.controller in ("", self.controller.name):
            return []
        return [f"controller {self.controller.name!r} began anew at t = {state.time:g} s, behind {state.controller!r}"]

    def _state_of(self, groups: list[Lanes]) -> LoopState:
        """The state of all lanes, which stand between two ticks."""
        first = groups[0]
        blocks = {name: np.concatenate([each.get(name) for each in groups]) for name in sorted(self._keep)}
        rings = {name: np.concatenate([each.get_ring(name) for each in groups]) for name in first.rings}
        python: Mapping[int, Any] = {} if self._in_python is None else self._in_python.memories(groups)
        name = "" if self.scenario.controller is None else self.controller.name
        entries = self.plant.layout.entry_names(self.arm.names)
        return LoopState(self.tick, self.period, self.scenario.lane_count is None, entries, blocks, rings, python, name)

    def _advance(
        self,
        lanes: Lanes,
        tick: int,
        end: int,
        last: int,
        record: np.ndarray | None,
        every: int,
        *,
        measured: bool = False,
    ) -> None:
        """Takes a group of lanes through ticks, from one to before another; in tick `last` nothing moves.

        `measured`: whether the stages before the controller are done for the first of them.
        """
        run = {**self._given(), "last": last, "every": every, "records": {} if record is None else {"run": record}}
        loops = self.loop.loops
        if len(loops) == 1 and self._solver is None:
            loops[0].run(lanes, self.period, (tick, end), **run)
            return
        before, *after = loops
        for k in range(tick, end):
            if not (after and measured and k == tick):
                before.run(lanes, self.period, (k, k + 1), **run)
            if self._in_python is not None:
                self._in_python.step(lanes, k)
            if after:
                after[0].run(lanes, self.period, (k, k + 1), **run)
            if self._solver is not None and k < last:
                steady = 1 if self.scenario.sampled else last - k  # ticks in which schedules alone change anything
                self._solver.tick(lanes, k, self.period, self.rows, steady)

    def _given(self) -> dict[str, Any]:
        """What compiled loops take beside lanes and ticks."""
        table = None if self.reference is None else self.reference.table
        tables = {} if table is None else {"r": table}
        return {"origin": self.origin, "seed": self.scenario.seed, "tables": tables, "schedules": self.rows}

    # Running.

    @property
    def time(self) -> float:
        """[s] of the tick that comes next."""
        return self.tick * self.period

    def run(
        self,
        duration: float | None = None,
        *,
        progress: Progress | None = None,
        threads: int | None = None,
        real_time: bool = False,
        keep_state: bool = True,
    ) -> xarray.Dataset:
        """The motion from here on; the simulation then stands at its end.

        Args:
            duration: [s]; default: the scenario's.
            progress: called now and then with the steps done and the steps there are, over all lanes.
            threads: how many share the lanes, by default all cores; the result does not depend on it.
            real_time: whether the run takes as long as the motion.
            keep_state: whether the state at the end is kept, which takes room for many lanes; else the simulation stays where
                it is.
        Returns:
            run: time, q, qd, qdd, tau, u and, where the record has the constants, voltage and current; units in attributes.
        Raises:
            DivergenceError: a single run left the finite numbers.
            Interrupted: Ctrl-C, a KeyboardInterrupt whose `run` holds the lanes that were finished.
        """
        if duration is not None:
            self.scenario = replace(self.scenario, duration=duration)
        check_threads(threads)
        if self.scenario.external:
            raise ScenarioError("nothing drives the arm: expected a schedule, constant commands or a controller")
        state = self._started if self._lanes is None else self.state
        scenario, ticks, self.origin = self.scenario, self.scenario.ticks, self.tick
        if self.reference is not None:
            self.reference = self._reference(ticks)
        every, width = scenario.record_every or ticks, self.loop.loops[0].target.width
        record = self._room(ticks, every, width) if self.config.recorded else None
        account = Account.of(self.count, len(scenario.events))
        reduced = np.zeros((self.count, 0 if self.reduction is None else self.reduction.size))
        origin, began = self.origin, clock.perf_counter()
        groups: dict[int, LoopState] = {}
        self._lanes, self._started = None, state  # from here it goes on after Ctrl-C or an error
        self._forget()

        def begin(first: int, count: int) -> Work:
            lanes = Lanes(count, width, first, self.scenario.first_lane)
            self._begin(lanes, state)
            own = None if record is None else record[:, first : first + lanes.tiles * width]

            def advance(tick: int, end: int) -> None:
                tick, end, last = tick + origin, end + origin, origin + ticks
                for start, stop in _slices(tick, end, self.period) if real_time else [(tick, end)]:
                    if real_time:
                        clock.sleep(max(began + (stop - origin) * self.period - clock.perf_counter(), 0.0))
                    measured = self._measured and start == origin
                    self._advance(lanes, start, stop, last, own, every, measured=measured)
                if end == last:
                    if keep_state:
                        groups[first] = replace(self._state_of([lanes]), tick=last)
                    self._advance(lanes, last, last + 1, last, own, every)  # the last row, in whose tick nothing moves

            def finish() -> None:
                account.read(lanes)
                if self.reduction is not None:
                    reduced[first : first + count] = lanes.get("reduced")

            return advance, finish

        in_python = self.untraced is not None or self._solver is not None
        workers = 1 if in_python or real_time else threads or os.cpu_count() or 1
        whole = self._in_python is not None and self.controller.vectorised
        reached = run_groups(self.count, width, ticks, begin, progress, workers, whole=whole)
        recorded, end = Recorded(record, every, reached, account, reduced, origin), None
        if scenario.lane_count is None:
            account.check(self.arm.name, self.period, recorded.last_row(self))
        if keep_state and not reached.stopped:
            self._started = end = _joined(groups)
            self.tick, self._measured = origin + ticks, False
        run = run_dataset(self, recorded)
        if end is not None and scenario.record == "all":
            end.attach(run)
        run.attrs |= {"seed": scenario.seed, "made_with": json.dumps(provenance(scenario.target))}
        if scenario.document is not None:
            run.attrs["scenario"] = scenario.document
        return handed_out(run, reached, ticks, self.count)

    def _room(self, ticks: int, every: int, width: int) -> np.ndarray:
        """Room for what is recorded (rows, lanes in whole tiles, entries)."""
        entries = sum(layout.size for layout in self.config.recorded.values())
        shape = (ticks // every + 1, -(-self.count // width) * width, entries)
        try:
            return np.empty(shape)
        except (MemoryError, ValueError):
            raise ScenarioError(
                f"the run would record {shape[0]} rows of {self.count} lanes, {8e-9 * np.prod(shape, dtype=float):.3g} GB, more "
                f"than there is memory for; expected a shorter one, or record_every above {self.scenario.record_every}"
            ) from None

    # Stepping.

    def step(self, command: Any = None) -> None:
        """Takes all lanes through one tick.

        Args:
            command: (n,) [V | A | N m | N], or a `Batch` of such: what a simulation without controller, schedule and
                constant commands is told in this tick. It passes through the command's delays and limits.
        Raises:
            ScenarioError: a command beside another one that drives the arm, none where none does, or one of another shape.
        """
        if (command is None) == self.scenario.external:
            raise ScenarioError(
                "step: no command; expected one, since nothing else drives the arm"
                if command is None
                else "step: a command beside the scenario's own; expected a scenario without commands and controller"
            )
        lanes = self._stepped()
        if command is not None:
            rows = numbers_of("command", command, self.arm.names)
            if len(rows) not in (1, self.count):
                raise ScenarioError(f"step: commands of {len(rows)} lanes; expected 1 or {self.count}")
            self._measure(lanes)
            lanes.set("u_asked", rows)
        self._reach_ahead()
        room, measured = self._room(1, 2, lanes.width), self._measured
        self._advance(lanes, self.tick, self.tick + 1, self.tick + 2, room, ENDLESS, measured=measured)
        self.tick, self._measured = self.tick + 1, False

    def _stepped(self) -> Lanes:
        """The lanes of a loop that is stepped, all in one group."""
        if self._lanes is None:
            self._forget()
            self._lanes = Lanes(self.count, self.loop.loops[0].target.width, 0, self.scenario.first_lane)
            self._begin(self._lanes, self._started)
        return self._lanes

    def _forget(self) -> None:
        """Drops what a controller in Python remembers: lanes that begin take it from the state that they go on from."""
        if self._in_python is not None:
            self._in_python.states.clear()

    def _reach_ahead(self) -> None:
        """Works out the reference of some ticks from here, where it is a table that ends."""
        table = None if self.reference is None else self.reference.table
        if table is not None and not self.origin <= self.tick < self.origin + len(table):
            self.origin = self.tick
            self.reference = self._reference(AHEAD)

    def _measure(self, lanes: Lanes) -> None:
        """Does the stages before the controller for the tick that comes next, once."""
        if not self._measured and len(self.loop.loops) > 1:
            self._reach_ahead()
            self.loop.loops[0].run(lanes, self.period, (self.tick, self.tick + 1), **self._given())
            self._measured = True

    @property
    def measurement(self) -> Measurement:
        """Measurement of the tick that comes next, in a simulation that is commanded by `step`; else of the last tick."""
        lanes = self._sampled("measurement")
        return measurement_of(self.controller.y, self._one(lanes.get("y")))

    @property
    def reference_now(self) -> JointReference | Values:
        """Reference of the tick that `measurement` belongs to."""
        lanes = self._sampled("reference_now")
        return reference_of(self.controller.r, self._one(lanes.get("r")))

    def _sampled(self, asked: str) -> Lanes:
        """The lanes of a sampled loop, measured."""
        if self.config.sampling is None:
            raise ScenarioError(
                f"{asked}: the loop is not sampled; expected a scenario with a controller or without commands"
            )
        lanes = self._stepped()
        self._measure(lanes)
        return lanes

    @property
    def plant_state(self) -> Values:
        """State of the plant by name: q, qd and what else the drives have, (n,) or (lanes, n) each."""
        x = self._stepped().get("x")
        return Values(self.plant.layout.parts(self._one(x)))

    def _one(self, rows: np.ndarray) -> np.ndarray:
        return rows[0].copy() if self.scenario.lane_count is None else rows.copy()

    @property
    def state(self) -> LoopState:
        """The whole state, from which `restore` goes on to the bit."""
        if self._lanes is None and self._started is not None:
            return self._started
        lanes = self._stepped()
        return replace(self._state_of([lanes]), measured=self._measured)

    def restore(self, state: LoopState) -> None:
        """Goes on from a state of this simulation, or of another one of the same scenario.

        Raises:
            ScenarioError: a state of another arm, of another number of lanes or another period.
        """
        state = checked_state(self.scenario, state)
        if state.lanes not in (1, self.count):
            raise ScenarioError(f"restore: a state of {state.lanes} lanes; expected {self.count}")
        measured = self._measured_in(state)
        self.tick = self.origin = state.tick
        self._started, self._measured = state, measured
        self._forget()
        if self.reference is not None:
            self.reference = self._reference(AHEAD)
        if self._lanes is not None:
            self._begin(self._lanes, state)

    def reset(self) -> None:
        """Goes back to where the scenario starts."""
        self._lanes, self._started = None, self.scenario.started
        self._measured = self._measured_in(self._started)
        self.tick = self.origin = 0 if self._started is None else self._started.tick
        self._forget()
        if self.reference is not None:
            self.reference = self._reference(1 if self.scenario.duration is None else self.scenario.ticks)


def simulate(
    scenario: Scenario,
    *,
    progress: Progress | None = None,
    threads: int | None = None,
    loop: CompiledLoop | None = None,
) -> xarray.Dataset:
    """The motion of the arm under the scenario's commands.

    Drive limits clip and are reported in the result's attributes. A lane that diverges is frozen and marked with the time it
    happened; the others go on. A single run that does so raises.

    Args:
        scenario: what to run.
        progress: called now and then with the steps done and the steps there are, over all lanes.
        threads: how many share the lanes, by default all cores; the result does not depend on it.
        loop: a compiled arm to use again, for commands over time alone; by default one is compiled.
    Returns:
        run: time, q, qd, qdd, tau, u and, where the record has the constants, voltage and current; units in attributes.
    Raises:
        ScenarioError: a step too large for the arm's fastest time constant; names the step that would do.
        DivergenceError: a single run left the finite numbers.
        Interrupted: Ctrl-C, a KeyboardInterrupt whose `run` holds the lanes that were finished.
    """
    check_threads(threads)
    return Simulation(scenario, loop=loop).run(progress=progress, threads=threads, keep_state=scenario.record == "all")


def _slices(tick: int, end: int, period: float) -> list[tuple[int, int]]:
    """Ticks in slices of `SLICE` seconds."""
    size = max(1, round(SLICE / period))
    return [(start, min(start + size, end)) for start in range(tick, end, size)]


def _joined(groups: Mapping[int, LoopState]) -> LoopState:
    """The states of groups of lanes as one."""
    ordered = [groups[first] for first in sorted(groups)]
    if len(ordered) == 1:
        return ordered[0]
    blocks = {name: np.concatenate([each.blocks[name] for each in ordered]) for name in ordered[0].blocks}
    rings = {name: np.concatenate([each.rings[name] for each in ordered]) for name in ordered[0].rings}
    return replace(ordered[0], blocks=blocks, rings=rings)

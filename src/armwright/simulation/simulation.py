"""Simulation of an arm with its motors: a loop that is run, stepped, stopped, saved and continued to the bit."""

from __future__ import annotations

import json
import os
import time as clock
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.entry import AnyScenario, as_scenario
from armwright.errors import ScenarioError
from armwright.features import Support
from armwright.interfaces import JointReference, Measurement
from armwright.kernels.compiled import CPU
from armwright.kernels.loop import ENDLESS, LaneGroup
from armwright.progress import Shown, automatic
from armwright.results.notes import notes_of
from armwright.results.provenance import provenance
from armwright.signals import SignalValues
from armwright.simulation.batch_runner import PIECE, PIECE_ON_GPU, Finished, Work, handed_out, run_groups
from armwright.simulation.checks import check_whole
from armwright.simulation.companion import FINER, GlobalError, lanes_again
from armwright.simulation.dataset import RecordedLanes, run_dataset
from armwright.simulation.fixed_steps import COARSE, coarse_step_note
from armwright.simulation.inputs.input_schedule import lane_numbers
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.integrate.lane_status import LaneStatus
from armwright.simulation.integrate.stepping import ACCURACY
from armwright.simulation.loop.compiled import CompiledLoop
from armwright.simulation.loop.controller import reference_of
from armwright.simulation.loop.sensor_set import measurement_of
from armwright.simulation.loop.state import LoopState
from armwright.simulation.loop_runner import LoopRunner
from armwright.simulation.oscillation import instability_note, unstable_loop
from armwright.simulation.scenario import Scenario

if TYPE_CHECKING:
    import xarray

SUPPORT = Support(
    "simulate", scenario=True, without_effect={"brakes": "they are released unless inputs.brake applies them"}
)

AHEAD = 1024  # ticks whose reference is worked out at once while a loop is stepped
WATCHED, LEAST_WATCHED = 1000, 50  # ticks in which a step given by hand is looked at, of one tile of lanes and of many
PRICE = 400  # ticks of a run for one that is looked at
LATE = 0.1  # [s]: steps in real time that are later do not hurry to make up for it, as after a halt in a debugger
SLICE = 0.01  # [s] of a run in real time between two looks at the clock


class Simulation(LoopRunner):
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
    Example:
        >>> arm = aw.load("two-link")
        >>> sim = aw.simulation.Simulation(aw.Scenario(arm, start=[0.3, 0.5]))
        >>> while sim.time < 0.05:
        ...     step = sim.step(aw.gravity_torques(arm, sim.measurement.q))
        >>> sim.measurement.q.round(6)
        array([0.3, 0.5])
    """

    def __init__(self, scenario: Scenario, *, loop: CompiledLoop | None = None, lands: bool = False):
        super().__init__(scenario, loop=loop, lands=lands)
        self._lanes: LaneGroup | None = None  # of a loop that is stepped
        self._measured = self.measured_in(self._started)  # whether the tick that comes next has its measurement
        self._paced: tuple[int, float] | None = None  # tick and clock [s] that steps in real time count from

    # Running.

    def _remedy(self) -> str:
        """Advice for a run that diverges."""
        if self.law is None:
            return ""
        start = np.asarray(self.scenario.initial_state)[:1, : self.arm.n]
        stable = "smaller gains, if the loop is unstable (armwright loops, aw.loops.analyse_loops)"
        return unstable_loop(self.scenario, start) or stable

    @property
    def time(self) -> float:
        """[s] of the tick that comes next."""
        return self.tick * self.period

    def run(
        self,
        duration: float | None = None,
        *,
        progress: Shown = None,
        threads: int | None = None,
        real_time: bool = False,
        keep_state: bool = True,
    ) -> xarray.Dataset:
        """The motion from the present state on; the simulation then is at its end.

        Args:
            duration: [s]; default: the scenario's.
            progress: True or None: a bar in terminals and notebooks, once a second has passed; False: none; a function is called
                now and then with the steps done and the steps there are, over all lanes.
            threads: how many share the lanes, by default all cores; the result does not depend on it.
            real_time: whether the run takes as long as the motion.
            keep_state: whether the state at the end is kept, which takes room for many lanes; else the simulation stays where
                it is.
        Returns:
            run: time, q, qd, qdd, tau, u and, where the record has the constants, voltage and current; units in attributes.
        Raises:
            DivergenceError: a single run diverged.
            Interrupted: Ctrl-C, a KeyboardInterrupt whose `run` holds the lanes that were finished.
        """
        if threads is not None:
            check_whole("threads", threads, 1)
        if self.external:
            expected = "a command, a schedule or a loop with a controller"
            raise ScenarioError("nothing drives the arm", place="command", expected=expected)
        state = self._started if self._lanes is None else self.state
        self.origin = self.tick
        ticks = self.scenario.ticks if duration is None else self.scenario.ticks_of(duration)
        if self.reference is not None:
            self.reference = self.reference_of_ticks(ticks)
        groups = _Groups(self, state, ticks, real_time, keep_state)
        self._lanes, self._started = None, state  # from here it goes on after Ctrl-C or an error
        self._forget()
        on_gpu = self.scenario.solver.device != CPU
        workers = 1 if self._in_turns or real_time or on_gpu else threads or os.cpu_count() or 1
        whole = on_gpu or (self._in_python is not None and self.controller.vectorised)
        piece = PIECE_ON_GPU if on_gpu else PIECE
        with automatic(progress, f"simulating {self.arm.name}", "steps") as tell:
            finished = run_groups(
                self.count, groups.width, ticks, groups.begin, tell, workers, whole=whole, piece=piece
            )
        recorded = groups.recorded(finished)
        errors, end = self._examined(recorded, state, real_time), None
        if keep_state and not finished.stopped:
            self._started = end = _joined(groups.ends)
            self.tick, self._measured = self.origin + ticks, False
        run = self._dataset(recorded, errors, end, whole=duration is None)
        return handed_out(run, finished, ticks, self.count)

    @property
    def _in_turns(self) -> bool:
        """True where Python does something in every tick."""
        return self.untraced is not None or self._solver is not None

    def _examined(self, recorded: RecordedLanes, state: LoopState | None, real_time: bool) -> GlobalError | None:
        """Estimated errors of a run, where there is an estimate; a step that is coarse is noted.

        Raises:
            DivergenceError: a single run diverged.
        """
        scenario, status = self.scenario, recorded.status
        if recorded.rows is not None and not self._in_turns and scenario.solver.rule in INTEGRATORS:
            tiles = -(-self.count // self.width)
            few = WATCHED if tiles == 1 else max(LEAST_WATCHED, recorded.ticks * tiles // PRICE)
            self.note_coarse_step(state, min(recorded.ticks, few))
        if scenario.lane_count is None:
            remedy = self._remedy() if status.frozen[0] >= 0.0 else ""
            status.check(self.arm.name, self.period, self.state_entries, recorded.last_row(self), remedy)
        if self._in_turns or real_time or recorded.finished.stopped:
            return None
        return self._global_error(recorded, state)

    def _dataset(
        self, recorded: RecordedLanes, errors: GlobalError | None, end: LoopState | None, *, whole: bool
    ) -> xarray.Dataset:
        """The dataset of a run with all that says where it comes from; `whole`: it has the scenario's own duration."""
        scenario, run = self.scenario, run_dataset(self, recorded)
        if errors is not None:
            errors.add_to(run)
        note = instability_note(scenario, run) if self.untraced is None else None
        if note is not None:
            run.attrs["notes"] = "\n".join([note, *notes_of(run)])
        if end is not None and scenario.recording.what == "all":
            end.attach(run)
        run.attrs |= {
            "seed": scenario.seed,
            "made_with": json.dumps(dict(provenance(scenario.solver.target)) | self.loop.device_words),
        }
        if scenario.document is not None and whole and recorded.origin == self.begun:
            run.attrs["scenario"] = scenario.document
        return run

    def _global_error(self, recorded: RecordedLanes, state: LoopState | None) -> GlobalError | None:
        """Global error of a run, from a few lanes that are simulated again, if `Solver.global_error` asks for it.

        None where quantisers decide: errors then jump from one count to the next.
        """
        scenario, adaptivity, loop = self.scenario, self.scenario.solver.adaptivity, self.scenario.loop
        quantised = loop is not None and (loop.joint_sensors.quantised or loop.command_filter.resolution is not None)
        asked = scenario.solver.rule == "auto" and scenario.solver.global_error and not quantised
        if recorded.rows is None or not asked or adaptivity is None or adaptivity.allowed.accuracy is None:
            return None
        again, size = lanes_again(self.count, recorded.status.trials), self.plant.layout.size
        lanes = self.lanes(len(again), again.start)
        self.begin(lanes, state)
        lanes.set("allowed", FINER * lanes.get("allowed"))
        rows, last = self._room(recorded.ticks, recorded.every, len(again)), self.origin + recorded.ticks
        self.advance(lanes, self.origin, last + 1, last, rows, recorded.every)
        ours, finer = recorded.rows[:, again.start : again.stop, :size], rows[:, : len(again), :size]
        t = (self.origin + np.arange(len(rows)) * recorded.every) * self.period
        return GlobalError.of(t, ours, finer, self.plant.layout, adaptivity.allowed.accuracy)

    def note_coarse_step(self, state: LoopState | None, ticks: int, accuracy: float = ACCURACY) -> None:
        """Adds a note where the first lane moves otherwise with half the step, over some ticks from here.

        Args:
            state: to begin in; None: as the scenario starts.   ticks: how many.   accuracy: in parts of each quantity's range.
        """
        rows = []
        for parts in (1, 2):
            lanes = self.lanes(1)
            self.begin(lanes, state)
            record = self._room(ticks, 1, 1)
            last = self.origin + ticks
            self.advance(lanes, self.origin, last + 1, last, record, 1, substeps=parts * self.substeps)
            rows.append(record[:, 0, : self.plant.size])
        note = coarse_step_note(self.scenario, self.plant.layout, self.state_entries, *rows, accuracy=accuracy)
        self.notes = [each for each in self.notes if COARSE not in each] + ([] if note is None else [note])

    def _room(self, ticks: int, every: int, count: int) -> np.ndarray:
        """Room for what is recorded of so many lanes: (rows, lanes in whole tiles, entries)."""
        entries = sum(layout.size for layout in self.config.recorded.values())
        shape = (ticks // every + 1, -(-count // self.width) * self.width, entries)
        try:
            return np.empty(shape)
        except (MemoryError, ValueError):
            lanes = f" of {self.count} lanes" if self.count > 1 else ""
            size = f"{shape[0]} rows{lanes}, {8e-9 * np.prod(shape, dtype=float):.3g} GB"
            what, scenario = f"the run would record {size}, more than there is memory for", self.scenario
            longer = f"recording.every above {every}"
            if scenario.recording.period is not None or scenario.solver.rule == "auto":
                longer = f"a recording.period longer than {every * self.period:g} s"
            raise ScenarioError(what, place="recording", expected=f"a shorter one, or {longer}") from None

    # Stepping.

    def step(self, command: Any = None, *, real_time: bool = False) -> None:
        """Takes all lanes through one tick.

        Args:
            command: (n,) [V | A | N m | N], or a `Batch` of such: what a simulation without controller, schedule and
                constant commands takes in this tick. It passes through the command's delays and limits.
            real_time: whether it returns no earlier than the tick ends by the clock, counted from the first such step.
        Raises:
            ScenarioError: a command beside another one that drives the arm, none where none does, or one of another shape.
            DivergenceError: a single lane diverged; of several, those that do are frozen.
        """
        if (command is None) == self.external:
            if command is None:
                raise ScenarioError("missing", place="command", expected="one, since nothing else drives the arm")
            expected = "a scenario without commands and controller"
            raise ScenarioError("beside the scenario's commands or controller", place="command", expected=expected)
        lanes = self._stepped()
        if command is not None:
            rows = lane_numbers("command", command, self.arm.names)
            if len(rows) not in (1, self.count):
                raise ScenarioError(f"{len(rows)} lanes", place="command", expected=f"1 or {self.count}")
            self._measure(lanes)
            lanes.set("u_asked", rows)
        self._reach_ahead()
        room, measured = self._room(1, 2, self.count), self._measured
        self.advance(lanes, self.tick, self.tick + 1, self.tick + 2, room, ENDLESS, measured=measured)
        self.tick, self._measured = self.tick + 1, False
        if real_time:
            self._wait()
        if self.scenario.lane_count is None and lanes.get("frozen")[0, 0] >= 0.0:
            status = LaneStatus.of(1, len(self.scenario.solver.events))
            status.read(lanes)
            status.check(self.arm.name, self.period, self.state_entries, remedy=self._remedy())

    def _wait(self) -> None:
        """Sleeps until the clock is at the time of the tick that comes next."""
        now = clock.perf_counter()
        first, began = (self.tick - 1, now) if self._paced is None else self._paced
        early = began + (self.tick - first) * self.period - now
        self._paced = (first, began) if -LATE < early < LATE + self.period else (self.tick, now)
        clock.sleep(min(max(early, 0.0), self.period))

    def _stepped(self) -> LaneGroup:
        """The lanes of a loop that is stepped, all in one group."""
        if self._lanes is None:
            self._forget()
            self._lanes = self.lanes(self.count)
            self.begin(self._lanes, self._started)
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
            self.reference = self.reference_of_ticks(AHEAD)

    def _measure(self, lanes: LaneGroup) -> None:
        """Does the stages before the controller for the tick that comes next, once."""
        if not self._measured and len(self.loop.loops) > 1:
            self._reach_ahead()
            self.run_loop(self.loop.loops[0], lanes, (self.tick, self.tick + 1), {})
            self._measured = True

    @property
    def measurement(self) -> Measurement:
        """Measurement of the tick that comes next, in a simulation that is commanded by `step`; else of the last tick."""
        lanes = self._sampled("measurement")
        return measurement_of(self.controller.y, self._one(lanes.get("y")))

    @property
    def reference_now(self) -> JointReference | SignalValues:
        """Reference of the tick that `measurement` belongs to."""
        lanes = self._sampled("reference_now")
        return reference_of(self.controller.r, self._one(lanes.get("r")))

    def _sampled(self, asked: str) -> LaneGroup:
        """The lanes of a sampled loop, measured."""
        if self.config.sampling is None:
            expected = "a scenario with a controller or without commands"
            raise ScenarioError("the loop is not sampled", place=asked, expected=expected)
        lanes = self._stepped()
        self._measure(lanes)
        return lanes

    @property
    def plant_state(self) -> SignalValues:
        """State of the plant by name: q, qd and what else the drives have, (n,) or (lanes, n) each."""
        x = self._stepped().get("x")
        return SignalValues(self.plant.layout.parts(self._one(x)))

    def _one(self, rows: np.ndarray) -> np.ndarray:
        return rows[0].copy() if self.scenario.lane_count is None else rows.copy()

    @property
    def state(self) -> LoopState:
        """The whole state, from which `restore` goes on to the bit."""
        if self._lanes is None and self._started is not None:
            return self._started
        lanes = self._stepped()
        return replace(self.state_of([lanes]), measured=self._measured)

    def restore(self, state: LoopState) -> None:
        """Goes on from a state of this simulation, or of another one of the same scenario.

        Raises:
            ScenarioError: a state of another arm, of another number of lanes or another period.
        """
        state = self.scenario.continued(state)
        if state.lanes not in (1, self.count):
            raise ScenarioError(f"{state.lanes} lanes", place="state", expected=str(self.count))
        self._go_on_from(state, state.tick)
        if self._lanes is not None:
            self.begin(self._lanes, state)

    def reset(self) -> None:
        """Goes back to where the scenario starts."""
        self._lanes = None
        self._go_on_from(self.scenario.started, self.begun)

    def _go_on_from(self, state: LoopState | None, tick: int) -> None:
        """Lets what comes next begin at a tick with a state; None: that of the scenario's start."""
        self._started, self._measured = state, self.measured_in(state)
        self.tick = self.origin = tick
        self._forget()
        if self.reference is not None:
            self.reference = self.reference_of_ticks(AHEAD)


class _Groups:
    """Groups of lanes of one run: each is taken through all ticks and leaves rows, status and end in arrays of all lanes.

    Attributes:
        width: lanes of a tile.   ends: state of each group behind the last tick, by its first lane.
    """

    def __init__(self, simulation: Simulation, state: LoopState | None, ticks: int, real_time: bool, keep_state: bool):
        """Rows for a run of so many ticks from a state on; the other arguments as of `Simulation.run`."""
        self._simulation, self._state, self._ticks, self.width = simulation, state, ticks, simulation.width
        self._real_time, self._keep_state, self._began = real_time, keep_state, clock.perf_counter()
        self._every, count = simulation.scenario.every or ticks, simulation.count
        self._record = simulation._room(ticks, self._every, count) if simulation.config.recorded else None
        self._status = LaneStatus.of(count, len(simulation.scenario.solver.events))
        self._reduced = np.zeros((count, 0 if simulation.reduction is None else simulation.reduction.size))
        self.ends: dict[int, LoopState] = {}

    def begin(self, first: int, count: int) -> Work:
        """Functions that take a group from tick to tick of the run, and that end it."""
        simulation, origin = self._simulation, self._simulation.origin
        last, lanes = origin + self._ticks, simulation.lanes(count, first)
        simulation.begin(lanes, self._state)
        rows = None if self._record is None else self._record[:, first : first + lanes.tiles * self.width]

        def advance(tick: int, end: int) -> None:
            tick, end = tick + origin, end + origin
            for start, stop in _slices(tick, end, simulation.period) if self._real_time else [(tick, end)]:
                if self._real_time:
                    due = self._began + (stop - origin) * simulation.period
                    clock.sleep(max(due - clock.perf_counter(), 0.0))
                measured = simulation._measured and start == origin
                simulation.advance(lanes, start, stop, last, rows, self._every, measured=measured)
            if end == last:
                if self._keep_state:
                    self.ends[first] = replace(simulation.state_of([lanes]), tick=last)
                # The last row, in whose tick nothing moves.
                simulation.advance(lanes, last, last + 1, last, rows, self._every)

        def finish() -> None:
            self._status.read(lanes)
            if simulation.reduction is not None:
                self._reduced[first : first + count] = lanes.get("reduced")

        return advance, finish

    def recorded(self, finished: Finished) -> RecordedLanes:
        """Results of the lanes and ticks that were finished."""
        origin = self._simulation.origin
        return RecordedLanes(self._record, self._every, self._ticks, finished, self._status, self._reduced, origin)


def simulate(
    scenario: AnyScenario,
    *,
    progress: Shown = None,
    threads: int | None = None,
    loop: CompiledLoop | None = None,
) -> xarray.Dataset:
    """The motion of the arm under the scenario's commands.

    Drive limits clip and are reported in the result's attributes. A lane that diverges is frozen and marked with the time it
    happened; the others go on. A single run that does so raises.

    Args:
        scenario: what to run.
        progress: True or None: a bar in terminals and notebooks, once a second has passed; False: none; a function is called now
            and then with the steps done and the steps there are, over all lanes.
        threads: how many share the lanes, by default all cores; the result does not depend on it.
        loop: a compiled arm to use again, for commands over time alone; by default one is compiled.
    Returns:
        run: time, q, qd, qdd, tau, u and, where the record has the constants, voltage and current; units in attributes.
    Raises:
        ScenarioError: a step too large for the arm's fastest time constant; names the step that would do.
        DivergenceError: a single run diverged.
        Interrupted: Ctrl-C, a KeyboardInterrupt whose `run` holds the lanes that were finished.
    Example:
        >>> start = [0.0, 0.35, 0.0, 0.6, 0.0, 0.4]
        >>> scenario = aw.Scenario("cmu-dd", 0.5, command=[8, 12, 8, 4, 2, 1], start=start)
        >>> run = aw.simulate(scenario)
        >>> run.q.values[-1].round(3)
        array([ 0.221,  0.263,  0.821,  0.378,  0.917, -0.378])
    """
    scenario = as_scenario(scenario)
    with automatic(progress, f"simulating {scenario.arm.name}", "steps") as tell:
        simulation = Simulation(scenario, loop=loop)
        return simulation.run(progress=tell, threads=threads, keep_state=scenario.recording.what == "all")


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

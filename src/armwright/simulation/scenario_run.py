"""A scenario being run: lanes begun, ticks taken, the record read out."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.kernels.loop import Lanes
from armwright.parameters import Batch
from armwright.simulation.acting.inputs import Held, held, rows_of
from armwright.simulation.acting.landing import held_values, landing_rows
from armwright.simulation.acting.references import reference_rows
from armwright.simulation.acting.schedule import Schedule
from armwright.simulation.beginning import Beginning
from armwright.simulation.compiled import Simulator
from armwright.simulation.continued import last_state
from armwright.simulation.groups import Progress, Work, handed_out, run_groups
from armwright.simulation.integration.cvodes import Cvodes, check_lanes
from armwright.simulation.integration.integrators import INTEGRATORS
from armwright.simulation.integration.stepping import Account, begin_adaptive, state_parts
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.stability import Stability, check_inertia
from armwright.simulation.plant.varied_steps import VariedSteps
from armwright.simulation.results.dataset import run_dataset
from armwright.simulation.results.reducers import Reduction, check_known
from armwright.simulation.sampling.called_law import CalledLaw
from armwright.simulation.sampling.cycle import plant_derivative, plant_watched
from armwright.simulation.sampling.law import Law
from armwright.simulation.sampling.tick_parts import Parts, Sampling
from armwright.simulation.sampling.timing import Delays
from armwright.simulation.scenario import Scenario

if TYPE_CHECKING:
    import xarray

SAMPLED = ("y", "r", "u_issued", "u")  # what is recorded beside the state where a controller commands


class ScenarioRun:
    """One scenario, compiled, to be run as often as one likes.

    Attributes:
        parts: what a tick is made of.   simulator: the same as native code.   plant: with the record's numbers.
        held: what is held from row to row, by block: commands where no controller gives them, what acts on the plant, and a
            reference that is another one in every lane.
        reference: (ticks + 1, 3n) what all lanes follow; None: each its own, or nobody asks.
        final: (lanes or 1, n) its last position.   carried: (lanes or 1, 10 hands) at the beginning.
        notes: what a user should know of how it is run.
        ending: of a single run, when it is over: what the controller remembers and what it had commanded before the last row.
        untraced: why the controller runs in Python; None where it is compiled, or there is none.
    """

    def __init__(self, scenario: Scenario, simulator: Simulator | None = None):
        self.scenario, self.arm, self.law = scenario, scenario.arm, scenario.law
        self.count, self.period, self.ticks = scenario.lanes or 1, scenario.tick, scenario.ticks
        self.held: dict[str, Held] = dict(scenario.inputs)
        if self.law is None:
            self.held["u"] = scenario.commands
        self.notes: list[str] = []
        self.reduction = Reduction.of(scenario.reduce, self.arm.n) if scenario.reduce else None
        self.reference, self.final = self._reference()
        parts = self._parts()
        continued = None if scenario.initial is None else last_state(scenario.initial, parts.bare)
        self.beginning = Beginning(scenario, parts, self.law, continued)
        if self.law is not None:
            parts = replace(parts, sampling=self._sampling(self.law, self.beginning))
        self.simulator = simulator or Simulator.of(parts, scenario.target, told=scenario.record == "all")
        self.parts, self.loops, self.plant = self.simulator.parts, self.simulator.loops, self.simulator.parts.bare
        self.untraced = self.simulator.cycle.untraced
        if self.untraced is not None:
            assert self.law is not None
            lanes = "" if scenario.lanes is None or self.law.vectorised else " for every lane"
            self.notes.append(
                f"controller {self.law.name!r} is not compiled ({self.untraced}): called in Python once a tick{lanes}, "
                "which is slower"
            )
        self.carried = held_values(self.held.get("payload", np.zeros((1, 0))), np.zeros(1), self.period)[:, 0]
        self.rows = {name: landing_rows(held, self.period) for name, held in self.held.items()}
        self.solver = self._solver() if scenario.integrator == "cvodes" else None
        self.called = None if self.law is None else CalledLaw(self.law, self.arm, self.period)
        self.ending: dict[str, np.ndarray] = {}

    def _reference(self) -> tuple[np.ndarray | None, np.ndarray]:
        """What is followed, and where it ends."""
        scenario, n = self.scenario, self.arm.n
        start = scenario.initial_state[:, :n]
        if self.law is None and self.reduction is None:
            return None, start
        if isinstance(scenario.reference, Batch):
            return None, self._lane_references(scenario.reference)
        if scenario.reference is None and (start != start[0]).any():  # every lane stays where it began
            self.held["r"] = np.concatenate([start, np.zeros((len(start), 2 * n))], axis=1)
            return None, start
        wanted = start[0] if scenario.reference is None else scenario.reference
        try:
            times = np.arange(self.ticks + 1) * self.period
            rows = np.ascontiguousarray(reference_rows(self.arm, wanted, times, self.notes))
        except MemoryError:
            raise ScenarioError(
                f"the reference of {self.ticks} ticks of {self.period:g} s takes {24e-9 * n * self.ticks:.3g} GB, more than "
                "there is memory for; expected a shorter run"
            ) from None
        return rows, rows[-1:, :n]

    def _lane_references(self, given: Batch) -> np.ndarray:
        """Poses or schedules of poses, one for each lane; returns where they end (lanes, n)."""
        n = self.arm.n
        rows = held("reference", given, self.arm.names)
        if isinstance(rows, np.ndarray):
            self.held["r"] = np.concatenate([rows, np.zeros((len(rows), 2 * n))], axis=1)
            return rows
        names = [f"{column}{k}" for column in ("q", "qd", "qdd") for k in range(n)]
        self.held["r"] = [
            Schedule(each.times, np.pad(each.commands, ((0, 0), (0, 2 * n))), tuple(names)) for each in rows
        ]
        return held_values(rows, np.array([float(self.ticks)]), self.period)[:, 0]

    def _parts(self) -> Parts:
        """What a tick is made of, but for what a controller adds."""
        scenario, n = self.scenario, self.arm.n
        plant = Plant.of(self.arm, brakes=scenario.brake is not None)
        if self.reduction is not None:
            check_known(self.reduction, self.arm, plant.outputs(plant.initial(np.zeros(n), np.zeros(n)), np.zeros(n)))
        sizes = {"x": plant.size, "y": 4 * n, "r": 3 * n, "u_issued": n, "u": n}
        wanted = () if scenario.record == "none" else ("x",)
        if self.law is not None and scenario.record == "all":
            wanted = tuple(sizes)
        return Parts(
            self.arm,
            scenario.varied,
            scenario.integrator,
            scenario.adaptivity,
            scenario.substeps if self.law is not None else 1,
            inputs={name: rows_of(held).shape[1] for name, held in scenario.inputs.items()},
            hands=scenario.hands,
            recorded={name: sizes[name] for name in wanted},
            reduction=self.reduction,
            apart="r" in self.held,
        )

    def _sampling(self, law: Law, beginning: Beginning) -> Sampling:
        scenario = self.scenario
        delays = Delays.of(scenario.timing, self.period)
        parts = (scenario.sensors, scenario.shaping, delays, self.period, beginning.untraced)
        return Sampling(law, beginning.states, *parts)

    def _solver(self) -> Cvodes:
        """CVODES for the plant."""
        assert self.scenario.adaptivity is not None
        check_lanes(self.count)
        stiff, watched = bool(self.plant.stiff), plant_watched(self.parts)
        return Cvodes(*plant_derivative(self.parts), self.scenario.adaptivity, stiff, watched)

    def begin(self, lanes: Lanes) -> None:
        """Fills the blocks of a group of lanes with what is there before the first tick."""
        scenario = self.scenario
        for loop in self.loops:
            loop.extend(lanes)
        if self.solver is not None:
            self.solver.extend(lanes)
        values = self.beginning.blocks(lanes, lanes.own(self.carried), self.parts.sampling)
        x = values["x"]
        values |= {
            "p": lanes.own(scenario.parameters),
            "q_first": self.plant.part(x, "q"),
            "r_final": lanes.own(self.final),
        }
        if self.reduction is not None:
            values["reduced"] = self.reduction.begin()
        for name, given in values.items():
            if name in lanes.blocks:
                lanes.set(name, given)
        for name, rows in self.rows.items():
            self.loops[0].begin_rows(lanes, name, rows)
        if scenario.adaptivity is not None:
            begin_adaptive(lanes, scenario.adaptivity, state_parts(self.plant), x)
        for name, block in (("y_old", "y_kept"), ("u", "u"), ("u_queued", "u")):
            if name in lanes.rings:
                lanes.fill_ring(name, values[block])
        if self.untraced is not None and self.called is not None:
            self.called.begin(lanes, values["y"])

    def advance(self, lanes: Lanes, tick: int, last: int, record: np.ndarray | None, every: int) -> None:
        """Takes a group of lanes from tick to tick; behind the last one, what is recorded there."""
        if last == self.ticks and self.law is not None and self.scenario.lanes is None:
            self._take(lanes, tick, last, record, every)
            known = {"controller_memory": "s", "command_before": "u"}
            self.ending = {name: lanes.get(block)[0].copy() for name, block in known.items() if block in lanes.blocks}
            tick = last
        self._take(lanes, tick, last + (last == self.ticks), record, every)  # nothing moves in the last row's tick

    def _take(self, lanes: Lanes, tick: int, end: int, record: np.ndarray | None, every: int) -> None:
        """The ticks from one to before another."""
        more: dict[str, Any] = {
            "last": self.ticks,
            "every": every,
            "seed": self.scenario.seed,
            "tables": {} if self.reference is None else {"r": self.reference},
            "records": {} if record is None else {"run": record},
            "schedules": self.rows,
        }
        if len(self.loops) == 1 and self.solver is None:
            self.loops[0].run(lanes, self.period, (tick, end), **more)
            return
        before, *after = self.loops
        for k in range(tick, end):
            before.run(lanes, self.period, (k, k + 1), **more)
            if after:
                assert self.called is not None
                self.called.step(lanes, k)
                after[0].run(lanes, self.period, (k, k + 1), **more)
            if self.solver is not None and k < self.ticks:
                steady = 1 if self.law is not None else self.ticks - k  # ticks in which schedules alone change anything
                self.solver.tick(lanes, k, self.period, self.rows, steady)


def compile_run(scenario: Scenario, simulator: Simulator | None = None) -> ScenarioRun:
    """A scenario, compiled: to be run as often as one likes.

    Args:
        scenario: what to run.   simulator: compiled code to use again; by default it is compiled.
    Raises:
        ScenarioError: a joint without inertia, or a step too large for the arm's fastest time constant.
    """
    arm, name = scenario.arm, scenario.integrator
    check_inertia(arm, scenario.initial_state[0, : arm.n])
    if name in INTEGRATORS:
        stability = Stability(arm) if simulator is None else simulator.stability
        commands = np.zeros((1, arm.n)) if scenario.law is not None else rows_of(scenario.commands)
        if scenario.varied is not None:
            stability = VariedSteps(scenario.varied, scenario.parameters, scenario.lanes is not None)
        stability.check_step(name, INTEGRATORS[name], scenario.integration_step, commands)
    return ScenarioRun(scenario, simulator)


def simulate_run(run: ScenarioRun, progress: Progress | None = None, threads: int | None = None) -> xarray.Dataset:
    """The motion of the arm; see `simulate`."""
    scenario = run.scenario
    every = scenario.record_every or scenario.ticks
    width = run.loops[0].target.width
    record = _record(run, every, width) if run.parts.recorded else None
    account = Account.of(run.count, len(scenario.events))
    reduced = np.zeros((run.count, 0 if run.reduction is None else run.reduction.size))

    def begin(first: int, count: int) -> Work:
        lanes = Lanes(count, width, first)
        run.begin(lanes)
        own = None if record is None else record[:, first : first + lanes.tiles * width]

        def end() -> None:
            account.read(lanes)
            if run.reduction is not None:
                reduced[first : first + count] = lanes.get("reduced")

        return lambda tick, last: run.advance(lanes, tick, last, own, every), end

    in_python = run.untraced is not None or run.solver is not None
    workers = 1 if in_python else threads or os.cpu_count() or 1
    reached = run_groups(run.count, width, run.ticks, begin, progress, workers)
    if scenario.lanes is None:
        last = "" if record is None else f"last state q = {_told(record[-1, 0, : run.arm.n])}{_no_number(run, record)}"
        account.check(run.arm.name, run.period, last)
    found = run_dataset(run, record, every, account, reduced, reached)
    return handed_out(found, reached, run.ticks, run.count)


def _no_number(run: ScenarioRun, record: np.ndarray) -> str:
    """Whether what the controller asked for was no number."""
    end = np.cumsum(list(run.parts.recorded.values()))
    parts = dict(zip(run.parts.recorded, np.split(record[-1, 0], end[:-1]), strict=True))
    asked = parts.get("u_issued", np.zeros(0))
    return "" if np.isfinite(asked).all() else f", where the controller commanded {_told(asked)}"


def _told(q: np.ndarray) -> str:
    return np.array2string(q, precision=4, max_line_width=10**6)


def _record(run: ScenarioRun, every: int, width: int) -> np.ndarray:
    """Room for what is recorded (rows, lanes in whole tiles, entries)."""
    shape = (run.ticks // every + 1, -(-run.count // width) * width, sum(run.parts.recorded.values()))
    try:
        return np.empty(shape)
    except (MemoryError, ValueError):
        raise ScenarioError(
            f"the run would record {shape[0]} rows of {run.count} lanes, {8e-9 * np.prod(shape, dtype=float):.3g} GB, more than "
            f"there is memory for; expected a shorter one, or record_every above {run.scenario.record_every}"
        ) from None

"""A simulated arm under a controller: stages compiled, lanes begun, ticks run, the record read out."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright import scalar
from armwright.actuators import holding_command
from armwright.dynamics import gravity_torques
from armwright.errors import ScenarioError
from armwright.kernels.batch import Kernel
from armwright.kernels.llvm import select_target
from armwright.kernels.loop import Lanes, Loop
from armwright.kernels.stages import NEVER
from armwright.program import Program, interpret, trace
from armwright.scalar import Array
from armwright.simulation.controlled_dataset import controlled_dataset
from armwright.simulation.cvodes import Cvodes, check_lanes
from armwright.simulation.cycle import UNTRACEABLE, Parts, make_cycle, plant_derivative
from armwright.simulation.groups import Progress, Work, handed_out, run_groups
from armwright.simulation.integrators import INTEGRATORS
from armwright.simulation.landing import landing_rows
from armwright.simulation.law import Law, measurement_of, reference_of
from armwright.simulation.plant import Plant
from armwright.simulation.reducers import Reduction, check_known
from armwright.simulation.references import reference_rows
from armwright.simulation.scenario import Scenario
from armwright.simulation.stability import Stability, check_inertia
from armwright.simulation.stepping import Account, begin_adaptive, state_parts
from armwright.simulation.timing import Delays

if TYPE_CHECKING:
    import xarray

BEGUN = ("u_0", "y_0", "m_0", "s_0")
RECORDED = ("x", "y", "r", "u_issued", "u")
FEW = 64  # lanes whose beginnings are interpreted sooner than compiled


class ControlledRun:
    """One controlled scenario: what is compiled for it, and how its lanes begin.

    Attributes:
        t: (ticks + 1,) [s].   reference: (ticks + 1, 3n).   beginning: the program of what is there before the first tick.
        reduction: what is followed in the loop.   untraced: why the controller's beginning is not traced; None where it is.
    """

    def __init__(self, scenario: Scenario, recorded: tuple[str, ...]):
        assert scenario.law is not None
        self.scenario, self.arm, self.law = scenario, scenario.arm, scenario.law
        self.count, self.period, self.ticks = scenario.lanes or 1, scenario.tick, scenario.ticks
        self.t = np.arange(self.ticks + 1) * self.period
        self.plant = Plant.of(self.arm)
        self.delays = Delays.of(scenario.timing, self.period)
        self.target = select_target(scenario.target)
        n, start = self.arm.n, scenario.initial_state
        pose = start[0, :n] if scenario.reference is None else scenario.reference
        self.reference = np.ascontiguousarray(reference_rows(self.arm, pose, self.t))
        sizes = {"x": self.plant.size, "y": 4 * n, "r": 3 * n, "u_issued": n, "u": n}
        self.recorded = {name: sizes[name] for name in recorded}
        self.wrenches = landing_rows(scenario.wrenches, self.period) if scenario.wrenches else None
        if self.wrenches is not None and scenario.record == "all":
            self.recorded["wrench"] = 6
        self.untraced: str | None = None
        self.beginning = self._beginning()
        self.begins = Kernel(self.beginning, self.target) if self.count > FEW else None
        self.reduction = Reduction.of(scenario.reduce, n)
        check_known(self.reduction, self.arm, self.plant.outputs(np.zeros(self.plant.size), np.zeros(n)))
        parts = Parts(
            self.arm,
            scenario.varied,
            self.law,
            self.beginning.outputs[-1].size,
            scenario.sensors,
            scenario.shaping,
            self.delays,
            self.period,
            scenario.substeps,
            scenario.integrator,
            self.recorded,
            self.reduction,
            bool(scenario.wrenches),
            scenario.adaptivity,
            self.untraced,
        )
        self.cycle = make_cycle(parts)
        stages = [self.cycle.before, self.cycle.after]
        if self.cycle.untraced is None:
            stages = [(*self.cycle.before, *self.cycle.after)]
        self.loops = [Loop(part, self.target.doubled()) for part in stages]
        self.solver = self._solver(parts) if scenario.integrator == "cvodes" else None
        self.outputs, self.output_names = self._output_kernel() if scenario.record == "all" else (None, ())
        self._states: dict[int, Any] = {}  # of a controller that runs in Python, by the group's first lane

    def _beginning(self) -> Program:
        """(x, c, p, u?) → the command in force, what is measured, what sensors remember, the controller's state."""
        scenario, n, law = self.scenario, self.arm.n, self.law
        exact = replace(scenario.sensors, position_noise=0.0, velocity_noise=0.0, current_noise=0.0)
        shapes = {"x": (self.plant.size,), "c": law.values.shape[1:], "p": scenario.parameters.shape[1:]}
        if scenario.initial_command is not None:
            shapes["u"] = (n,)

        def begin(x: Array, c: Array, p: Array, *given: Array) -> tuple[Array, ...]:
            arm = scenario.varied.model(p) if scenario.varied is not None else self.arm
            plant = Plant.of(arm)
            u = given[0] if given else holding_command(arm, gravity_torques(arm, plant.part(x, "q")))
            seen, speed, current = plant.measured(x, u, scenario.sensors.side)
            memory = exact.memory(arm, seen, speed)
            seen, speed, current, _ = exact.measure(arm, self.period, seen, speed, current, memory, np.zeros(0))
            y = scalar.array(np.concatenate([seen, speed, current, plant.applied(x, u)]))
            return scalar.array(u), y, scalar.array(memory), law.initial(arm, measurement_of(y, n), c)

        try:
            return trace("begin", begin, shapes, BEGUN)
        except UNTRACEABLE as error:
            # A controller whose `init` cannot be traced has a state of its own kind, which Python keeps.
            self.untraced = f"{type(error).__name__}: {error}"
            law = Law(None, (), (), law.values)
            return trace("begin", begin, shapes, BEGUN)

    def _begun(self, lanes: Lanes) -> dict[str, np.ndarray]:
        """What is there before the first tick for a group of lanes, (count, …) each, or (1, …) where it is the same for all."""
        scenario, n = self.scenario, self.arm.n
        start = lanes.own(scenario.initial_state)
        rows = {
            "x": self.plant.initial(start[:, :n], start[:, n:]),
            "c": lanes.own(self.law.values),
            "p": lanes.own(scenario.parameters),
        }
        given = [np.ascontiguousarray(np.broadcast_to(r, (lanes.count, r.shape[1]))) for r in rows.values()]
        if scenario.initial_command is not None:
            command = lanes.own(self._given_command(scenario.initial_command))
            given.append(np.ascontiguousarray(np.broadcast_to(command, (lanes.count, n))))
        found = interpret(self.beginning, *given) if self.begins is None else self.begins(*given)
        return rows | dict(zip(BEGUN, (np.asarray(each) for each in found), strict=True))

    def _solver(self, parts: Parts) -> Cvodes:
        """CVODES for the plant."""
        assert self.scenario.adaptivity is not None
        check_lanes(self.count)
        return Cvodes(*plant_derivative(parts), self.scenario.adaptivity, bool(self.plant.stiff))

    def _given_command(self, command: Any) -> np.ndarray:
        values = np.atleast_2d(np.asarray(command, dtype=float))
        if values.shape[1:] != (self.arm.n,) or len(values) not in (1, self.count) or not np.isfinite(values).all():
            shape = np.shape(command)
            raise ScenarioError(
                f"initial_command of shape {shape}: expected ({self.arm.n},) finite numbers, one a joint"
            )
        return values

    def _output_kernel(self) -> tuple[Kernel, tuple[str, ...]]:
        """What follows from state, command and wrench, for all recorded rows at once."""
        varied, names, pushed = self.scenario.varied, [], self.wrenches is not None

        def outputs(x: Array, u: Array, *rest: Array) -> tuple[Array, ...]:
            wrench, p = rest[:pushed], rest[pushed:]
            arm = varied.model(p[0]) if varied is not None else self.arm
            found = Plant.of(arm).outputs(x, u, *wrench)
            names[:] = found
            return tuple(found.values())

        shapes = {"x": (self.plant.size,), "u": (self.arm.n,)} | ({"wrench": (6,)} if pushed else {})
        given = [np.zeros(shape) for shape in shapes.values()]
        if varied is not None:
            shapes["p"] = (len(varied.parameters),)
            given.append(varied.nominal)
        outputs(*given)
        return Kernel(trace("outputs", outputs, shapes, tuple(names)), self.target), tuple(names)

    def begin(self, lanes: Lanes) -> None:
        """Fills the blocks of a group of lanes with what is there before the first tick."""
        for loop in self.loops:
            loop.extend(lanes)
        if self.solver is not None:
            self.solver.extend(lanes)
        d, begun, n = self.delays, self._begun(lanes), self.arm.n
        numbers = [lanes.own(each) for each in (d.later, d.jitter, d.drift, d.command_loss, d.measurement_loss)]
        x, y, u = begun["x"], begun["y_0"], begun["u_0"]
        values = {
            "x": x,
            "x_seen": x,
            "see_at": (self.period * (1.0 - lanes.own(d.earlier)))[:, None],
            "m_sensors": begun["m_0"],
            "y_kept": y[:, : 3 * n],
            "d_measured": lanes.own(d.measured)[:, None],
            "s": begun["s_0"],
            "u": u,
            "u_issued": u,
            "u_base": u,
            "arrivals": np.full((lanes.count, 1), NEVER),
            "d_commanded": lanes.own(d.commanded)[:, None],
            "d": np.stack(np.broadcast_arrays(*numbers), axis=1),
            "c": begun["c"],
            "p": begun["p"],
            "q_first": self.plant.part(x, "q"),
            "r_final": self.reference[-1, :n],
            "reduced": self.reduction.begin(),
        }
        for name, given in values.items():
            if name in lanes.blocks:
                lanes.set(name, given)
        if self.wrenches is not None:
            self.loops[-1].begin_rows(lanes, "wrench", self.wrenches)
        if self.scenario.adaptivity is not None:
            begin_adaptive(lanes, self.scenario.adaptivity, state_parts(self.plant), x)
        for name, given in (("y_old", y[:, : 3 * n]), ("u", u), ("u_queued", u)):
            if name in lanes.rings:
                lanes.fill_ring(name, given)
        if self.cycle.untraced is not None:
            told = measurement_of(y[0] if self.scenario.lanes is None else y, n)
            self._states[lanes.first] = self.law.begun(self.arm, told, lanes.first, lanes.count)

    def advance(self, lanes: Lanes, tick: int, last: int, record: np.ndarray | None, every: int) -> None:
        """Takes a group of lanes from tick to tick; behind the last one, what is recorded there."""
        end = last + (last == self.ticks)  # the last row is recorded in a tick that nothing moves in
        more: dict[str, Any] = {
            "last": self.ticks,
            "every": every,
            "seed": self.scenario.seed,
            "tables": {"r": self.reference},
            "records": {} if record is None else {"run": record},
            "schedules": {} if self.wrenches is None else {"wrench": self.wrenches},
        }
        if len(self.loops) == 1 and self.solver is None:
            self.loops[0].run(lanes, self.period, (tick, end), **more)
            return
        for k in range(tick, end):
            self.loops[0].run(lanes, self.period, (k, k + 1), **more)
            if len(self.loops) > 1:
                self._call(lanes, k)
                self.loops[1].run(lanes, self.period, (k, k + 1), **more)
            if self.solver is not None and k < self.ticks:
                self.solver.tick(lanes, k, self.period)

    def _call(self, lanes: Lanes, k: int) -> None:
        """Asks a controller that runs in Python."""
        n, one = self.arm.n, self.scenario.lanes is None
        rows = [np.broadcast_to(self.reference[k], (lanes.count, 3 * n)), lanes.get("y")]
        r, y = (values[0] if one else values for values in rows)
        u, self._states[lanes.first] = self.law.called(
            self.t[k], reference_of(r, n), measurement_of(y, n), self._states[lanes.first], lanes.first, lanes.count
        )
        lanes.set("u_asked", _commands(u, (n,) if one else (lanes.count, n)))


def compile_controlled(scenario: Scenario) -> ControlledRun:
    """A controlled scenario, compiled: to be run as often as one likes.

    Raises:
        ScenarioError: a joint without inertia, or a step too large for the arm's fastest time constant.
    """
    arm, name = scenario.arm, scenario.integrator
    check_inertia(arm, scenario.initial_state[0, : arm.n])
    if name in INTEGRATORS:
        Stability(arm).check_step(name, INTEGRATORS[name], scenario.integration_step, np.zeros((1, arm.n)))
    return ControlledRun(
        scenario, () if scenario.record == "none" else RECORDED if scenario.record == "all" else ("x",)
    )


def simulate_controlled(run: ControlledRun, progress: Progress | None, threads: int | None) -> xarray.Dataset:
    """The motion of the arm under its controller; see `simulate`."""
    scenario = run.scenario
    every = scenario.record_every or scenario.ticks
    width = run.target.doubled().width
    record = _record(run, every, width) if run.recorded else None
    account = Account.of(run.count, len(scenario.events))
    reduced = np.zeros((run.count, run.reduction.size if run.reduction.reducers else 0))

    def begin(first: int, count: int) -> Work:
        lanes = Lanes(count, width, first)
        run.begin(lanes)
        own = None if record is None else record[:, first : first + lanes.tiles * width]

        def end() -> None:
            account.read(lanes)
            if run.reduction.reducers:
                reduced[first : first + count] = lanes.get("reduced")

        return lambda tick, last: run.advance(lanes, tick, last, own, every), end

    in_python = run.cycle.untraced is not None or run.solver is not None
    workers = 1 if in_python else threads or os.cpu_count() or 1
    reached = run_groups(run.count, width, run.ticks, begin, progress, workers)
    if scenario.lanes is None:
        account.check(run.arm.name, run.period)
    found = controlled_dataset(run, record, every, account, reduced, reached)
    return handed_out(found, reached, run.ticks, run.count)


def _record(run: ControlledRun, every: int, width: int) -> np.ndarray:
    """Room for what is recorded (rows, lanes in whole tiles, entries)."""
    shape = (run.ticks // every + 1, -(-run.count // width) * width, sum(run.recorded.values()))
    try:
        return np.empty(shape)
    except (MemoryError, ValueError):
        raise ScenarioError(
            f"the run would record {shape[0]} rows of {run.count} lanes, {8e-9 * np.prod(shape, dtype=float):.3g} GB, more than "
            f"there is memory for; expected a shorter one, or record_every above {run.scenario.record_every}"
        ) from None


def _commands(u: Any, shape: tuple[int, ...]) -> np.ndarray:
    """What a controller that runs in Python commands.

    Raises:
        ScenarioError: a wrong shape, or no numbers.
    """
    try:
        commands = np.asarray(u, dtype=float)
    except (TypeError, ValueError):
        commands = np.full(0, np.nan)
    if commands.shape != shape:
        raise ScenarioError(f"controller: returned u of shape {np.shape(u)}, expected {shape}")
    return commands

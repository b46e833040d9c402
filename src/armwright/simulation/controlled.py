"""A simulated arm under a controller: stages compiled, lanes begun, ticks run, the record read out."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright import scalar
from armwright.actuators import holding_command
from armwright.dynamics import gravity_torques
from armwright.errors import DivergenceError, ScenarioError
from armwright.kernels.batch import Kernel
from armwright.kernels.llvm import select_target
from armwright.kernels.loop import Lanes, Loop
from armwright.kernels.stages import NEVER
from armwright.program import Program, interpret, trace
from armwright.scalar import Array
from armwright.simulation.cycle import UNTRACEABLE, Parts, make_cycle
from armwright.simulation.groups import Progress, Work, run_groups
from armwright.simulation.law import Law, measurement_of, reference_of
from armwright.simulation.plain_plant import Plant
from armwright.simulation.recording import joint_units, make_dataset
from armwright.simulation.references import reference_notes, reference_rows
from armwright.simulation.scenario import Scenario
from armwright.simulation.timing import Delays

if TYPE_CHECKING:
    import xarray

RECORDED = ("x", "y", "r", "u_issued", "u")
FEW = 64  # lanes whose beginnings are interpreted sooner than compiled


class ControlledRun:
    """One controlled scenario: what is compiled for it, and how its lanes begin.

    Attributes:
        t: (ticks + 1,) [s].   reference: (ticks + 1, 3n).   x0, y0, s0, u0: (lanes, …) before the first tick.
        untraced: why the controller is not compiled; None where it is.
    """

    def __init__(self, scenario: Scenario, recorded: tuple[str, ...]):
        assert scenario.law is not None
        self.scenario, self.arm, self.law = scenario, scenario.arm, scenario.law
        self.count, self.period, self.ticks = scenario.lanes or 1, scenario.tick, scenario.ticks
        self.t = np.arange(self.ticks + 1) * self.period
        self.plant = Plant.of(self.arm)
        self.delays = Delays.of(scenario.timing, self.period, self.count)
        self.target = select_target(scenario.target)
        n, start = self.arm.n, scenario.initial_state
        pose = start[0, :n] if scenario.reference is None else scenario.reference
        self.reference = np.ascontiguousarray(reference_rows(self.arm, pose, self.t))
        sizes = {"x": self.plant.size, "y": 4 * n, "r": 3 * n, "u_issued": n, "u": n}
        self.recorded = {name: sizes[name] for name in recorded}
        self.untraced: str | None = None
        self.x0, self.u0, self.y0, self.m0, self.s0 = self._beginnings(start[:, :n], start[:, n:])
        parts = Parts(
            self.arm,
            scenario.varied,
            self.law,
            self.s0.shape[1],
            scenario.sensors,
            scenario.shaping,
            self.delays,
            self.period,
            scenario.substeps,
            scenario.integrator,
            self.recorded,
            self.untraced,
        )
        self.cycle = make_cycle(parts)
        stages = [self.cycle.before, self.cycle.after]
        if self.cycle.untraced is None:
            stages = [(*self.cycle.before, *self.cycle.after)]
        self.loops = [Loop(part, self.target.doubled()) for part in stages]
        self.outputs, self.output_names = self._output_kernel()
        self._states: dict[int, Any] = {}  # of a controller that runs in Python, by the group's first lane

    def _beginnings(self, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, ...]:
        """(lanes, …) the plant's state, the command in force, what is measured, what sensors remember, the controller's state."""
        scenario, n, law = self.scenario, self.arm.n, self.law
        exact = replace(scenario.sensors, position_noise=0.0, velocity_noise=0.0, current_noise=0.0)
        x0 = self.plant.initial(q, qd)
        rows = {"x": x0, "c": law.values, "p": scenario.parameters}
        if scenario.initial_command is not None:
            rows["u"] = self._given_command(scenario.initial_command)

        def begin(x: Array, c: Array, p: Array, *given: Array) -> tuple[Array, ...]:
            arm = scenario.varied.model(p) if scenario.varied is not None else self.arm
            plant = Plant.of(arm)
            u = given[0] if given else holding_command(arm, gravity_torques(arm, plant.part(x, "q")))
            seen, speed, current = plant.measured(x, u, scenario.sensors.side)
            memory = exact.memory(arm, seen, speed)
            seen, speed, current, _ = exact.measure(arm, self.period, seen, speed, current, memory, np.zeros(0))
            y = scalar.array(np.concatenate([seen, speed, current, plant.applied(x, u)]))
            return scalar.array(u), y, scalar.array(memory), law.initial(arm, measurement_of(y, n), c)

        shapes = {name: values.shape[1:] for name, values in rows.items()}
        try:
            program = trace("begin", begin, shapes, ("u_0", "y_0", "m_0", "s_0"))
        except UNTRACEABLE as error:
            # A controller whose `init` cannot be traced has a state of its own kind, which Python keeps.
            self.untraced = f"{type(error).__name__}: {error}"
            law = Law(None, (), (), law.values)
            program = trace("begin", begin, shapes, ("u_0", "y_0", "m_0", "s_0"))
        u0, y0, m0, s0 = self._mapped(program, list(rows.values()))
        return np.broadcast_to(x0, (self.count, x0.shape[1])), u0, y0, m0, s0

    def _mapped(self, program: Program, rows: list[np.ndarray]) -> list[np.ndarray]:
        """A program's outputs for all lanes."""
        if self.count <= FEW:
            results = interpret(program, *(np.broadcast_to(r, (self.count, r.shape[1])) for r in rows))
            return [np.asarray(r) for r in results]
        given = [np.ascontiguousarray(np.broadcast_to(r, (self.count, r.shape[1]))) for r in rows]
        return list(Kernel(program, self.target)(*given))

    def _given_command(self, command: Any) -> np.ndarray:
        values = np.atleast_2d(np.asarray(command, dtype=float))
        if values.shape[1:] != (self.arm.n,) or len(values) not in (1, self.count) or not np.isfinite(values).all():
            shape = np.shape(command)
            raise ScenarioError(
                f"initial_command of shape {shape}: expected ({self.arm.n},) finite numbers, one a joint"
            )
        return values

    def _output_kernel(self) -> tuple[Kernel, tuple[str, ...]]:
        """What follows from state and command, for all recorded rows at once."""
        names: list[str] = []

        def outputs(x: Array, u: Array, *p: Array) -> tuple[Array, ...]:
            arm = self.scenario.varied.model(p[0]) if self.scenario.varied is not None else self.arm
            found = Plant.of(arm).outputs(x, u)
            names[:] = found
            return tuple(found.values())

        shapes = {"x": (self.plant.size,), "u": (self.arm.n,)}
        shapes |= {"p": (len(self.scenario.varied.parameters),)} if self.scenario.varied is not None else {}
        outputs(*(np.zeros(shape) for shape in shapes.values())) if self.scenario.varied is None else outputs(
            np.zeros(self.plant.size), np.zeros(self.arm.n), self.scenario.varied.nominal
        )
        return Kernel(trace("outputs", outputs, shapes, tuple(names)), self.target), tuple(names)

    def begin(self, lanes: Lanes) -> None:
        """Fills the blocks of a group of lanes with what is there before the first tick."""
        for loop in self.loops:
            loop.extend(lanes)
        group, d = slice(lanes.first, lanes.first + lanes.count), self.delays
        numbers = np.stack([d.later, d.jitter, d.drift, d.command_loss, d.measurement_loss], axis=1)
        y, u, n = self.y0[group], self.u0[group], self.arm.n
        values = {
            "x": self.x0[group],
            "x_seen": self.x0[group],
            "see_at": (self.period * (1.0 - d.earlier[group]))[:, None],
            "m_sensors": self.m0[group],
            "y_kept": y[:, : 3 * n],
            "d_measured": d.measured[group][:, None],
            "s": self.s0[group],
            "u": u,
            "u_issued": u,
            "u_base": u,
            "arrivals": np.full((lanes.count, 1), NEVER),
            "d_commanded": d.commanded[group][:, None],
            "d": numbers[group],
            "c": self.law.values[group] if len(self.law.values) > 1 else self.law.values,
            "p": self.scenario.parameters[group] if len(self.scenario.parameters) > 1 else self.scenario.parameters,
        }
        for name, given in values.items():
            if name in lanes.blocks:
                lanes.set(name, given)
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
        }
        if len(self.loops) == 1:
            self.loops[0].run(lanes, self.period, (tick, end), **more)
            return
        n, one = self.arm.n, self.scenario.lanes is None
        for k in range(tick, end):
            self.loops[0].run(lanes, self.period, (k, k + 1), **more)
            rows = [np.broadcast_to(self.reference[k], (lanes.count, 3 * n)), lanes.get("y")]
            r, y = (values[0] if one else values for values in rows)
            u, self._states[lanes.first] = self.law.called(
                self.t[k], reference_of(r, n), measurement_of(y, n), self._states[lanes.first], lanes.first, lanes.count
            )
            lanes.set("u_asked", _commands(u, (n,) if one else (lanes.count, n)))
            self.loops[1].run(lanes, self.period, (k, k + 1), **more)


def simulate_controlled(scenario: Scenario, progress: Progress | None, threads: int | None) -> xarray.Dataset:
    """The motion of the arm under its controller; see `simulate`."""
    recorded = () if scenario.record == "none" else RECORDED if scenario.record == "all" else ("x",)
    run = ControlledRun(scenario, recorded)
    every = scenario.record_every or scenario.ticks
    width = run.target.doubled().width
    record = _record(run, every, width) if recorded else None
    frozen = np.empty(run.count)

    def begin(first: int, count: int) -> Work:
        lanes = Lanes(count, width, first)
        run.begin(lanes)
        own = None if record is None else record[:, first : first + lanes.tiles * width]

        def end() -> None:
            frozen[first : first + count] = lanes.get("frozen")[:, 0]

        return lambda tick, last: run.advance(lanes, tick, last, own, every), end

    workers = 1 if run.cycle.untraced is not None else threads or os.cpu_count() or 1
    run_groups(run.count, width, run.ticks, begin, progress, workers)
    if scenario.lanes is None and frozen[0] >= 0:
        raise DivergenceError(
            f"{run.arm.name}: the simulation left the finite numbers at t = {frozen[0] * run.period:g} s"
        )
    return _dataset(run, record, every, frozen)


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


def _dataset(run: ControlledRun, record: np.ndarray | None, every: int, frozen: np.ndarray) -> xarray.Dataset:
    """What was recorded, with what follows from it."""
    scenario, arm, n = run.scenario, run.arm, run.arm.n
    t = run.t[::every]
    assert record is not None
    rows = record[:, : run.count].transpose(1, 0, 2)
    ends = np.cumsum(list(run.recorded.values()))[:-1]
    parts = dict(zip(run.recorded, np.split(rows, ends, axis=2), strict=True))
    x = parts["x"]
    names, more = run.output_names, {}
    if scenario.record == "all":
        given = [x, parts["u"], *([scenario.parameters[:, None, :]] if scenario.varied is not None else [])]
        more = dict(zip(names, run.outputs(*given, threads=os.cpu_count() or 1), strict=True))
    u = parts.get("u", np.full((run.count, len(t), n), np.nan))
    attrs = {
        "integrator": scenario.integrator,
        "step_s": scenario.integration_step,
        "sample_period_s": run.period,
        "controller": "compiled"
        if run.cycle.untraced is None
        else f"called in Python once a tick: {run.cycle.untraced}",
        "notes": reference_notes(arm, run.reference, run.t),
    }
    q, qd = run.plant.part(x, "q"), run.plant.part(x, "qd")
    squeeze = (lambda v: v[0]) if scenario.lanes is None else (lambda v: v)
    known = {name: squeeze(more.pop(name)) for name in ("qdd", "tau", "voltage", "current") if name in more}
    dataset = make_dataset(arm, t, squeeze(q), squeeze(qd), squeeze(u), **known, attrs=attrs)
    dims = dataset["q"].dims
    extra = dict(more)
    if "y" in parts:
        y = measurement_of(parts["y"], n)
        r = reference_of(parts["r"], n)
        extra |= {
            "q_measured": y.q,
            "qd_measured": y.qd,
            "q_reference": r.q,
            "qd_reference": r.qd,
            "u_issued": parts["u_issued"],
        }
    for name, values in extra.items():
        about = MORE[name]
        dataset[name] = (
            dims,
            squeeze(values),
            {"units": " | ".join(dict.fromkeys(joint_units(arm, about[0]))), "long_name": about[1]},
        )
    if scenario.lanes is not None:
        diverged = np.where(frozen < 0, np.nan, frozen * run.period)
        about = {"units": "s", "long_name": "time at which the lane left the finite numbers"}
        dataset["diverged_at"] = ("lane", diverged, about)
    return dataset


MORE = {  # what else is recorded: whose unit it has, and what it is
    "q_measured": ("q", "measured position"),
    "qd_measured": ("qd", "measured velocity"),
    "q_reference": ("q", "reference position"),
    "qd_reference": ("qd", "reference velocity"),
    "u_issued": ("u", "command as it left the controller"),
}


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

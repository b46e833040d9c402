"""Simulation of an arm with its motors: the compiled loop is set up, run in pieces, and read out as a Dataset."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.actuators.drive import UNITS
from armwright.errors import Interrupted, ScenarioError
from armwright.kernels.batch import Kernel
from armwright.kernels.llvm import select_target
from armwright.kernels.loop import Loop
from armwright.kernels.stages import Integrate, Record, Rows, Stage
from armwright.model import Model
from armwright.model.simplify import simplified
from armwright.model.vary import Varied
from armwright.program import Program, trace
from armwright.scalar import Array
from armwright.simulation.controlled import compile_controlled, simulate_controlled
from armwright.simulation.controlled_dataset import USUAL, add_output
from armwright.simulation.cvodes import Cvodes, check_lanes
from armwright.simulation.groups import Progress, Reached, handed_out, run_groups
from armwright.simulation.integrators import INTEGRATORS
from armwright.simulation.landing import landing_rows, landing_times
from armwright.simulation.plant import Plant
from armwright.simulation.provenance import provenance
from armwright.simulation.recording import make_dataset
from armwright.simulation.scenario import Scenario
from armwright.simulation.stability import Stability, check_inertia
from armwright.simulation.stepping import Account, Adaptivity, adaptive_stage, begin_adaptive, speed_pairs, state_parts

if TYPE_CHECKING:
    import xarray

ROUNDING = 1e-9  # of the largest command of a run: less is no clipping


@dataclass(frozen=True, eq=False)
class Simulator:
    """A compiled arm, ready for any scenario with the same arm, integrator and target."""

    arm: Model
    integrator: str
    target: str | None
    adaptivity: Adaptivity | None
    loop: Loop
    outputs: Kernel
    stability: Stability
    varied: Varied | None = None

    @property
    def step(self) -> Program:
        """One step of the plant:  (x, u, h) → x_next; with "rk45" there is none."""
        return next(stage.step for stage in self.loop.stages if isinstance(stage, Integrate))


def compile_simulator(
    arm: Model,
    integrator: str = "rk3",
    target: str | None = None,
    adaptivity: Adaptivity | None = None,
    varied: Varied | None = None,
) -> Simulator:
    """The loop and the outputs of an arm as native code.

    Args:
        arm: the model.   integrator: a name of `integrators.RULES`.   target: processor level, as in `compile`.
        adaptivity: how "rk45" chooses its steps, as `Scenario.adaptivity` says.
        varied: the same arm with parameters left open, which are then a block "p" of the loop.
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    n, chosen, plant = arm.n, select_target(target), Plant.of(simplified(arm))

    def of(*p: Array) -> Plant:
        return Plant.of(simplified(varied.model(p[0]))) if varied is not None else plant

    shapes = {"x": (plant.size,), "u": (n,)} | ({} if varied is None else {"p": (len(varied.parameters),)})
    stages: list[Stage] = [Rows("u", n), Record("states", ("x",), (plant.size,))]
    if integrator in INTEGRATORS:
        rule = INTEGRATORS[integrator].paired(speed_pairs({part.name: part.place for part in plant.parts}))
        step = trace("step", lambda x, u, *r: of(*r[:-1]).step(rule, x, u, r[-1]), shapes | {"h": ()}, ("x_next",))
        stages.append(Integrate(step))
    elif integrator == "rk45":
        assert adaptivity is not None
        derivative = lambda x, u, *p: of(*p).derivative(x, u)  # noqa: E731
        stages.append(adaptive_stage(derivative, shapes, adaptivity, state_parts(plant)))
    names = tuple(_told_outputs(plant, plant.initial(np.zeros(n), np.zeros(n)), np.zeros(n)))
    outputs = trace("outputs", lambda x, u, *p: tuple(_told_outputs(of(*p), x, u).values()), shapes, names)
    loop = Loop(tuple(stages), chosen.doubled())
    return Simulator(arm, integrator, target, adaptivity, loop, Kernel(outputs, chosen), Stability(arm), varied)


def _told_outputs(plant: Plant, x: Array, u: Array) -> dict[str, Array]:
    """What is recorded beside the state: of an arm with motors and friction alone the usual, else all that is known."""
    found = plant.outputs(x, u)
    return {name: values for name, values in found.items() if name in USUAL or not plant.is_plain}


def simulate(
    scenario: Scenario,
    *,
    progress: Progress | None = None,
    threads: int | None = None,
    simulator: Simulator | None = None,
) -> xarray.Dataset:
    """The motion of the arm under the scenario's commands.

    Drive limits clip and are reported in the result's attributes. A lane whose state leaves the finite numbers is
    frozen and marked with the time it happened; the others go on. A single run that does so raises.

    Args:
        scenario: what to run.
        progress: called now and then with the steps done and the steps there are, over all lanes.
        threads: how many share the lanes, by default all cores; the result does not depend on it.
        simulator: a compiled arm to use again; by default one is compiled.
    Returns:
        run: time, q, qd, qdd, tau, u and, where the record has the constants, voltage and current; units in attributes.
    Raises:
        ScenarioError: a step too large for the arm's fastest time constant; names the step that would do.
        DivergenceError: a single run left the finite numbers.
        Interrupted: Ctrl-C, a KeyboardInterrupt whose `run` holds the lanes that were finished.
    """
    try:
        if scenario.controller is not None:
            run = simulate_controlled(compile_controlled(scenario), progress, threads)
        else:
            run = _simulate_driven(scenario, progress, threads, simulator)
    except Interrupted as stop:
        _remember(stop.run, scenario)
        raise
    _remember(run, scenario)
    return run


def _remember(run: xarray.Dataset, scenario: Scenario) -> None:
    """Lets a run know how it was made."""
    run.attrs |= {"seed": scenario.seed, "made_with": json.dumps(provenance(scenario.target))}
    if scenario.document is not None:
        run.attrs["scenario"] = scenario.document


def _simulate_driven(
    scenario: Scenario, progress: Progress | None, threads: int | None, simulator: Simulator | None
) -> xarray.Dataset:
    """A run under commands over time."""
    arm = scenario.arm
    check_inertia(arm, scenario.initial_state[0, : arm.n])
    simulator = simulator or compile_simulator(
        arm, scenario.integrator, scenario.target, scenario.adaptivity, scenario.varied
    )
    x0 = scenario.initial_state
    _check_simulator(simulator, scenario)
    if scenario.integrator in INTEGRATORS:
        rule = INTEGRATORS[scenario.integrator]
        commands = np.concatenate([schedule.commands for schedule in scenario.schedules])
        simulator.stability.check_step(scenario.integrator, rule, scenario.tick, commands)
    every = scenario.record_every or scenario.ticks
    plant = Plant.of(arm)
    record = _record(scenario, simulator.loop.target.width, plant.size)
    account = Account.of(len(x0), len(scenario.events))
    if scenario.integrator == "cvodes":
        _solve(scenario, record, every, progress, account)
        reached = Reached(np.arange(len(x0)), scenario.ticks, False)
    else:
        reached = _run(simulator.loop, scenario, record, every, progress, threads or os.cpu_count() or 1, account)
    if scenario.lanes is None:
        account.check(arm.name, scenario.tick, f"last state q = {_told(record[-1, 0, : arm.n])}")
    states = record[reached.rows(every, len(record)), : len(x0)].transpose(1, 0, 2)
    run = _dataset(scenario, simulator, states[reached.lanes] if reached.stopped else states, every, account, reached)
    return handed_out(run, reached, scenario.ticks, len(x0))


def _told(q: np.ndarray) -> str:
    return np.array2string(q, precision=4, max_line_width=10**6)


def _record(scenario: Scenario, width: int, entries: int) -> np.ndarray:
    """Room for the recorded states (rows, lanes in whole tiles, entries)."""
    lanes = scenario.lanes or 1
    every = scenario.record_every or scenario.ticks
    rows, padded = scenario.ticks // every + 1, -(-lanes // width) * width
    try:
        return np.empty((rows, padded, entries))
    except (MemoryError, ValueError):
        size = 8e-9 * rows * padded * entries
        raise ScenarioError(
            f"the run would record {rows} rows of {lanes} lanes, {size:.3g} GB, more than there is memory for; "
            f"expected a shorter one, or record_every above {scenario.record_every}"
        ) from None


def _run(
    loop: Loop,
    scenario: Scenario,
    record: np.ndarray,
    every: int,
    progress: Progress | None,
    workers: int,
    account: Account,
) -> Reached:
    """Records the states of all lanes."""
    n, plant = scenario.arm.n, Plant.of(scenario.arm)
    x0 = plant.initial(scenario.initial_state[:, :n], scenario.initial_state[:, n:])
    values = scenario.parameters
    ticks, schedules = scenario.ticks, landing_rows(scenario.schedules, scenario.tick)

    def begin(first: int, count: int) -> Any:
        lanes = loop.lanes(count, first)
        lanes.set("x", x0[first : first + count] if len(x0) > 1 else x0)
        if scenario.varied is not None:
            lanes.set("p", values[first : first + count] if len(values) > 1 else values)
        if scenario.adaptivity is not None:
            begin_adaptive(lanes, scenario.adaptivity, state_parts(plant), x0[first : first + count])
        loop.begin_rows(lanes, "u", schedules)
        own = record[:, first : first + lanes.tiles * lanes.width]

        def advance(tick: int, last: int) -> None:
            loop.run(
                lanes,
                scenario.tick,
                (tick, last + (last == ticks)),  # the last row is recorded in a tick that nothing moves in
                last=ticks,
                every=every,
                schedules={"u": schedules},
                records={"states": own},
            )

        return advance, lambda: account.read(lanes)

    return run_groups(len(x0), loop.target.width, ticks, begin, progress, workers)


def _solve(scenario: Scenario, record: np.ndarray, every: int, progress: Progress | None, account: Account) -> None:
    """Records the states of all lanes as CVODES finds them, lane by lane."""
    arm, ticks, h, n = scenario.arm, scenario.ticks, scenario.tick, scenario.arm.n
    plant = Plant.of(simplified(arm))
    x0 = plant.initial(scenario.initial_state[:, :n], scenario.initial_state[:, n:])
    check_lanes(len(x0))
    if scenario.varied is not None:
        raise ScenarioError(
            'integrator = "cvodes" varies no parameters without a controller; expected "rk45", or a fixed step'
        )
    assert scenario.adaptivity is not None
    shapes = {"x": (plant.size,), "u": (n,)}
    solver = Cvodes(plant.derivative, shapes, scenario.adaptivity, stiff=bool(plant.stiff))
    for lane, x in enumerate(x0):
        schedule = scenario.schedules[lane % len(scenario.schedules)]
        record[:, lane], reached = x, 0
        for reached, states in solver.held(x, *landing_times(schedule.times, h), schedule.commands, ticks, h):
            for k, state in enumerate(states, reached - len(states) + 1):
                if k % every == 0:
                    record[k // every :, lane] = state
        if reached < ticks:
            account.frozen[lane] = reached
        if progress is not None:
            progress((lane + 1) * ticks, len(x0) * ticks)


def _check_simulator(simulator: Simulator, scenario: Scenario) -> None:
    """Refuses a simulator that was compiled for something else.

    Raises:
        ScenarioError: names what differs.
    """
    for what in ("arm", "integrator", "target", "adaptivity"):
        compiled, asked = getattr(simulator, what), getattr(scenario, what)
        if compiled is not asked and compiled != asked and asked is not None:
            raise ScenarioError(
                f"the simulator was compiled for {what} = {compiled}, not for the scenario's {asked}; "
                "expected compile_simulator of the scenario's own"
            )
    compiled, asked = (each.varied.names if each.varied is not None else () for each in (simulator, scenario))
    if compiled != asked:
        raise ScenarioError(
            f"the simulator was compiled for varying {list(compiled)}, not for the scenario's {list(asked)}; "
            "expected compile_simulator of the scenario's own"
        )


def _dataset(
    scenario: Scenario, simulator: Simulator, states: np.ndarray, every: int, account: Account, reached: Reached
) -> xarray.Dataset:
    """States (lanes, rows, 2n) with what follows from them, of the lanes that came to the end."""
    arm, n = scenario.arm, scenario.arm.n
    k = np.arange(states.shape[1]) * every
    t = k * scenario.tick
    if all(len(schedule.times) == 1 for schedule in scenario.schedules):  # constant commands: one row serves all times
        u = np.stack([schedule.commands for schedule in scenario.schedules])
    else:
        u = np.stack([_held(schedule, k, scenario.tick) for schedule in scenario.schedules])
    u = np.broadcast_to(u if len(u) == 1 else u[reached.lanes], (len(states), len(k), n))
    parts: dict[str, Any] = {}
    if scenario.record == "all":
        names = (port.name for port in simulator.outputs.program.outputs)
        values = scenario.parameters if len(scenario.parameters) == 1 else scenario.parameters[reached.lanes]
        given = [states, u, *([values[:, None, :]] if scenario.varied is not None else [])]
        parts = dict(zip(names, simulator.outputs(*given, threads=os.cpu_count() or 1), strict=True))
    plant = Plant.of(arm)
    q, qd = plant.part(states, "q"), plant.part(states, "qd")
    attrs = {
        "integrator": scenario.integrator,
        "step_s": scenario.tick,
        "notes": _notes(arm, q, qd, u, parts, t),
    }
    if scenario.lanes is None:
        q, qd, u = q[0], qd[0], u[0]
        parts = {name: value[0] for name, value in parts.items()}
    run = make_dataset(arm, t, q, qd, u, **{name: v for name, v in parts.items() if name in USUAL}, attrs=attrs)
    for name in parts:
        if name not in USUAL:
            add_output(run, arm, name, parts[name])
    if scenario.lanes is not None and reached.stopped:
        run = run.assign_coords(lane=("lane", reached.lanes, run["lane"].attrs))
    account.of_lanes(reached.lanes).tell(run, scenario.tick, scenario.adaptivity, scenario.lanes is None)
    return run


def _held(schedule: Any, ticks: np.ndarray, step: float) -> np.ndarray:
    """The schedule's commands just after those ticks."""
    row_tick, row_offset = landing_times(schedule.times, step)
    started = np.where(row_offset > 0, row_tick + 1, row_tick)
    return schedule.commands[np.searchsorted(started, ticks, side="right") - 1]


def _notes(arm: Model, q: np.ndarray, qd: np.ndarray, u: np.ndarray, parts: dict[str, Any], t: np.ndarray) -> list[str]:
    """What a user should know about the run: limits that clipped, and limits that were passed."""
    notes = []
    for j, body in enumerate(arm.coordinates):
        command = body.drive.command
        if parts:
            asked = u[..., j]
            applied = parts["tau" if command == "torque" else command][..., j]
            clipped = np.abs(applied - asked) > ROUNDING * max(np.abs(asked).max(), np.abs(applied).max())
            if clipped.any():
                unit = "N" if command == "torque" and body.kind == "prismatic" else UNITS[command]
                notes.append(
                    f"{body.joint}: the drive's limits clipped its {command} in {clipped.mean():.0%} of the rows, "
                    f"first at t = {_first(t, clipped):g} s (asked for up to {np.abs(asked[clipped]).max():.4g} {unit})"
                )
        low, high = body.limits.position
        outside = (q[..., j] < low) | (q[..., j] > high)
        if outside.any():
            notes.append(
                f"{body.joint}: passed its position limits [{low:.4g}, {high:.4g}] at t = {_first(t, outside):g} s; "
                "nothing stops it there"
            )
        fast = np.abs(qd[..., j]) > body.limits.velocity
        if fast.any():
            notes.append(
                f"{body.joint}: passed its velocity limit {body.limits.velocity:.4g} at t = {_first(t, fast):g} s"
            )
    return notes


def _first(t: np.ndarray, happened: np.ndarray) -> float:
    """The first time at which something happened in any lane."""
    return float(t[np.nonzero(happened.any(axis=0))[0][0]])

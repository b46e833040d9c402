"""Simulation of an arm with its motors: the compiled loop is set up, run in pieces, and read out as a Dataset."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.actuators.drive import UNITS
from armwright.dynamics import mass_matrix
from armwright.errors import ScenarioError
from armwright.kernels.batch import Kernel
from armwright.kernels.llvm import select_target
from armwright.kernels.loop import Loop, Schedules
from armwright.kernels.stages import Integrate, Record, Rows, Stage
from armwright.model import Model
from armwright.model.simplify import simplified
from armwright.program import call, trace
from armwright.scalar import Array
from armwright.simulation.controlled import simulate_controlled
from armwright.simulation.cvodes import Cvodes, check_lanes
from armwright.simulation.events import Parts
from armwright.simulation.groups import Progress, run_groups
from armwright.simulation.integrators import INTEGRATORS
from armwright.simulation.plant import plant_derivative, plant_outputs
from armwright.simulation.provenance import provenance
from armwright.simulation.recording import make_dataset
from armwright.simulation.scenario import LANDING, Scenario
from armwright.simulation.stability import Stability
from armwright.simulation.stepping import Account, Adaptivity, adaptive_stage, begin_adaptive

if TYPE_CHECKING:
    import xarray

ROUNDING = 1e-9  # of the largest command of a run: less is no clipping
SINGULAR = 1e-13  # of the largest eigenvalue of the mass matrix


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


def compile_simulator(
    arm: Model, integrator: str = "rk3", target: str | None = None, adaptivity: Adaptivity | None = None
) -> Simulator:
    """The loop and the outputs of an arm as native code.

    Args:
        arm: the model.   integrator: a name of `integrators.RULES`.   target: processor level, as in `compile`.
        adaptivity: how "rk45" chooses its steps, as `Scenario.adaptivity` says.
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    n, chosen, plain = arm.n, select_target(target), simplified(arm)
    state, command = {"x": (2 * n,)}, {"u": (n,)}

    def derivative(x: Array, u: Array) -> np.ndarray:
        return plant_derivative(plain, x, u)

    stages: list[Stage] = [Rows("u", n), Record("states", ("x",), (2 * n,))]
    if integrator in INTEGRATORS:
        plant = trace("plant", derivative, state | command, ("xd",), noinline=True)
        rule = INTEGRATORS[integrator].step
        shapes = state | command | {"h": ()}
        stages.append(
            Integrate(trace("step", lambda x, u, h: rule(lambda x, u: call(plant, x, u), x, u, h), shapes, ("x_next",)))
        )
    elif integrator == "rk45":
        assert adaptivity is not None
        stages.append(adaptive_stage(derivative, state | command, adaptivity, _parts(n)))
    names = ("qdd", "tau", "voltage", "current")
    outputs = trace("outputs", lambda x, u: plant_outputs(plain, x, u), state | command, names)
    loop = Loop(tuple(stages), chosen.doubled())
    return Simulator(arm, integrator, target, adaptivity, loop, Kernel(outputs, chosen), Stability(arm))


def _parts(n: int) -> Parts:
    """The state's parts by name."""
    return lambda x: {"q": x[:n], "qd": x[n:]}


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
    """
    if scenario.controller is not None:
        run = simulate_controlled(scenario, progress, threads)
    else:
        run = _simulate_driven(scenario, progress, threads, simulator)
    run.attrs |= {"seed": scenario.seed, "made_with": json.dumps(provenance(scenario.target))}
    if scenario.document is not None:
        run.attrs["scenario"] = scenario.document
    return run


def _simulate_driven(
    scenario: Scenario, progress: Progress | None, threads: int | None, simulator: Simulator | None
) -> xarray.Dataset:
    """A run under commands over time."""
    arm = scenario.arm
    _check_inertia(arm, scenario.initial_state[0, : arm.n])
    simulator = simulator or compile_simulator(arm, scenario.integrator, scenario.target, scenario.adaptivity)
    x0 = scenario.initial_state
    _check_simulator(simulator, scenario)
    if scenario.integrator in INTEGRATORS:
        rule = INTEGRATORS[scenario.integrator]
        commands = np.concatenate([schedule.commands for schedule in scenario.schedules])
        simulator.stability.check_step(scenario.integrator, rule, scenario.tick, commands)
    every = scenario.record_every or scenario.ticks
    record = _record(scenario, simulator.loop.target.width)
    account = Account.of(len(x0), len(scenario.events))
    if scenario.integrator == "cvodes":
        _solve(scenario, record, every, progress, account)
    else:
        _run(simulator.loop, scenario, record, every, progress, threads or os.cpu_count() or 1, account)
    if scenario.lanes is None:
        account.check(arm.name, scenario.tick, f"last state q = {_told(record[-1, 0, : arm.n])}")
    return _dataset(scenario, simulator, record[:, : len(x0)].transpose(1, 0, 2), every, account)


def _told(q: np.ndarray) -> str:
    return np.array2string(q, precision=4, max_line_width=10**6)


def _schedules(scenario: Scenario) -> Schedules:
    """Rows of all schedules; lanes of constant commands, or of one clock, share their times."""
    seen: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    for schedule in scenario.schedules:
        if schedule.times.tobytes() not in seen:
            seen[schedule.times.tobytes()] = _rows(schedule.times, scenario.tick)
    rows = [seen[schedule.times.tobytes()] for schedule in scenario.schedules]
    starts = np.cumsum([0, *(len(tick) for tick, _ in rows)])
    tick, offset = (np.concatenate([row[k] for row in rows]) for k in (0, 1))
    values = np.ascontiguousarray(np.concatenate([schedule.commands for schedule in scenario.schedules]))
    return Schedules(tick, offset, values, starts[:-1], starts[1:])


def _record(scenario: Scenario, width: int) -> np.ndarray:
    """Room for the recorded states (rows, lanes in whole tiles, 2n)."""
    lanes = scenario.lanes or 1
    every = scenario.record_every or scenario.ticks
    rows, padded = scenario.ticks // every + 1, -(-lanes // width) * width
    try:
        return np.empty((rows, padded, 2 * scenario.arm.n))
    except (MemoryError, ValueError):
        size = 8e-9 * rows * padded * 2 * scenario.arm.n
        raise ScenarioError(
            f"the run would record {rows} rows of {lanes} lanes, {size:.3g} GB, more than there is memory for; "
            f"expected a shorter one, or record_every above {scenario.record_every}"
        ) from None


def _rows(times: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Ticks and offsets [s] behind them at which a schedule's rows come; a row next to a tick is put on it."""
    ticks = np.rint(times / step)
    on = np.abs(times - ticks * step) <= LANDING * step
    ticks = np.where(on, ticks, np.floor(times / step))
    return ticks, np.where(on, 0.0, times - ticks * step)


def _run(
    loop: Loop,
    scenario: Scenario,
    record: np.ndarray,
    every: int,
    progress: Progress | None,
    workers: int,
    account: Account,
) -> None:
    """Records the states of all lanes."""
    x0, ticks, schedules = scenario.initial_state, scenario.ticks, _schedules(scenario)

    def begin(first: int, count: int) -> Any:
        lanes = loop.lanes(count, first)
        lanes.set("x", x0[first : first + count])
        if scenario.adaptivity is not None:
            begin_adaptive(lanes, scenario.adaptivity, _parts(scenario.arm.n), x0[first : first + count])
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

    run_groups(len(x0), loop.target.width, ticks, begin, progress, workers)


def _solve(scenario: Scenario, record: np.ndarray, every: int, progress: Progress | None, account: Account) -> None:
    """Records the states of all lanes as CVODES finds them, lane by lane."""
    arm, ticks, h, x0 = scenario.arm, scenario.ticks, scenario.tick, scenario.initial_state
    check_lanes(len(x0))
    assert scenario.adaptivity is not None
    plain = simplified(arm)
    shapes = {"x": (2 * arm.n,), "u": (arm.n,)}
    solver = Cvodes(lambda x, u: plant_derivative(plain, x, u), shapes, scenario.adaptivity, stiff=False)
    for lane, x in enumerate(x0):
        schedule = scenario.schedules[lane % len(scenario.schedules)]
        record[:, lane], reached = x, 0
        for reached, states in solver.held(x, *_rows(schedule.times, h), schedule.commands, ticks, h):
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


def _check_inertia(arm: Model, q: np.ndarray) -> None:
    """Refuses an arm with a joint that nothing gives inertia to.

    Raises:
        ScenarioError: names the joint.
    """
    values, vectors = np.linalg.eigh(mass_matrix(arm, q).astype(float))
    if values[0] <= SINGULAR * values[-1]:
        joint = arm.names[int(np.abs(vectors[:, 0]).argmax())]
        raise ScenarioError(
            f"{arm.name}: the mass matrix is singular at the initial position: joint {joint!r} moves no inertia "
            "(a massless link without a rotor?); expected mass or rotor_inertia_kg_m2 behind every joint"
        )


def _dataset(
    scenario: Scenario, simulator: Simulator, states: np.ndarray, every: int, account: Account
) -> xarray.Dataset:
    """States (lanes, rows, 2n) with what follows from them."""
    arm, n = scenario.arm, scenario.arm.n
    k = np.arange(states.shape[1]) * every
    t = k * scenario.tick
    if all(len(schedule.times) == 1 for schedule in scenario.schedules):  # constant commands: one row serves all times
        u = np.stack([schedule.commands for schedule in scenario.schedules])
        u = np.broadcast_to(u, (len(states), len(k), n))
    else:
        u = np.stack([_held(schedule, k, scenario.tick) for schedule in scenario.schedules])
        u = np.broadcast_to(u, (len(states), *u.shape[1:]))
    parts: dict[str, Any] = {}
    if scenario.record == "all":
        names = (port.name for port in simulator.outputs.program.outputs)
        parts = dict(zip(names, simulator.outputs(states, u, threads=os.cpu_count() or 1), strict=True))
    q, qd = states[..., :n], states[..., n:]
    attrs = {
        "integrator": scenario.integrator,
        "step_s": scenario.tick,
        "notes": _notes(arm, q, qd, u, parts, t),
    }
    if scenario.lanes is None:
        q, qd, u = q[0], qd[0], u[0]
        parts = {name: value[0] for name, value in parts.items()}
    run = make_dataset(arm, t, q, qd, u, **parts, attrs=attrs)
    account.tell(run, scenario.tick, scenario.adaptivity, scenario.lanes is None)
    return run


def _held(schedule: Any, ticks: np.ndarray, step: float) -> np.ndarray:
    """The schedule's commands just after those ticks."""
    row_tick, row_offset = _rows(schedule.times, step)
    started = np.where(row_offset > 0, row_tick + 1, row_tick)
    return schedule.commands[np.searchsorted(started, ticks, side="right") - 1]


def _notes(arm: Model, q: np.ndarray, qd: np.ndarray, u: np.ndarray, parts: dict[str, Any], t: np.ndarray) -> list[str]:
    """What a user should know about the run: limits that clipped, and limits that were passed."""
    notes = []
    for j, body in enumerate(arm.bodies):
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

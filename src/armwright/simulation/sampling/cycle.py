"""One tick as stages of a compiled loop: measure, reference, control, shape, delay, drive. Design section 4.

Without a controller, commands come from a schedule, and of these stages the last one is left.

Blocks between the stages, one lane's numbers each:

    x, x_seen          the plant's state, now and when it was last sampled
    y_new, y_old, y    q, q̇ and current as measured, as they come out of the queue, and what the controller is told
    r                  the reference: q, q̇, q̈
    s                  the controller's state
    u_asked, u_kept, u_issued    what it commands, what of that is within rate and limit, and what leaves, rounded
    u_queued, u        what comes out of the queue, and what is in force at the drives
    wrench, brake, payload    on the tip, which are applied, and in the hands, in force
    p, c               parameters of the robot and of the controller that vary by lane;   d: delays
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.kernels.stages import NEXT, Call, Delay, Draw, Integrate, Record, Rows, Stage, Table
from armwright.program import Program, trace
from armwright.scalar import Array
from armwright.simulation.integration.integrators import INTEGRATORS
from armwright.simulation.integration.stepping import adaptive_stage, speed_pairs, state_parts
from armwright.simulation.plant.switching import Watched, switching_programs
from armwright.simulation.results.reducers import Reduction
from armwright.simulation.sampling.commanding import commanding
from armwright.simulation.sampling.law import traced_law
from armwright.simulation.sampling.protocols import UNTRACEABLE, why
from armwright.simulation.sampling.tick_parts import Parts, Sampling

SENSING, TIMING = 0, 1  # channels of random numbers
NOTHING: Mapping[str, tuple[int, ...]] = {}


@dataclass(frozen=True, eq=False)
class Cycle:
    """The stages of a tick.

    Attributes:
        before, after: stages up to the controller and behind it: one after another where it is compiled, and otherwise with the
            controller's Python between them.
        untraced: why the controller could not be compiled; None where it is.   seen: whether the plant is sampled between ticks.
    """

    before: tuple[Stage, ...]
    after: tuple[Stage, ...]
    untraced: str | None
    seen: bool


def make_cycle(parts: Parts) -> Cycle:
    """The stages of a tick."""
    sampling = parts.sampling
    if sampling is None:
        before: list[Stage] = [Rows("u", parts.arm.n)]
        after: list[Stage]
        after, seen, untraced = [], False, None
        if parts.reduction is not None:
            before.append(_followed(parts))
    else:
        before, seen = _measuring(parts, sampling)
        after = commanding(parts.arm.n, sampling.period, sampling.shaping, sampling.delays)
        untraced = sampling.untraced
        try:
            if untraced is None:
                before.append(Call(traced_law(sampling.law, parts.arm, sampling.period, sampling.states)))
        except UNTRACEABLE as error:
            if isinstance(error, ScenarioError):  # it can be traced, and is wrong
                raise
            untraced = why(error)
    after += [Rows(name, entries) for name, entries in parts.inputs.items()]
    after += [Record("run", *zip(*parts.recorded.items(), strict=True))] if parts.recorded else []
    after += [Call(_reducing(parts, parts.reduction))] if parts.reduction is not None else []
    return Cycle(tuple(before), (*after, *_integration(parts, seen)), untraced, seen)


def _followed(parts: Parts) -> Stage:
    """The reference: one for all lanes, or a lane's own."""
    return Rows("r", 3 * parts.arm.n) if parts.apart else Table("r", 3 * parts.arm.n)


def _reducing(parts: Parts, reduction: Reduction) -> Program:
    """What follows the rows with reducers, those that would be recorded."""
    return reduction.program(parts.plant, parts.bare.size, parts.more)


def _integration(parts: Parts, seen: bool) -> list[Stage]:
    """The stage that moves the plant; none where CVODES does."""
    delays = None if parts.sampling is None else parts.sampling.delays
    planned = delays.pending + 2 if delays is not None and delays.fractional else 0
    watched = plant_watched(parts)
    derivative, shapes = plant_derivative(parts)
    if parts.integrator in INTEGRATORS:
        step = plant_step(parts, {} if watched is None else watched.block)
        return [Integrate(step, parts.substeps, planned, seen, **switching_programs(watched, shapes))]
    if parts.integrator == "cvodes":
        return []
    assert parts.adaptivity is not None
    told = state_parts(parts.bare)
    return [adaptive_stage(derivative, shapes, parts.adaptivity, told, planned, seen, watched)]


def plant_derivative(parts: Parts) -> tuple[Callable[..., Array], dict[str, tuple[int, ...]]]:
    """dx/dt of the arm with the lane's inputs and parameters, and the shapes of its arguments by name.

    Behind them it takes which contacts count as made, where that is not to follow from x.
    """

    def derivative(x: Array, u: Array, *rest: Array) -> Array:
        told = dict(zip([*parts.more, "touching"], rest, strict=False))
        plant = parts.plant(told, simple=True)
        return plant.derivative(x, u, told.get("wrench"), told.get("brake"), told.get("touching"))

    return derivative, {"x": (parts.bare.size,), "u": (parts.arm.n,)} | parts.more


def plant_step(parts: Parts, contacts: Mapping[str, tuple[int, ...]] = NOTHING) -> Program:
    """The plant's step, with its inputs and the arm's varied parameters behind x and u, then its contacts, if these are held."""
    rule = INTEGRATORS[parts.integrator].paired(speed_pairs({part.name: part.place for part in parts.bare.parts}))
    _, shapes = plant_derivative(parts)

    def step(x: Array, u: Array, *rest: Array) -> Array:
        *given, h = rest
        told = dict(zip([*parts.more, *contacts], given, strict=True))
        plant = parts.plant(told, simple=True)
        return plant.step(rule, x, u, h, told.get("wrench"), told.get("brake"), told.get("touching"))

    return trace("step", step, {**shapes, **contacts, "h": ()}, (f"x{NEXT}",))


def plant_watched(parts: Parts) -> Watched | None:
    """What switches within steps; None of an arm that has no stops and no play."""

    def depths(x: Array, u: Array, *rest: Array) -> Array:
        return parts.plant(dict(zip(parts.more, rest, strict=True)), simple=True).depths(x)

    def corners(x: Array, u: Array, *rest: Array) -> tuple[Array, Array]:
        told = dict(zip([*parts.more, "touching"], rest, strict=True))
        return parts.plant(told, simple=True).corners(x, u, told.get("brake"), told["touching"])

    contacts = sum(parts.bare.contacts)
    return Watched(depths, corners, contacts) if contacts else None


def _measuring(parts: Parts, sampling: Sampling) -> tuple[list[Stage], bool]:
    """Stages from the plant's state to what the controller is told, and whether the plant is sampled between ticks."""
    n, delays, sensors = parts.arm.n, sampling.delays, sampling.sensors
    plant, draws = parts.bare, sensors.draws(parts.arm.n)
    varying = {name: shape for name, shape in parts.more.items() if name == "p"}
    remembered = sensors.memory(parts.arm, np.zeros(n), np.zeros(n)).size
    seen, late, lossy = (
        bool(np.any(delays.earlier)),
        bool(np.any(delays.measured)),
        bool(np.any(delays.measurement_loss)),
    )
    state = "x_seen" if seen else "x"
    queue = "y_new" if late or lossy else "y_now"
    stages: list[Stage] = [Draw("w_sensors", draws, SENSING)] if draws else []

    def sense(x: Array, u: Array, memory: Array, *rest: Array) -> tuple[Array, Array]:
        *p, w = rest if draws else (*rest, np.zeros(0))
        own = parts.plant(dict(zip(varying, p, strict=True)))
        q, qd, current = own.measured(x, u, sensors.side)
        q, qd, current, memory = sensors.measure(own.model, sampling.period, q, qd, current, memory, w)
        q, qd = own.of_joints(q, qd, sensors.side)
        return scalar.array(np.concatenate([q, qd, current])), scalar.array(memory)

    shapes = {state: (plant.size,), "u": (n,), "m_sensors": (remembered,)} | varying
    shapes |= {"w_sensors": (draws,)} if draws else {}
    stages.append(Call(trace("sense", sense, shapes, (queue, f"m_sensors{NEXT}"))))
    if late:
        stages.append(Delay(queue, "y_old", "d_measured", 3 * n, int(delays.measured.max()) + 1))
        queue = "y_old"
    if delays.fractional or lossy:
        stages.append(Draw("w_timing", 3, TIMING))
    if lossy:

        def keep(y: Array, kept: Array, d: Array, w: Array) -> tuple[Array, Array]:
            y = scalar.where(scalar.less(w[2], d[4]), kept, y)
            return y, y

        shapes = {queue: (3 * n,), "y_kept": (3 * n,), "d": (5,), "w_timing": (3,)}
        stages.append(Call(trace("keep", keep, shapes, ("y_now", f"y_kept{NEXT}"))))
        queue = "y_now"

    def tell(y: Array, x: Array, u: Array, *p: Array) -> Array:
        return scalar.array(np.concatenate([y, parts.plant(dict(zip(varying, p, strict=True))).applied(x, u)]))

    shapes = {queue: (3 * n,), "x": (plant.size,), "u": (n,)} | varying
    stages.append(Call(trace("tell", tell, shapes, ("y",))))
    stages.append(_followed(parts))
    return stages, seen

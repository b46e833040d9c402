"""One tick of a controlled arm as stages of a compiled loop: measure, reference, control, shape, delay, drive. Design section 4.

Blocks between the stages, one lane's numbers each:

    x, x_seen          the plant's state, now and when it was last sampled
    y_new, y_old, y    q, q̇ and current as measured, as they come out of the queue, and what the controller is told
    r                  the reference: q, q̇, q̈
    s                  the controller's state
    u_asked, u_issued  what it commands, and what leaves after shaping
    u_queued, u        what comes out of the queue, and what is in force at the drives
    wrench             on the tip, in force
    p, c               parameters of the robot and of the controller that vary by lane;   d: delays
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.errors import ArmwrightError, ScenarioError
from armwright.kernels.stages import NEVER, NEXT, Call, Delay, Draw, Integrate, Record, Rows, Stage, Table
from armwright.model import Model
from armwright.model.simplify import simplified
from armwright.model.vary import Varied
from armwright.program import Program, trace
from armwright.scalar import Array
from armwright.simulation.integrators import INTEGRATORS
from armwright.simulation.law import Law, traced_law
from armwright.simulation.plant import Plant
from armwright.simulation.reducers import Reduction
from armwright.simulation.sensors import Sensors
from armwright.simulation.shaping import Shaping
from armwright.simulation.stepping import Adaptivity, adaptive_stage, speed_pairs, state_parts
from armwright.simulation.timing import Delays, lateness, planned

SENSING, TIMING = 0, 1  # channels of random numbers
UNTRACEABLE = (
    ArmwrightError,
    TypeError,
    ValueError,
    AttributeError,
    IndexError,
)  # what a law does with symbols it cannot take


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


@dataclass(frozen=True, eq=False)
class Parts:
    """What a tick is made of."""

    arm: Model
    varied: Varied | None
    law: Law
    states: int  # of the controller
    sensors: Sensors
    shaping: Shaping
    delays: Delays
    period: float
    substeps: int
    integrator: str
    recorded: dict[str, int]  # blocks and their entries
    reduction: Reduction
    wrench: bool  # whether something pushes the tip
    adaptivity: Adaptivity | None = None
    untraced: str | None = None  # why the controller runs in Python, where that is known before


def make_cycle(parts: Parts) -> Cycle:
    """The stages of a tick of a controlled arm."""
    before, seen = _measuring(parts)
    after = _commanding(parts)
    untraced = parts.untraced
    try:
        if untraced is None:
            before.append(Call(traced_law(parts.law, parts.arm, parts.period, parts.states)))
    except UNTRACEABLE as error:
        if isinstance(error, ScenarioError):  # it can be traced, and is wrong
            raise
        untraced = f"{type(error).__name__}: {error}"
    integrate = _integration(parts, seen)
    after += [Rows("wrench", 6)] if parts.wrench else []
    after += [Record("run", *zip(*parts.recorded.items(), strict=True))] if parts.recorded else []
    after += [_reducing(parts)] if parts.reduction.reducers else []
    return Cycle(tuple(before), (*after, *integrate), untraced, seen)


def _reducing(parts: Parts) -> Call:
    """The stage that follows the rows with reducers, those that would be recorded."""

    def plant(*p: Array) -> Plant:
        return Plant.of(told_arm(parts, *p))

    size = Plant.of(parts.arm).size
    return Call(parts.reduction.program(plant, size, _wrench(parts) | _parameters(parts)))


def _integration(parts: Parts, seen: bool) -> list[Stage]:
    """The stage that moves the plant; none where CVODES does."""
    planned = parts.delays.pending + 2 if parts.delays.fractional else 0
    if parts.integrator in INTEGRATORS:
        return [Integrate(plant_step(parts), parts.substeps, planned, seen)]
    if parts.integrator == "cvodes":
        return []
    assert parts.adaptivity is not None
    derivative, shapes = plant_derivative(parts)
    return [adaptive_stage(derivative, shapes, parts.adaptivity, state_parts(Plant.of(parts.arm)), planned, seen)]


def plant_derivative(parts: Parts) -> tuple[Callable[..., Array], dict[str, tuple[int, ...]]]:
    """dx/dt of the arm with the lane's parameters, and the shapes of its arguments by name."""

    def derivative(x: Array, u: Array, *rest: Array) -> Array:
        wrench, p = split(parts, rest)
        return _plant(parts, *p).derivative(x, u, *wrench)

    return derivative, {"x": (Plant.of(parts.arm).size,), "u": (parts.arm.n,)} | _wrench(parts) | _parameters(parts)


def split(parts: Parts, rest: tuple[Array, ...] | list[Array]) -> tuple[list[Array], list[Array]]:
    """What comes behind x and u: the wrench, where there is one, and the lane's parameters, where some vary."""
    return list(rest[: parts.wrench]), list(rest[parts.wrench :])


def _wrench(parts: Parts) -> dict[str, tuple[int, ...]]:
    return {"wrench": (6,)} if parts.wrench else {}


def plant_step(parts: Parts) -> Program:
    """The plant's step with the arm's varied parameters as one more input."""
    plant = Plant.of(parts.arm)
    rule = INTEGRATORS[parts.integrator].paired(speed_pairs({part.name: part.place for part in plant.parts}))
    _, shapes = plant_derivative(parts)

    def step(x: Array, u: Array, *rest: Array) -> Array:
        *more, h = rest
        wrench, p = split(parts, more)
        return _plant(parts, *p).step(rule, x, u, h, *wrench)

    return trace("step", step, shapes | {"h": ()}, (f"x{NEXT}",))


def _parameters(parts: Parts) -> dict[str, tuple[int, ...]]:
    return {} if parts.varied is None else {"p": (len(parts.varied.parameters),)}


def told_arm(parts: Parts, *p: Array) -> Model:
    """The arm with the lane's parameters."""
    return parts.varied.model(p[0]) if parts.varied is not None else parts.arm


def _plant(parts: Parts, *p: Array) -> Plant:
    return Plant.of(simplified(told_arm(parts, *p)))


def _measuring(parts: Parts) -> tuple[list[Stage], bool]:
    """Stages from the plant's state to what the controller is told, and whether the plant is sampled between ticks."""
    n, delays, sensors = parts.arm.n, parts.delays, parts.sensors
    plant, draws = Plant.of(parts.arm), parts.sensors.draws(parts.arm.n)
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
        arm = told_arm(parts, *p)
        q, qd, current = plant_of(arm).measured(x, u, sensors.side)
        q, qd, current, memory = sensors.measure(arm, parts.period, q, qd, current, memory, w)
        return scalar.array(np.concatenate([q, qd, current])), scalar.array(memory)

    plant_of = Plant.of
    shapes = {state: (plant.size,), "u": (n,), "m_sensors": (remembered,)} | _parameters(parts)
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
        return scalar.array(np.concatenate([y, Plant.of(told_arm(parts, *p)).applied(x, u)]))

    shapes = {queue: (3 * n,), "x": (plant.size,), "u": (n,)} | _parameters(parts)
    stages.append(Call(trace("tell", tell, shapes, ("y",))))
    stages.append(Table("r", 3 * n))
    return stages, seen


def _commanding(parts: Parts) -> list[Stage]:
    """Stages from what the controller commands to what is in force at the drives."""
    n, delays, shaping = parts.arm.n, parts.delays, parts.shaping
    late, fractional, waits = bool(np.any(delays.commanded)), delays.fractional, delays.pending
    issued = "u_issued" if late or fractional else "u"

    def shape(asked: Array, last: Array) -> tuple[Array, Array]:
        u = shaping.shaped(parts.period, asked, last)
        return (u, u) if issued == "u" else (u,)  # type: ignore[return-value]

    outputs = ("u", f"u_issued{NEXT}") if issued == "u" else (f"u_issued{NEXT}",)
    stages: list[Stage] = [Call(trace("shape", shape, {"u_asked": (n,), "u_issued": (n,)}, outputs))]
    if late:
        stages.append(
            Delay("u_issued", "u_queued" if fractional else "u", "d_commanded", n, int(delays.commanded.max()) + 1)
        )
        issued = "u_queued"
    if not fractional:
        return stages

    def plan(tick: Array, u: Array, waiting: Array, arrivals: Array, base: Array, d: Array, w: Array):
        late = lateness(delays, tick[0], d[0], d[1], d[2], w[0])
        if np.any(delays.command_loss):
            late = scalar.where(scalar.less(w[1], d[3]), NEVER, late)
        plans, begins, waiting, arrivals, base = planned(tick[0], u, late, waiting.reshape(waits, n), arrivals, base)
        now = plans[0]
        for begin, command in zip(begins, plans[1:], strict=True):
            now = scalar.where(scalar.less_equal(begin, 0.0), command, now)
        return plans.ravel(), begins * parts.period, waiting.ravel(), arrivals, base, scalar.array(now)

    shapes = {
        "tick": (1,),
        issued: (n,),
        "waiting": (waits * n,),
        "arrivals": (waits,),
        "u_base": (n,),
        "d": (5,),
        "w_timing": (3,),
    }
    outputs = ("u_plan", "u_from", f"waiting{NEXT}", f"arrivals{NEXT}", f"u_base{NEXT}", "u")
    stages.append(Call(trace("plan", plan, shapes, outputs)))
    return stages

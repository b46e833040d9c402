"""One tick as stages of a compiled loop: measure, reference, control, filter, delay, drive. Design section 4.

Without a controller, commands come from a schedule, and of these stages the last one is left.

Blocks between the stages, one lane's numbers each:

    x, x_seen          the plant's state, now and when it was last sampled; so u_seen, wrench_seen … of what acts on it
    y_new, y_old, y    measurements, as they come out of the queue, and what the controller sees
    r                  the reference
    s                  the controller's state
    u_asked, u_kept, u_issued    what it commands, what of that is within rate and limit, and what leaves, rounded
    u_queued, u        what comes out of the queue, and what is in force at the drives
    wrench, brake, payload    on the tip, which are applied, and in the hands, in force;   supply, enabled: of the drives
    p, c, c_reference  parameters of the robot, the controller and the reference that vary by lane;   d: delays
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.interfaces import UNTRACEABLE, why
from armwright.kernels.stages import NEXT, SEEN, Call, DelayStage, DrawStage, RecordStage, RowsStage, Stage
from armwright.program import Program, trace
from armwright.scalar import Array
from armwright.simulation.loop.command_filter import command_stages
from armwright.simulation.loop.config import LoopConfig, Sampling
from armwright.simulation.loop.controller import traced_controller
from armwright.simulation.loop.plant_programs import plant_stages
from armwright.simulation.plant.inputs import OF_DRIVES, PlantInputs
from armwright.simulation.plant.view import PlantView

SENSING, TIMING = 0, 1  # channels of random numbers


@dataclass(frozen=True, eq=False)
class Tick:
    """The stages of a tick.

    Attributes:
        before, after: stages up to the controller and behind it: one after another where it is compiled, and otherwise with the
            controller's Python between them.
        untraced: why the controller could not be compiled; None where it is.
        seen: blocks that are kept for the measurement where the plant is sampled between ticks.
    """

    before: tuple[Stage, ...]
    after: tuple[Stage, ...]
    untraced: str | None
    seen: tuple[str, ...]


def make_tick(config: LoopConfig) -> Tick:
    """The stages of a tick."""
    sampling, untraced = config.sampling, None
    seen: tuple[str, ...] = ()
    before: list[Stage] = []
    after: list[Stage] = []
    inputs: list[Stage] = [RowsStage(name, entries) for name, entries in config.inputs.items()]
    if sampling is None:
        before += [RowsStage("u", config.arm.n)]
    elif _measured_inputs(config, sampling):  # sensors and limits depend on what acts on the plant
        before, inputs = inputs, []
    if sampling is not None:
        stages, seen = measuring_stages(config, sampling)
        before += stages
    if config.reference is not None:
        before.append(config.reference.stage())
    if sampling is not None:
        after = command_stages(config.arm.n, sampling.period, sampling.command_filter, sampling.delays)
        untraced = sampling.untraced
        try:
            if untraced is None:
                program = traced_controller(sampling.controller, config.arm, sampling.period, sampling.states)
                before.append(Call(program))
        except UNTRACEABLE as error:
            if isinstance(error, ScenarioError):  # it can be traced, and is wrong
                raise
            untraced = why(error)
    after += inputs
    if config.recorded:
        blocks = zip(*((name, layout.size) for name, layout in config.recorded.items()), strict=True)
        after.append(RecordStage("run", *blocks))
    if config.reduction is not None:
        after.append(Call(config.reduction.program(config)))
    return Tick(tuple(before), (*after, *plant_stages(config, seen)), untraced, seen)


def measuring_stages(config: LoopConfig, sampling: Sampling) -> tuple[list[Stage], tuple[str, ...]]:
    """Stages from the plant's state to block "y", and the blocks that are kept where the plant is sampled between ticks."""
    n, delays, sensors = config.arm.n, sampling.delays, sampling.sensors
    draws, size = sum(sensors.draws), sensors.layout.size
    seen = _seen(config, sampling)
    late, lossy = bool(np.any(delays.measured)), bool(np.any(delays.measurement_loss))
    queue = "y_new" if late or lossy else "y_now"
    stages: list[Stage] = [DrawStage("w_sensors", draws, SENSING)] if draws else []
    stages.append(Call(_sensing(config, sampling, seen, (queue, f"m_sensors{NEXT}"))))
    if late:
        stages.append(DelayStage(queue, "y_old", "d_measured", size, int(delays.measured.max()) + 1))
        queue = "y_old"
    if delays.fractional or lossy:
        stages.append(DrawStage("w_timing", 3, TIMING))
    if lossy:

        def keep(y: Array, kept: Array, d: Array, w: Array) -> tuple[Array, Array]:
            y = scalar.where(scalar.less(w[2], d[4]), kept, y)
            return y, y

        shapes = {queue: (size,), "y_kept": (size,), "d": (5,), "w_timing": (3,)}
        stages.append(Call(trace("keep", keep, shapes, ("y_now", f"y_kept{NEXT}"))))
        queue = "y_now"

    def tell(y: Array, x: Array, u: Array, *p: Array) -> Array:
        values = dict(zip(more, p, strict=True))
        return scalar.array(np.concatenate([y, config.plant(values).applied(x, config.plant_inputs(u, values))]))

    more = {name: shape for name, shape in config.plant_blocks.items() if name in ("p", *OF_DRIVES)}
    shapes = {queue: (size,), "x": (config.bare.size,), "u": (n,)} | more
    stages.append(Call(trace("tell", tell, shapes, ("y",))))
    return stages, seen


def _seen(config: LoopConfig, sampling: Sampling) -> tuple[str, ...]:
    """Blocks that change between ticks and are measured there: state and inputs of the same instant."""
    if not np.any(sampling.delays.earlier):
        return ()
    commands = ("u",) if sampling.delays.fractional else ()
    return ("x", *commands, *_measured_inputs(config, sampling))


def _measured_inputs(config: LoopConfig, sampling: Sampling) -> tuple[str, ...]:
    """Inputs of the plant that what is measured depends on: of a user's sensor all, else those of the drives' currents."""
    further = len(sampling.sensors.sensors) > 1
    return tuple(name for name in config.inputs if further or name in OF_DRIVES)


def _sensing(config: LoopConfig, sampling: Sampling, seen: tuple[str, ...], outputs: tuple[str, str]) -> Program:
    """One measurement of all sensors, from blocks of one instant."""
    sensors, draws = sampling.sensors, sum(sampling.sensors.draws)
    of_view = _measured_inputs(config, sampling)
    of_view = {name: shape for name, shape in config.plant_blocks.items() if name == "p" or name in of_view}
    shapes = {"x": (config.bare.size,), "u": (config.arm.n,)} | of_view
    schedules = [name for name in config.inputs if name in seen]  # their rows at a tick are in force when it measures
    blocks = {name + SEEN * (name in seen): shape for name, shape in shapes.items()}
    blocks |= {name: shapes[name] for name in schedules} | ({"see_at": (1,)} if schedules else {})
    blocks |= {"m_sensors": (sum(sensors.memories),), "c_sensors": sensors.values.shape[1:]}
    blocks |= {"w_sensors": (draws,)} if draws else {}

    def sense(*arguments: Array) -> tuple[Array, Array]:
        given = dict(zip(blocks, arguments, strict=True))
        values = {name: given[name + SEEN * (name in seen)] for name in shapes}
        for name in schedules:
            between = scalar.less(given["see_at"][0], sampling.period)
            values[name] = scalar.where(between, values[name], given[name])
        view = PlantView(config.plant(values), values["x"], PlantInputs.named(values["u"], values), sampling.period)
        w = given["w_sensors"] if draws else np.zeros(0)
        return sensors.of_lane(given["c_sensors"]).measure(view, given["m_sensors"], w)

    return trace("sense", sense, blocks, outputs)

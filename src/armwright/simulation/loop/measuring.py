"""Measuring: the stages from the plant's state to what a controller sees. Design section 4, step 1."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.kernels.stages import NEXT, Call, Delay, Draw, Stage
from armwright.program import trace
from armwright.scalar import Array
from armwright.simulation.loop.config import LoopConfig, Sampling
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.view import PlantView

SENSING, TIMING = 0, 1  # channels of random numbers


def measuring_stages(config: LoopConfig, sampling: Sampling) -> tuple[list[Stage], bool]:
    """Stages from the plant's state to block "y", and whether the plant is sampled between ticks."""
    n, delays, sensors = config.arm.n, sampling.delays, sampling.sensors
    draws, size = sum(sensors.draws), sensors.layout.size
    of_view = config.plant_blocks if len(sensors.sensors) > 1 else _parameters(config)
    seen = bool(np.any(delays.earlier))
    late, lossy = bool(np.any(delays.measured)), bool(np.any(delays.measurement_loss))
    state = "x_seen" if seen else "x"
    queue = "y_new" if late or lossy else "y_now"
    stages: list[Stage] = [Draw("w_sensors", draws, SENSING)] if draws else []

    varying = sensors.values.shape[1:]

    def sense(x: Array, u: Array, memory: Array, c: Array, *rest: Array) -> tuple[Array, Array]:
        *given, w = rest if draws else (*rest, np.zeros(0))
        values = dict(zip(of_view, given, strict=True))
        view = PlantView(config.plant(values), x, PlantInputs.named(u, values), sampling.period)
        return sensors.of_lane(c).measure(view, memory, w)

    shapes = {
        state: (config.bare.size,),
        "u": (n,),
        "m_sensors": (sum(sensors.memories),),
        "c_sensors": varying,
    } | of_view
    shapes |= {"w_sensors": (draws,)} if draws else {}
    stages.append(Call(trace("sense", sense, shapes, (queue, f"m_sensors{NEXT}"))))
    if late:
        stages.append(Delay(queue, "y_old", "d_measured", size, int(delays.measured.max()) + 1))
        queue = "y_old"
    if delays.fractional or lossy:
        stages.append(Draw("w_timing", 3, TIMING))
    if lossy:

        def keep(y: Array, kept: Array, d: Array, w: Array) -> tuple[Array, Array]:
            y = scalar.where(scalar.less(w[2], d[4]), kept, y)
            return y, y

        shapes = {queue: (size,), "y_kept": (size,), "d": (5,), "w_timing": (3,)}
        stages.append(Call(trace("keep", keep, shapes, ("y_now", f"y_kept{NEXT}"))))
        queue = "y_now"

    def tell(y: Array, x: Array, u: Array, *p: Array) -> Array:
        plant = config.plant(dict(zip(_parameters(config), p, strict=True)))
        return scalar.array(np.concatenate([y, plant.applied(x, u)]))

    shapes = {queue: (size,), "x": (config.bare.size,), "u": (n,)} | _parameters(config)
    stages.append(Call(trace("tell", tell, shapes, ("y",))))
    return stages, seen


def _parameters(config: LoopConfig) -> dict[str, tuple[int, ...]]:
    """Shape of the block of varied parameters, if the arm has any."""
    return {name: shape for name, shape in config.plant_blocks.items() if name == "p"}

"""Plants linearised about some states: slopes, and the rates of what is integrated exactly."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import casadi
import numpy as np

from armwright.model import Model
from armwright.model.vary import Varied
from armwright.program import Program, trace
from armwright.program.program import Port
from armwright.program.turns import alone
from armwright.scalar import Array
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.step_causes import Weakened


@dataclass(frozen=True, eq=False)
class Slopes:
    """Plants linearised about some states.

    Attributes:
        slopes: (m, size, size) ∂(dx/dt)/∂x.   fast: (m, k) λ [1/s] of the entries that are integrated exactly.
        stiff: (k,) places of those entries.
    """

    slopes: np.ndarray
    fast: np.ndarray
    stiff: tuple[int, ...]

    @cached_property
    def rates(self) -> np.ndarray:
        """Eigenvalues (m, size - k) [1/s] of what is not integrated exactly, whose time constants are no limit."""
        kept = np.setdiff1d(np.arange(self.slopes.shape[-1]), self.stiff)
        return np.linalg.eigvals(self.slopes[:, kept[:, None], kept])


@alone
def linearised(model: Model, varied: Varied | Weakened | None = None) -> Program:
    """∂(dx/dt)/∂x and λ of what is integrated exactly, from the plant's own graph: (x, u, brake?, p?) → slope, fast?."""
    bare = Plant.of(model, brakes=True)
    size, count = bare.size, len(bare.stiff)
    names = {"x": (size,), "u": (model.n,)} | ({"brake": (len(bare.braked),)} if bare.brakes else {})
    names |= {} if varied is None else {"p": (len(varied.names),)}

    def plant(x: Array, u: Array, *rest: Array) -> tuple[np.ndarray, np.ndarray]:
        arguments = dict(zip(list(names)[2:], rest, strict=True))
        built = bare if varied is None else Plant.of(varied.model(arguments["p"]), brakes=True)
        inputs = PlantInputs.named(u, arguments)
        if built.sticking is not None:
            # Slopes of what slides; where it stops or turns round, steps are of another kind.
            inputs = replace(inputs, directions=np.ones(len(built.sticking.places)))
        return built.split(x, inputs)

    split = trace("plant", plant, names, ("xd", "fast"))
    symbols = [casadi.SX.sym(name, shape[0]) for name, shape in names.items()]  # type: ignore[arg-type]
    xd, fast = split.graph(*symbols)
    slope = casadi.densify(casadi.jacobian(xd, symbols[0]))
    outputs = [slope.T.reshape((size * size, 1)), *([casadi.densify(fast)] if count else [])]
    graph = casadi.Function("plant_slope", symbols, outputs)
    ports = (Port("slope", (size, size)), *([Port("fast", (count,))] if count else []))
    return Program("plant_slope", split.inputs, ports, graph)

"""The plant's derivative as one program: a rule that needs it at several stages calls it, so that it is compiled once."""

from __future__ import annotations

from typing import Protocol

import casadi
import numpy as np

from armwright.program import Program, call
from armwright.program.program import Port
from armwright.scalar import Array, Symbol
from armwright.simulation.plant.inputs import PlantInputs

FREE = "parameters"  # the input of what is symbolic in the model itself


class _Split(Protocol):
    def split(self, x: Array, inputs: PlantInputs) -> tuple[Array, Array]: ...


class PlantProgram:
    """dx/dt and the rates of a plant's stiff entries, never inlined.

    Numbers of the model that are symbols of the trace around it become one more input, and rates that are numbers stay so.
    """

    def __init__(self, plant: _Split, sizes: dict[str, int]):
        symbols = {name: _named(name, size) for name, size in sizes.items()}
        derivative, rates = plant.split(symbols["x"], PlantInputs.named(symbols["command"], symbols))
        self.rates = rates
        outputs = {"xd": _column(derivative)}
        if any(isinstance(rate, Symbol) for rate in rates):
            outputs["rates"] = _column(rates)
        inputs = {name: _column(array) for name, array in symbols.items()}
        known = {entry.element_hash() for column in inputs.values() for entry in casadi.symvar(column)}
        free = [s for s in casadi.symvar(casadi.vertcat(*outputs.values())) if s.element_hash() not in known]
        self.free = [Symbol(entry) for entry in free]
        if free:
            inputs[FREE] = casadi.vertcat(*free)
        graph = casadi.Function(
            "plant", list(inputs.values()), casadi.cse(list(outputs.values())), list(inputs), list(outputs),
            {"never_inline": True},
        )  # fmt: skip
        ports = [
            tuple(Port(name, (column.shape[0],)) for name, column in columns.items()) for columns in (inputs, outputs)
        ]
        self.program = Program("plant", ports[0], ports[1], graph)

    def split(self, x: Array, inputs: PlantInputs) -> tuple[Array, Array]:
        """As the plant's own, by a call."""
        arguments = [x, *(getattr(inputs, port.name) for port in self.program.inputs[1:] if port.name != FREE)]
        free = [np.array(self.free, dtype=object)] if self.free else []
        results = call(self.program, *arguments, *free)
        if len(self.program.outputs) == 1:
            return results, self.rates
        derivative, rates = results
        kept = [new if isinstance(old, Symbol) else old for old, new in zip(self.rates, rates, strict=True)]
        return derivative, np.array(kept, dtype=object)


def _named(name: str, size: int) -> np.ndarray:
    return np.array([Symbol.named(f"{name}_{k}") for k in range(size)], dtype=object)


def _column(array: Array) -> casadi.SX:
    return casadi.densify(casadi.vertcat(*(v.sx if isinstance(v, Symbol) else casadi.SX(float(v)) for v in array)))

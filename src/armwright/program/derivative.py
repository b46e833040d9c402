"""Derivatives of programs: slopes of outputs by an input, and tangents carried along. [GriewankWalther2008]"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import casadi
import numpy as np

from armwright.program.program import Port, Program
from armwright.program.turns import alone


@alone
def derivative(program: Program, by: str) -> Program:
    """The program with, behind its outputs y, their derivatives  d<y>_d<by> = ∂y/∂by,  (*shape of y, *shape of by).

    Args:
        program: what is differentiated, exactly.   by: name of the input.
    """
    symbols = _symbols(program)
    outputs = program.graph.call(symbols)
    place = [port.name for port in program.inputs].index(by)
    slopes = [casadi.densify(casadi.jacobian(y, symbols[place])) for y in outputs]
    rows = [casadi.reshape(slope.T, -1, 1) for slope in slopes]
    inner = program.inputs[place].shape
    ports = (*program.outputs, *(Port(f"d{port.name}_d{by}", (*port.shape, *inner)) for port in program.outputs))
    return _program(f"{program.name}_by_{by}", program.inputs, ports, symbols, [*outputs, *rows])


@alone
def with_tangents(
    program: Program, active: Collection[str], seeds: Mapping[str, np.ndarray], count: int, *, noinline: bool = False
) -> Program:
    """The program with tangents in `count` directions carried along:  ẏ = Σ ∂y/∂b ḃ  over its inputs b.

    An active input, and every output, holds behind its n values their tangents, (n, count) in row-major order.

    Args:
        program: what is carried along.   active: names of inputs that come with tangents.
        seeds: constant tangents (n, count) of further inputs, by name.   count: directions.
        noinline: a traced function that calls this program keeps one call of it instead of a copy of its operations.
    """
    symbols = _symbols(program)
    outputs = program.graph.call(symbols)
    inputs, ports, carried = [], [], []
    for port, symbol in zip(program.inputs, symbols, strict=True):
        if port.name in active:
            tangent = casadi.SX.sym(f"d_{port.name}", port.size * count)  # type: ignore[arg-type]
            carried.append((symbol, casadi.reshape(tangent, count, port.size).T))
            inputs.append(casadi.vertcat(symbol, tangent))
            ports.append(Port(port.name, (port.size * (1 + count),)))
        else:
            if port.name in seeds and port.size:
                carried.append((symbol, casadi.SX(casadi.DM(seeds[port.name]))))
            inputs.append(symbol)
            ports.append(port)
    results = []
    for y in outputs:
        slopes = casadi.SX(y.shape[0], count)
        for symbol, tangent in carried:
            if symbol.shape[0] and y.shape[0]:
                slopes += casadi.jtimes(y, symbol, tangent)
        results.append(casadi.vertcat(y, casadi.reshape(casadi.densify(slopes).T, -1, 1)))
    enlarged = tuple(Port(port.name, (port.size * (1 + count),)) for port in program.outputs)
    return _program(f"{program.name}_tangents", tuple(ports), enlarged, inputs, results, noinline)


@alone
def without_tangents(program: Program, active: Collection[str], count: int) -> Program:
    """The program as it is, with active inputs that hold tangents in `count` directions behind their values, as above."""
    symbols = _symbols(program)
    inputs, ports = [], []
    for port, symbol in zip(program.inputs, symbols, strict=True):
        carried = port.name in active
        ports.append(Port(port.name, (port.size * (1 + count),)) if carried else port)
        tangent = casadi.SX.sym(f"d_{port.name}", port.size * count)  # type: ignore[arg-type]
        inputs.append(casadi.vertcat(symbol, tangent) if carried else symbol)
    return _program(f"{program.name}_plain", tuple(ports), program.outputs, inputs, program.graph.call(symbols))


def _symbols(program: Program) -> list[casadi.SX]:
    return [casadi.SX.sym(port.name, port.size) for port in program.inputs]  # type: ignore[arg-type]


def _program(
    name: str, inputs: tuple[Port, ...], outputs: tuple[Port, ...], columns: list[casadi.SX], results: list[casadi.SX],
    noinline: bool = False,
) -> Program:  # fmt: skip
    """A program from columns; names of ports may be alike on both sides, as those of blocks are."""
    dense = [casadi.densify(column) for column in results]
    graph = casadi.Function(name, columns, casadi.cse(dense), {"never_inline": noinline})
    return Program(name, inputs, outputs, graph)

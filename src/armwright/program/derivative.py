"""Derivatives of programs: slopes of outputs by an input, and tangents carried along. [GriewankWalther2008]"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

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
    ports, rows = _slopes(program, by, symbols, outputs)
    return _program(f"{program.name}_by_{by}", program.inputs, (*program.outputs, *ports), symbols, [*outputs, *rows])


@alone
def slopes(program: Program, by: Sequence[str]) -> Program:
    """The derivatives alone of the program's outputs y by several inputs:  d<y>_d<b> = ∂y/∂b,  (*shape of y, *shape of b).

    Args:
        program: what is differentiated, exactly.   by: names of the inputs; outputs are in their order, each with all of y.
    """
    symbols = _symbols(program)
    outputs = program.graph.call(symbols)
    found = [_slopes(program, each, symbols, outputs) for each in by]
    ports = tuple(port for pair in found for port in pair[0])
    return _program(
        f"{program.name}_slopes_{'_'.join(by)}",
        program.inputs,
        ports,
        symbols,
        [row for pair in found for row in pair[1]],
    )


def _slopes(
    program: Program, by: str, symbols: Sequence[casadi.SX], outputs: Sequence[casadi.SX]
) -> tuple[list[Port], list[casadi.SX]]:
    """Ports and columns of the derivatives of all outputs by one input."""
    place = [port.name for port in program.inputs].index(by)
    found = [casadi.densify(casadi.jacobian(y, symbols[place])) for y in outputs]
    inner = program.inputs[place].shape
    ports = [Port(f"d{port.name}_d{by}", (*port.shape, *inner)) for port in program.outputs]
    return ports, [casadi.reshape(slope.T, -1, 1) for slope in found]


Called = tuple[Program, list[casadi.SX], list[casadi.SX]]  # a call: of what, its arguments, and symbols of its results
Columns = Sequence[tuple[casadi.SX, casadi.SX]]  # values (n,) and their tangents (n, count), sparse where they are 0


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
    return _Tangents(count).program(program, active, seeds, noinline)[0]


class _Tangents:
    """Programs with tangents in `count` directions.

    A program's calls stay calls, one each with all tangents; CasADi's own rule would call anew for every direction. So a program
    is differentiated from call to call, each call's results being symbols until what they stand for is put in.
    """

    def __init__(self, count: int):
        self.count = count
        self._made: dict[str, tuple[Program, list[casadi.Sparsity]]] = {}

    def program(
        self, program: Program, active: Collection[str], seeds: Mapping[str, np.ndarray], noinline: bool
    ) -> tuple[Program, list[casadi.Sparsity]]:
        """A program with tangents, and which of those of its outputs are not always 0."""
        count, inputs, ports, columns = self.count, [], [], []
        for port, symbol in zip(program.inputs, _symbols(program), strict=True):
            if port.name in active:
                tangent = casadi.SX.sym(f"d_{port.name}", port.size * count)  # type: ignore[arg-type]
                columns.append((symbol, casadi.reshape(tangent, count, port.size).T))
                inputs.append(casadi.vertcat(symbol, tangent))
                ports.append(Port(port.name, (port.size * (1 + count),)))
            else:
                seed = casadi.DM(seeds[port.name]) if port.name in seeds else casadi.DM(port.size, count)
                columns.append((symbol, casadi.SX(casadi.sparsify(seed))))
                inputs.append(symbol)
                ports.append(port)
        found = self._carried(program, columns)
        enlarged = tuple(Port(port.name, (port.size * (1 + count),)) for port in program.outputs)
        rows = [_with_rows(*each) for each in found]
        made = _program(f"{program.name}_tangents", tuple(ports), enlarged, inputs, rows, noinline)
        return made, [tangent.sparsity() for _, tangent in found]

    def _carried(self, program: Program, inputs: Columns) -> Columns:
        """Outputs of a program from its inputs."""
        symbols, calls, outputs = _from_call_to_call(program)
        known: list[tuple[casadi.SX, ...]] = []  # symbols of values and tangents, and what they stand for

        def learn(symbol: casadi.SX, value: casadi.SX, tangent: casadi.SX) -> None:
            own = tangent if tangent.is_constant() else casadi.SX.sym("t", tangent.sparsity())  # type: ignore[arg-type]
            known.append((symbol, own, value, tangent))

        def along(columns: list[casadi.SX]) -> Columns:
            """Values of columns of known symbols, and their tangents."""
            values, tangents = (casadi.vertcat(*(each[k] for each in known)) for k in (0, 1))
            slopes = [casadi.SX(column.shape[0], self.count) for column in columns]
            if tangents.nnz():
                slopes = [
                    casadi.jtimes(column, values, tangents) if column.shape[0] else none
                    for column, none in zip(columns, slopes, strict=True)
                ]
            pairs = [(each[k], each[k + 2]) for each in known for k in (0, 1) if not each[k].is_constant()]
            function = casadi.Function("along", [pair[0] for pair in pairs], [*columns, *slopes])
            found = function.call([pair[1] for pair in pairs])
            return list(zip(found[: len(columns)], map(casadi.sparsify, found[len(columns) :]), strict=True))

        for symbol, each in zip(symbols, inputs, strict=True):
            learn(symbol, *each)
        for (callee, arguments, results), needed in zip(calls, _with_slopes(calls, outputs), strict=True):
            for symbol, each in zip(results, self._called(callee, along(arguments), needed), strict=True):
                learn(symbol, *each)
        return along(outputs)

    def _called(self, callee: Program, arguments: Columns, needed: bool) -> Columns:
        """Results of a call, with tangents of 0 if none are needed. Tangents that are numbers become part of what is called."""
        if not needed:
            values = callee.graph.call([value for value, _ in arguments])
            return [
                (value, casadi.SX(port.size, self.count)) for value, port in zip(values, callee.outputs, strict=True)
            ]
        count, given = self.count, list(zip(callee.inputs, arguments, strict=True))
        seeds = {port.name: np.array(casadi.DM(tangent)) for port, (_, tangent) in given if tangent.is_constant()}
        active = [port.name for port in callee.inputs if port.name not in seeds]
        variant = hashlib.sha256(repr((active, [(name, seed.tobytes()) for name, seed in seeds.items()])).encode())
        name = f"{callee.name}_{variant.hexdigest()[:8]}"  # two ways to call it are two programs
        if name not in self._made:
            self._made[name] = self.program(replace(callee, name=name), active, seeds, noinline=True)
        program, patterns = self._made[name]
        results = program.graph.call([v if p.name in seeds else _with_rows(v, t) for p, (v, t) in given])
        sizes = [port.size for port in callee.outputs]
        return [
            (column[:size], casadi.project(casadi.reshape(column[size:], count, size).T, pattern))
            for column, size, pattern in zip(results, sizes, patterns, strict=True)
        ]


def _from_call_to_call(program: Program) -> tuple[list[casadi.SX], list[Called], list[casadi.SX]]:
    """A program's inputs as symbols, its calls in order, and its outputs; the results of calls are symbols too."""
    symbols, calls, values = _symbols(program), [], {}
    outputs = [casadi.SX.zeros(port.size) for port in program.outputs]
    for i in program.instructions:
        if i.operation == "INPUT" and i.place is not None:
            values[i.results[0]] = symbols[i.place[0]][i.place[1]]
        elif i.operation == "OUTPUT" and i.place is not None:
            outputs[i.place[0]][i.place[1]] = values[i.arguments[0]]
        elif i.operation == "CONST" and i.constant is not None:
            values[i.results[0]] = casadi.SX(i.constant)
        elif i.callee is not None:
            entries = iter(i.arguments)
            columns = [casadi.vertcat(*(values[next(entries)] for _ in range(p.size))) for p in i.callee.inputs]
            results = [casadi.SX.sym(port.name, port.size) for port in i.callee.outputs]  # type: ignore[arg-type]
            values.update(zip(i.results, casadi.vertsplit(casadi.vertcat(*results)), strict=True))
            calls.append((i.callee, columns, results))
        else:
            operands, code = [values[a] for a in i.arguments], getattr(casadi, f"OP_{i.operation}")
            values[i.results[0]] = (casadi.SX.unary if len(operands) == 1 else casadi.SX.binary)(code, *operands)
    return symbols, calls, outputs


def _with_slopes(calls: Sequence[Called], outputs: Sequence[casadi.SX]) -> list[bool]:
    """True for calls whose results change the outputs smoothly, not only by the branch that is taken."""
    every = casadi.vertcat(*(result for _, _, results in calls for result in results))
    needed: list[bool] = []
    used: set[int] = set()  # places in `every`
    following, end = casadi.vertcat(*outputs), every.shape[0]
    for _, arguments, results in reversed(calls):
        if following.shape[0]:
            weights = casadi.SX.sym("w", following.shape[0])  # type: ignore[arg-type]
            used.update(casadi.sparsify(casadi.jtimes(following, every, weights, True)).sparsity().row())
        begin = end - sum(result.shape[0] for result in results)
        needed.append(not used.isdisjoint(range(begin, end)))
        following, end = casadi.vertcat(*arguments) if needed[-1] else casadi.SX(0, 1), begin
    return needed[::-1]


def _with_rows(value: casadi.SX, tangent: casadi.SX) -> casadi.SX:
    """Values with their tangents (n, count) behind them in row-major order."""
    return casadi.vertcat(value, casadi.reshape(casadi.densify(tangent).T, -1, 1))


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
    names = (
        [port.name for port in inputs],
        [f"{port.name}_out" for port in outputs],
    )  # a caller knows a condition by its name
    graph = casadi.Function(name, columns, casadi.cse(dense), *names, {"never_inline": noinline})
    return Program(name, inputs, outputs, graph)

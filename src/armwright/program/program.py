"""Program: a traced function as a list of operations, inputs and outputs by name. It knows no robots."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi

from armwright.program.operations import by_code
from armwright.program.turns import alone

Value = int  # index of an instruction's result; every value is written once
NO_OPERATIONS = ("INPUT", "OUTPUT", "CONST")  # instructions that compute nothing
# first input of a program whose results are not used where it is 0: compiled code may then leave it out
NEEDED = "needed"


@dataclass(frozen=True)
class Port:
    """An input or an output: name and shape; entries in row-major order."""

    name: str
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of entries."""
        return math.prod(self.shape)


@dataclass(frozen=True)
class Instruction:
    """`result = operation(*arguments)` on scalars.

    INPUT and OUTPUT carry (port, entry), CONST its number, CALL the program that it calls and as many results as that has.
    """

    operation: str
    results: tuple[Value, ...]
    arguments: tuple[Value, ...]
    place: tuple[int, int] | None = None
    constant: float | None = None
    callee: Program | None = None


@dataclass(frozen=True)
class Program:
    """A straight-line program with named ports, and the CasADi graph it was read from."""

    name: str
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    graph: casadi.Function

    @cached_property
    @alone
    def instructions(self) -> tuple[Instruction, ...]:
        """The operations in order, in single assignment: CasADi's reused work slots are renamed."""
        return tuple(_read(self))

    @property
    def conditional(self) -> bool:
        """True for a program that may be left out where its first input is 0."""
        return bool(self.inputs) and self.inputs[0].name == NEEDED

    @cached_property
    @alone
    def callees(self) -> dict[str, Program]:
        """The programs that this one calls, by name."""
        programs = {}
        for name in self.graph.get_function():
            graph = self.graph.get_function(name)
            inputs = tuple(Port(graph.name_in(k), (graph.nnz_in(k),)) for k in range(graph.n_in()))
            outputs = tuple(Port(graph.name_out(k), (graph.nnz_out(k),)) for k in range(graph.n_out()))
            programs[name] = Program(name, inputs, outputs, graph)
        return programs

    @alone
    def casadi(self) -> casadi.Function:
        """The graph as CasADi's users want it: matrices in their own shape, not as rows behind each other."""
        inputs = [casadi.SX.sym(port.name, *_columns(port.shape)) for port in self.inputs]  # type: ignore[arg-type]
        results = self.graph.call([casadi.reshape(x.T, -1, 1) for x in inputs])
        shaped = [
            casadi.reshape(y, *reversed(_columns(port.shape))).T for y, port in zip(results, self.outputs, strict=True)
        ]
        names = [port.name for port in self.inputs], [port.name for port in self.outputs]
        return casadi.Function(self.name, inputs, shaped, *names)

    @alone
    def operation_counts(self) -> Counter[str]:
        """Number of operations of each name, calls included."""
        ids = (self.graph.instruction_id(k) for k in range(self.graph.n_instructions()))
        counts = Counter(by_code(code).name for code in ids)
        for name in NO_OPERATIONS:
            del counts[name]
        if counts.pop("CALL", 0):  # only the instructions name the callee; reading them takes ten times as long
            callees = [each.callee for each in self.instructions if each.callee is not None]
            for name, calls in Counter(callee.name for callee in callees).items():
                of_one = next(callee for callee in callees if callee.name == name).operation_counts()
                counts.update({operation: calls * count for operation, count in of_one.items()})
        return counts

    def __str__(self) -> str:
        return self.listing(self.instructions)

    def listing(self, instructions: Sequence[Instruction]) -> str:
        """The program as text, with its instructions before or after some passes."""
        lines = [f"{self.name}({', '.join(f'{p.name}{list(p.shape)}' for p in self.inputs)})"]
        for i in instructions:
            left = ", ".join(f"%{value}" for value in i.results) or f"{self.outputs[i.place[0]].name}[{i.place[1]}]"  # type: ignore[index]
            if i.operation == "INPUT" and i.place is not None:
                right = f"{self.inputs[i.place[0]].name}[{i.place[1]}]"
            elif i.operation == "CONST":
                right = repr(i.constant)
            else:
                name = i.callee.name if i.callee is not None else i.operation.lower()
                right = f"{name} {', '.join(f'%{value}' for value in i.arguments)}"
            lines.append(f"  {left} = {right}")
        return "\n".join(lines)


def _columns(shape: tuple[int, ...]) -> tuple[int, int]:
    """CasADi's rows and columns for an array: a vector is a column, more axes than two run on in the columns."""
    rows = shape[0] if shape else 1
    return rows, math.prod(shape) // rows if rows else 1


def _read(program: Program) -> list[Instruction]:
    graph = program.graph
    slots: dict[int, Value] = {}
    fresh = 0
    instructions = []
    nodes = None
    for k in range(graph.n_instructions()):
        name = by_code(graph.instruction_id(k)).name
        read, write = graph.instruction_input(k), graph.instruction_output(k)
        if name == "INPUT":
            arguments, place, write = (), (read[0], read[1]), write[:1]
        elif name == "OUTPUT":
            arguments, place, write = (slots[read[0]],), (write[0], write[1]), []
        else:
            arguments, place = tuple(slots[slot] for slot in read), None
        callee = None
        if name == "CALL":
            nodes = graph.instructions_sx() if nodes is None else nodes
            callee = program.callees[nodes[k].which_function().name()]
        results = tuple(range(fresh, fresh + len(write)))
        fresh += len(write)
        slots.update(zip(write, results, strict=True))
        constant = graph.instruction_constant(k) if name == "CONST" else None
        instructions.append(Instruction(name, results, arguments, place, constant, callee))
    return instructions

"""The walk over a program: each instruction is handed to a machine, which prints it. LLVM, C and CUDA share it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from armwright.kernels import lowering
from armwright.kernels.machine import Machine, Value
from armwright.program import Instruction, Program
from armwright.program.passes import optimised

Call = Callable[[Program, list[Value]], list[Value]]
Lower = Callable[..., Value]


def walk(
    machine: Machine,
    program: Program,
    inputs: Sequence[Sequence[Value]],
    call: Call | None = None,
    lower: Lower = lowering.lower,
) -> list[list[Value]]:
    """Prints a program's operations.

    Args:
        machine: prints them.   program: what is printed.   inputs: the machine's values of every entry of every input.
        call: prints a call of another program, flat arguments to flat results; needed where the program makes one.
        lower: prints an operation of the table on values, (machine, name, *values) to a value; C prints calls for some.
    Returns:
        outputs: the machine's values of every entry of every output.
    """
    outputs: list[list[Value]] = [[machine.constant(0.0)] * port.size for port in program.outputs]

    def write(port: int, entry: int, value: Value) -> None:
        outputs[port][entry] = value

    walk_instructions(machine, optimised(program.instructions), {}, lambda p, e: inputs[p][e], write, call, lower)
    return outputs


def walk_instructions(
    machine: Machine,
    instructions: Sequence[Instruction],
    values: dict[int, Value],
    read: Callable[[int, int], Value],
    write: Callable[[int, int, Value], None],
    call: Call | None = None,
    lower: Lower = lowering.lower,
) -> None:
    """Prints instructions; `values` knows what was made before them and learns what they make.

    Args:
        machine: prints them.   instructions: after the passes.   values: the machine's, by the program's.
        read: gives the value of an input's entry (port, entry).   write: takes that of an output's.
        call, lower: as in `walk`.
    """
    for i in instructions:
        arguments = [values[a] for a in i.arguments]
        if i.operation == "INPUT":
            values[i.results[0]] = read(*i.place)  # type: ignore[misc]
        elif i.operation == "OUTPUT":
            write(*i.place, arguments[0])  # type: ignore[misc]
        elif i.operation == "CONST":
            values[i.results[0]] = machine.constant(i.constant)  # type: ignore[arg-type]
        elif i.callee is not None:
            assert call is not None
            values.update(zip(i.results, call(i.callee, arguments), strict=True))
        else:
            values[i.results[0]] = lower(machine, i.operation, *arguments)

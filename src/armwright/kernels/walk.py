"""The walk over a program: each instruction is handed to a machine, which prints it. LLVM, C and CUDA share it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from armwright.kernels import lowering
from armwright.kernels.machine import Machine, Value
from armwright.program import Program
from armwright.program.fuse import optimised

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
    values: dict[int, Value] = {}
    outputs: list[list[Value]] = [[machine.constant(0.0)] * port.size for port in program.outputs]
    for i in optimised(program.instructions):
        arguments = [values[a] for a in i.arguments]
        if i.operation == "INPUT":
            port, entry = i.place  # type: ignore[misc]
            values[i.results[0]] = inputs[port][entry]
        elif i.operation == "OUTPUT":
            port, entry = i.place  # type: ignore[misc]
            outputs[port][entry] = arguments[0]
        elif i.operation == "CONST":
            values[i.results[0]] = machine.constant(i.constant)  # type: ignore[arg-type]
        elif i.callee is not None:
            assert call is not None
            values.update(zip(i.results, call(i.callee, arguments), strict=True))
        else:
            values[i.results[0]] = lower(machine, i.operation, *arguments)
    return outputs

"""Running a program without compiling it: through CasADi's interpreter, or operation by operation with NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armwright.program.operations import OPERATIONS
from armwright.program.program import Instruction, Program, Value


def interpret(program: Program, *arguments: Any) -> Any:
    """The program's results for arrays with any leading axes, by CasADi's virtual machine.

    Args:
        program: what to run.
        arguments: one array an input, (..., *shape), broadcast against each other over the leading axes.
    Returns:
        results: one array an output, (..., *shape); a tuple where there are several.
    """
    arrays = [np.asarray(value, dtype=float) for value in arguments]
    leads = [a.shape[: a.ndim - len(p.shape)] for a, p in zip(arrays, program.inputs, strict=True)]
    lead = np.broadcast_shapes(*leads)
    count = int(np.prod(lead, dtype=int))
    columns = [
        np.broadcast_to(a, (*lead, *port.shape)).reshape(count, port.size)
        for a, port in zip(arrays, program.inputs, strict=True)
    ]
    results = [np.empty((count, port.size)) for port in program.outputs]
    # Numbers pass through buffers, row by row: CasADi's matrices would make a Python float of each.
    buffer, run = program.graph.buffer()
    row_in = [np.zeros(port.size) for port in program.inputs]
    row_out = [np.zeros(port.size) for port in program.outputs]
    for lend, rows in ((buffer.set_arg, row_in), (buffer.set_res, row_out)):
        for k, array in enumerate(rows):
            if array.size:
                lend(k, array.data)  # pyright: ignore[reportCallIssue]  # a buffer is address and size in one
    for row in range(count):
        for array, column in zip(row_in, columns, strict=True):
            array[:] = column[row]
        run()
        for result, array in zip(results, row_out, strict=True):
            result[row] = array
    shaped = [result.reshape(*lead, *port.shape) for result, port in zip(results, program.outputs, strict=True)]
    return shaped[0] if len(shaped) == 1 else tuple(shaped)


def evaluate(instructions: Sequence[Instruction], *arguments: Any) -> list[np.ndarray]:
    """Results of instructions, each computed with NumPy on whole batches: this defines their meaning.

    Args:
        instructions: of a program, before or after the passes.
        arguments: one array an input, (batch, entries).
    Returns:
        outputs: one array an output, (batch, entries); exact rows of the table give the bits of every back end.
    """
    inputs = [np.asarray(value, dtype=float) for value in arguments]
    values: dict[Value, Any] = {}
    outputs: dict[int, dict[int, Any]] = {}
    for i in instructions:
        operands = [values[a] for a in i.arguments]
        if i.operation == "INPUT" and i.place is not None:
            results = [inputs[i.place[0]][:, i.place[1]]]
        elif i.operation == "OUTPUT" and i.place is not None:
            outputs.setdefault(i.place[0], {})[i.place[1]] = operands[0]
            continue
        elif i.operation == "CONST":
            results = [np.float64(i.constant)]
        elif i.callee is not None:
            results = _called(i.callee, operands, len(inputs[0]))
        else:
            meaning = OPERATIONS[i.operation].numpy
            assert meaning is not None
            results = [meaning(*operands)]
        values.update(zip(i.results, results, strict=True))
    batch = len(inputs[0]) if inputs else 1
    return [
        np.stack([np.broadcast_to(entries[k], batch) for k in sorted(entries)], axis=1)
        for _, entries in sorted(outputs.items())
    ]


def _called(callee: Program, operands: list[Any], batch: int) -> list[np.ndarray]:
    """The results of a call, entry by entry."""
    columns, at = [], 0
    for port in callee.inputs:
        columns.append(np.stack([np.broadcast_to(v, batch) for v in operands[at : at + port.size]], axis=1))
        at += port.size
    return [column for output in evaluate(callee.instructions, *columns) for column in output.T]

"""Running a program through CasADi's interpreter, one state after another: slow, portable, and nobody's code of ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.program.program import Program


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
        np.broadcast_to(a, (*lead, *port.shape)).reshape(count, port.size).T
        for a, port in zip(arrays, program.inputs, strict=True)
    ]
    mapped = program.graph.map(count) if count > 1 else program.graph
    results = mapped.call([np.ascontiguousarray(column) for column in columns])
    shaped = [
        np.array(result).reshape(port.size, count).T.reshape(*lead, *port.shape)
        for result, port in zip(results, program.outputs, strict=True)
    ]
    return shaped[0] if len(shaped) == 1 else tuple(shaped)

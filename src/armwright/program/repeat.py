"""Iterations in a trace: one step as a program of its own, called several times.

Compiled code leaves out a step whose state is to the bit that of the step before: an iteration that has come to rest costs no
more, and every lane has the bits that all the steps would have given it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armwright import scalar
from armwright.program.trace import call, trace
from armwright.scalar import Array, Symbol


def repeated(
    name: str, step: Callable[..., Array], state: Array, arguments: tuple[Array, ...], most: int
) -> np.ndarray:
    """The state (k,) after  state = step(state, *arguments)  was done `most` times; on floats only until it stays the same.

    Args:
        name: of the step's program.   step: takes and returns a state; it may use no symbols but its arguments.
        state: (k,).   arguments: of any shapes; what is a number in them becomes a constant of the step.
    """
    if not scalar.is_symbolic(state, *arguments):
        for _ in range(most):
            before, state = state, step(state, *arguments)
            if np.array_equal(before, state, equal_nan=True):
                break
        return state
    entries = [np.asarray(each, dtype=object) for each in arguments]
    symbols = [entry for each in entries for entry in each.flat if isinstance(entry, Symbol)]

    def function(state: Array, values: Array) -> Array:
        given = iter(values)
        return step(state, *(_filled(each, given) for each in entries))

    shapes = {"state": np.shape(state), "values": (len(symbols),)}
    program = trace(name, function, shapes, ("next",), noinline=True, by_content=True)
    values = np.array(symbols, dtype=object)
    for _ in range(most):
        state = call(program, state, values)
    return state


def _filled(entries: np.ndarray, values) -> np.ndarray:
    """The array with the next of the values in place of each symbol."""
    filled = np.array([next(values) if isinstance(entry, Symbol) else entry for entry in entries.flat], dtype=object)
    return scalar.array(filled.reshape(entries.shape))

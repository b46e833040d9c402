"""Tracing: a plain function of arrays, run once on symbols, becomes a straight-line program."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi
import numpy as np

from armwright.errors import HiddenStateError, ProgramError
from armwright.program.program import Port, Program
from armwright.program.turns import alone
from armwright.scalar import Symbol

Shape = tuple[int, ...]


@alone
def trace(
    name: str,
    function: Callable[..., Any],
    inputs: Mapping[str, Shape],
    outputs: Sequence[str] | None = None,
    *,
    noinline: bool = False,
    by_content: bool = False,
) -> Program:
    """The program of `function`: every operation that it does on its inputs, in order, constants folded.

    Args:
        name: what the program is called, a C identifier.
        function: takes one array per input by position and returns an array, or a tuple of them.
        inputs: name and shape of every input.
        outputs: names of the results; by default `name` itself, for a function that returns one array. A list may be filled by
            the function.
        noinline: a traced function that calls this program keeps one call of it instead of a copy of its operations.
        by_content: whether a hash of its operations is added to the name, so that two programs of one name are two functions.
    Raises:
        ProgramError: the function returns another number of arrays than `outputs` has names.
        HiddenStateError: it computes with symbols of another call, which are none of its inputs.
        SymbolError: the function branches on a value or puts one into a float array.
    """
    symbols = {key: _symbols(key, shape) for key, shape in inputs.items()}
    results = function(*symbols.values())
    results = results if isinstance(results, tuple) else (results,)
    names = (name,) if outputs is None else outputs
    if len(results) != len(names):
        raise ProgramError(f"returns {len(results)} arrays", place=name, expected=f"{len(names)}: {', '.join(names)}")
    arrays = [np.asarray(result, dtype=object) for result in results]
    columns = dict(zip(names, arrays, strict=True))
    if by_content:
        listing = str(_program(name, symbols, columns, noinline=False).instructions)
        name = f"{name}_{hashlib.sha256(listing.encode()).hexdigest()[:8]}"
    return _program(name, symbols, columns, noinline=noinline)


@alone
def trace_within(name: str, function: Callable[..., Any], inputs: Mapping[str, Shape]) -> tuple[Program, np.ndarray]:
    """The program of a function (…) → array that also uses symbols of the trace around it, and these.

    They are its last input, "free", where there are any. It is never inlined, and a hash of its operations is in its name.
    """
    symbols = {key: _symbols(key, shape) for key, shape in inputs.items()}
    result = np.asarray(function(*symbols.values()), dtype=object)
    known = {entry.sx.element_hash() for array in symbols.values() for entry in array.flat}
    free = [Symbol(each) for each in casadi.symvar(_column(result)) if each.element_hash() not in known]
    if free:
        symbols["free"] = np.array(free, dtype=object)
    listing = str(_program(name, symbols, {name: result}, noinline=False).instructions)
    name = f"{name}_{hashlib.sha256(listing.encode()).hexdigest()[:8]}"
    return _program(name, symbols, {name: result}, noinline=True), np.array(free, dtype=object)


def _program(name: str, symbols: dict[str, np.ndarray], results: dict[str, np.ndarray], *, noinline: bool) -> Program:
    graph = casadi.Function(
        name,
        [_column(array) for array in symbols.values()],
        casadi.cse([_column(array) for array in results.values()]),
        list(symbols),
        [f"{key}_out" if key in symbols else key for key in results],
        {"never_inline": noinline, "allow_free": True},
    )
    if graph.has_free():
        hidden = f"computes with {graph.get_free()[0]} of another call"
        raise HiddenStateError(hidden, place=name, expected=f"nothing but its arguments: {', '.join(symbols)}")
    return Program(
        name,
        tuple(Port(key, array.shape) for key, array in symbols.items()),
        tuple(Port(key, array.shape) for key, array in results.items()),
        graph,
    )


@alone
def call(program: Program, *arguments: Any) -> Any:
    """The program's results for symbols or floats: how one traced function uses another as a whole."""
    outputs = program.graph.call([_column(np.asarray(value, dtype=object)) for value in arguments])
    arrays = [_array(column, port.shape) for column, port in zip(outputs, program.outputs, strict=True)]
    return arrays[0] if len(arrays) == 1 else tuple(arrays)


def _symbols(name: str, shape: Shape) -> np.ndarray:
    array = np.empty(shape, dtype=object)
    for index in np.ndindex(*shape):
        array[index] = Symbol.named("_".join([name, *(str(k) for k in index)]))
    return array


def _column(array: np.ndarray) -> casadi.SX:
    """Row-major entries of an array as one dense SX column."""
    column = casadi.SX.zeros(array.size, 1)
    for k, entry in enumerate(array.flat):
        if isinstance(entry, Symbol):
            column[k] = entry.sx
        elif entry != 0.0 or math.copysign(1.0, entry) < 0.0:  # zeros are there already
            column[k] = float(entry)
    return casadi.densify(column)


def _array(column: casadi.SX, shape: Shape) -> np.ndarray:
    array = np.empty(shape, dtype=object)
    for k, index in enumerate(np.ndindex(*shape)):
        array[index] = Symbol(column[k])
    return array

"""Bound: a kernel with its arrays fixed, for a control loop that calls it every tick."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from armwright.errors import ShapeError, check_known
from armwright.kernels.batch import Kernel, is_writeable, refuse_shared, wrong_array


class Bound:
    """A kernel bound to its arrays: write into `inputs`, call it, read `outputs`; nothing is checked or allocated again.

    Attributes:
        inputs, outputs: the arrays by name, of the kernel's dtype; write into them (`bound.inputs["q"][:] = …`), never
            replace them.
        result: the output, or a tuple of them, as the call returns it.
    """

    __slots__ = ("_call", "_kept", "_table", "inputs", "outputs", "result")

    def __init__(self, kernel: Kernel, lead: tuple[int, ...], arrays: dict[str, np.ndarray]):
        program = kernel.program
        known = [port.name for port in (*program.inputs, *program.outputs)]
        for name in arrays:
            check_known(ShapeError, name, known, place=f"{program.name}: array")
        self.inputs, self.outputs = (
            {
                port.name: _buffer(program.name, port.name, lead + port.shape, arrays.get(port.name), kernel.dtype)
                for port in ports
            }
            for ports in (program.inputs, program.outputs)
        )
        every = [*self.inputs.values(), *self.outputs.values()]
        refuse_shared(program, list(self.outputs.values()))
        for name, output in self.outputs.items():
            for other, source in self.inputs.items():
                # Row for row over each other is allowed: an input's row is read before an output's is written.
                same = output.ctypes.data == source.ctypes.data and output.nbytes == source.nbytes
                if np.may_share_memory(output, source) and not same:
                    place = f"{program.name}: {name} and {other}"
                    raise ShapeError("lie partly over each other", place=place, expected="separate arrays")
        count = int(np.prod(lead, dtype=np.int64))
        self._table = ctypes.addressof(
            table := (ctypes.c_int64 * (1 + len(every)))(count, *(a.ctypes.data for a in every))
        )
        self._kept = table, kernel
        self._call = kernel.bound_entry
        results = tuple(self.outputs.values())
        self.result: Any = results[0] if len(results) == 1 else results

    def __call__(self) -> Any:
        """Computes the outputs from what the inputs hold now, and returns them."""
        self._call(self._table)
        return self.result


def _buffer(place: str, name: str, shape: tuple[int, ...], array: np.ndarray | None, dtype: np.dtype) -> np.ndarray:
    if array is None:
        return np.zeros(shape, dtype)
    if not is_writeable(array, shape, dtype) or not array.flags.carray:
        raise wrong_array(f"{place}: {name}", array, f"writeable contiguous {dtype} {shape}")
    return array

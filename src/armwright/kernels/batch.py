"""Kernel: a program compiled for batches, called with NumPy arrays of any leading axes."""

from __future__ import annotations

import ctypes
import functools
import itertools
import math
import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import ShapeError
from armwright.kernels.engine import Engine
from armwright.kernels.format import DOUBLE, Format
from armwright.kernels.memory import address, addressof, byte_of, empty
from armwright.kernels.target import Target
from armwright.program import Port, Program
from armwright.scalar import real_numbers

if TYPE_CHECKING:  # a kernel from the cache, called for a few states, needs neither threads nor what prints code
    from collections import Counter
    from concurrent.futures import ThreadPoolExecutor

    from armwright.kernels.llvm import LlvmModule

ndarray = np.ndarray
POINTER = ctypes.c_void_p
CHAIN = 4  # divisions
ROOM = 1800  # operations; two tiles of a longer program want too many registers: a fifth to a half slower
PLANS = 64  # shapes that are remembered
PART = 1_000_000  # operations on whole tiles, some 300 µs: fewer are done sooner than a thread is woken


class Kernel:
    """A compiled program. `kernel(a, b, …)` takes (…, *shape) arrays and broadcasts over the leading axes.

    Attributes:
        program: what is computed.   operations: in it.   target: the processor, and the lanes of a tile.
        format: of the numbers that it takes, computes with and gives.   dtype: NumPy's type of them.
    """

    def __init__(
        self,
        program: Program,
        target: Target,
        check: Callable[[tuple[Any, ...]], None] | None = None,
        format: Format = DOUBLE,
        *,
        other_process: bool = False,
    ):
        """Compiles the program.

        Args:
            program: what is compiled.   target: for which processor, and how many numbers of the format it computes at once.
            check: looks at the arrays of every call before they are used.
            format: of the numbers.   other_process: as of `Engine`.
        """
        self.format, self.dtype = format, format.dtype
        self._check = check
        counts = program.operation_counts()
        ports = (*program.inputs, *program.outputs)
        self.operations = max(1, counts.total())
        self._tile = self.operations + sum(port.size for port in ports)  # loads and stores cost what operations do
        self.program, self.target = program, target.doubled() if _waits(counts) else target
        self._expected = [(port.name, port.shape) for port in program.inputs]
        self._shapes = [port.shape for port in program.outputs]
        self._plans: dict[tuple[tuple[int, ...], ...], tuple[int, list[tuple[int, ...]]]] = {}
        engine = Engine(self.target, batch_module, program, format.name, other_process=other_process)
        ins, outs = len(program.inputs), len(program.outputs)
        steps = [POINTER, ctypes.c_int64] * ins
        self._run = engine.function(f"{program.name}.batch", ctypes.c_int64, *steps, *[POINTER] * outs)
        pointers = [POINTER] * (ins + outs)
        self._run_separate = engine.function(
            f"{program.name}.separate", ctypes.c_int64, *pointers, result=ctypes.c_int32
        )
        self.bound_entry = engine.function(f"{program.name}.bound", POINTER)  # (table of the count and every pointer)

    def __call__(self, *arrays: Any, out: Any = None, threads: int = 1) -> Any:
        """The program's outputs for all states.

        Args:
            arrays: one an input, (…, *shape), numbers; leading axes are broadcast against each other.
            out: array, or tuple of arrays, to write results into; of the kernel's dtype and the results' full shape.
            threads: how many threads share the batch.
        Returns:
            results: (…, *shape) an output; a tuple where there are several.
        Raises:
            ShapeError: an array of the wrong shape or type; names the input, its shape and the one expected.
        """
        if self._check is not None:
            self._check(arrays)
        dtype = self.dtype
        try:  # the usual call: contiguous arrays of the dtype that hold every state, of shapes that were seen before
            count, wanted = self._plans[tuple([array.shape for array in arrays])]
            if threads > 1 and count >= 2 * self.least:
                return self._any(arrays, out, threads)
            if out is None:
                results = [empty(shape, dtype) for shape in wanted]
            else:
                results = list(out) if type(out) is tuple else [out]
                if [array.shape for array in results] != wanted:
                    return self._any(arrays, out, threads)
            every = [*arrays, *results]
            addresses = [addressof(byte_of(array)) for array in every]  # refuses what is read-only or not contiguous
            for array in every:
                if array.dtype is not dtype or type(array) is not ndarray:  # a masked array hides entries
                    return self._any(arrays, out, threads)
        except (AttributeError, KeyError, TypeError, ValueError, BufferError):
            return self._any(arrays, out, threads)
        if not self._run_separate(count, *addresses):  # an output lies over an input
            return self._any(arrays, out, threads)
        return results[0] if len(results) == 1 else tuple(results)

    @property
    def least(self) -> int:
        """States that are worth a thread: whole tiles, by the time that they are expected to take."""
        return max(1, PART // self._tile) * self.target.width

    def _any(self, arrays: tuple[Any, ...], out: Any, threads: int) -> Any:
        """The general case: any numbers, layouts and broadcasting."""
        ports = self.program.inputs
        if len(arrays) != len(ports):
            raise wrong_count(self.program.name, arrays, ports)
        numbers = [as_numbers(a, self.program.name, p.name, self.dtype) for a, p in zip(arrays, ports, strict=True)]
        lead = common_lead(self.program.name, numbers, self._expected)
        count = math.prod(lead)
        shapes = [shape for _, shape in self._expected]
        blocks = [self._block(array, shape, lead, count) for array, shape in zip(numbers, shapes, strict=True)]
        results, wanted = self._outputs(lead, out, [block for block, _ in blocks])
        self._launch(count, [(address(block), step) for block, step in blocks], results, threads)
        if count and all(a.shape == lead + shape for a, (_, shape) in zip(numbers, self._expected, strict=True)):
            if len(self._plans) >= PLANS:
                self._plans.clear()
            self._plans[tuple([array.shape for array in numbers])] = count, [lead + shape for shape in self._shapes]
        if out is not None:
            for result, target in zip(results, wanted, strict=True):
                if result is not target:
                    target[...] = result
        return wanted[0] if len(wanted) == 1 else tuple(wanted)

    def _block(
        self, array: np.ndarray, shape: tuple[int, ...], lead: tuple[int, ...], count: int
    ) -> tuple[np.ndarray, int]:
        """Contiguous rows of an input and the numbers it moves a tile; one that serves all states is one tile of copies."""
        w, size = self.target.width, math.prod(shape)
        if array.size == size and count > 1:
            return np.ascontiguousarray(np.broadcast_to(array.reshape(1, size), (w, size))), 0
        if array.shape != lead + shape:
            array = np.broadcast_to(array, lead + shape)
        return array if array.flags.c_contiguous else np.ascontiguousarray(array), size * w

    def _outputs(
        self, lead: tuple[int, ...], out: Any, inputs: list[np.ndarray]
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Arrays that the kernel writes, and those that the caller gets: the same where `out` is contiguous and no input."""
        shapes = [lead + port.shape for port in self.program.outputs]
        if out is None:
            results = [empty(shape, self.dtype) for shape in shapes]
            return results, results
        wanted = list(out) if isinstance(out, tuple) else [out]
        if len(wanted) != len(shapes):
            raise wrong_count(f"{self.program.name}: out", wanted, self.program.outputs)
        for array, port, shape in zip(wanted, self.program.outputs, shapes, strict=True):
            if not is_writeable(array, shape, self.dtype):
                raise wrong_array(f"{self.program.name}: out for {port.name}", array, f"writeable {self.dtype} {shape}")
        refuse_shared(self.program, wanted)
        usable = [a.flags.carray and not any(np.may_share_memory(a, block) for block in inputs) for a in wanted]
        return [a if fits else np.empty(a.shape, self.dtype) for a, fits in zip(wanted, usable, strict=True)], wanted

    def _launch(self, count: int, inputs: list[tuple[int, int]], results: list[np.ndarray], threads: int) -> None:
        """Runs the native batch function over all states, in parts of whole tiles where several threads share them.

        Args:
            count: states.   inputs: address of each, and the numbers it moves a tile.   results: where to.   threads: at most.
        """
        w, bytes_ = self.target.width, self.format.bytes
        sizes = [bytes_ * port.size for port in self.program.outputs]
        outputs = [address(result) for result in results]

        def run(first: int, last: int) -> None:
            sources = ((start + bytes_ * step * (first // w), step) for start, step in inputs)
            sinks = (start + first * size for start, size in zip(outputs, sizes, strict=True))
            self._run(last - first, *itertools.chain.from_iterable(sources), *sinks)

        parts = min(threads, count // self.least)
        if parts <= 1:
            run(0, count)
            return
        bounds = [count // w * part // parts * w for part in range(parts)] + [count]
        others = [_pool(parts - 1).submit(run, *part) for part in itertools.pairwise(bounds[:-1])]
        run(bounds[-2], count)  # the last part in this thread, which would only wait
        for other in others:
            other.result()


def batch_module(width: int, program: Program, dtype: str) -> LlvmModule:
    """The module of a program's batch functions, as `llvm` prints it."""
    from armwright.kernels import llvm

    return llvm.batch_module(width, program, dtype)


def _waits(counts: Counter[str]) -> bool:
    """True for a short chain of divisions that wait for each other, such as the pivots of a symmetric solve."""
    return counts["DIV"] + counts["INV"] >= CHAIN and counts.total() <= ROOM


def refuse_shared(program: Program, outputs: list[np.ndarray]) -> None:
    """Refuses outputs that share memory with each other.

    Raises:
        ShapeError: names the two.
    """
    for (i, a), (j, b) in itertools.combinations(enumerate(outputs), 2):
        if np.may_share_memory(a, b) and np.shares_memory(a, b):
            names = f"{program.outputs[i].name} and {program.outputs[j].name}"
            raise ShapeError("share memory", place=f"{program.name}: out for {names}", expected="separate arrays")


def wrong_count(place: str, arrays: Sequence[Any], ports: Sequence[Port]) -> ShapeError:
    """The error of a call with another number of arrays than there are ports."""
    return ShapeError(
        f"{len(arrays)} arrays", place=place, expected=f"{len(ports)}: {', '.join(port.name for port in ports)}"
    )


def wrong_array(place: str, array: Any, expected: str) -> ShapeError:
    """The error of an array that does not fit, which tells its type and shape."""
    if not isinstance(array, np.ndarray):
        return ShapeError(type(array).__name__, place=place, expected=expected)
    faults = ["" if array.flags.writeable else ", read-only"]
    faults += [
        ", masked" if np.ma.isMaskedArray(array) else "",
        ", entries share memory" if _overlaps_itself(array) else "",
    ]
    return ShapeError(f"{array.dtype} {array.shape}{''.join(faults)}", place=place, expected=expected)


def is_writeable(array: Any, shape: tuple[int, ...], dtype: np.dtype) -> bool:
    """True for an array of this shape and dtype whose every entry can be written, and has a place of its own."""
    is_array = isinstance(array, np.ndarray) and not np.ma.isMaskedArray(array)
    fits = is_array and array.shape == shape and array.dtype == dtype and array.flags.writeable
    return fits and not _overlaps_itself(array)


def _overlaps_itself(array: np.ndarray) -> bool:
    """True if entries may lie over each other: an axis whose step is shorter than the axes within it are long."""
    if array.flags.c_contiguous or not array.size:
        return False
    within = array.itemsize
    for step, count in sorted(
        (abs(step), count) for step, count in zip(array.strides, array.shape, strict=True) if count > 1
    ):
        if step < within:
            return True
        within += (count - 1) * step
    return False


@functools.cache
def _pool(threads: int) -> ThreadPoolExecutor:
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(threads, thread_name_prefix="armwright")


if hasattr(os, "register_at_fork"):  # a forked child has none of its parent's threads
    os.register_at_fork(after_in_child=_pool.cache_clear)


def as_numbers(value: Any, place: str, name: str, dtype: np.dtype = DOUBLE.dtype) -> np.ndarray:
    """The value as an array of the dtype, rounded once; infinite where it is beyond the largest number.

    Raises:
        ShapeError: it holds something else than real numbers.
    """
    if type(value) is np.ndarray and value.dtype == dtype:
        return value
    try:
        with np.errstate(over="ignore"):
            return real_numbers(value, dtype)
    except ValueError as error:
        raise ShapeError(str(error), place=f"{place}: {name}", expected="an array of real numbers") from None


def common_lead(place: str, arrays: Sequence[Any], expected: list[tuple[str, tuple[int, ...]]]) -> tuple[int, ...]:
    """The leading axes that all arrays broadcast to.

    Raises:
        ShapeError: an array does not end in its shape, or the leading axes do not fit each other.
    """
    leads = []
    for array, (name, shape) in zip(arrays, expected, strict=True):
        split = array.ndim - len(shape)
        if split < 0 or array.shape[split:] != shape:
            wanted = f"(…, {', '.join(map(str, shape))})"
            wanted += "; .T?" if len(shape) == 1 and array.ndim == 2 and array.shape[0] == shape[0] else ""
            raise ShapeError(f"shape {array.shape}", place=f"{place}: {name}", expected=wanted)
        leads.append(array.shape[:split])
    if all(lead == leads[0] for lead in leads):
        return leads[0]
    try:
        return np.broadcast_shapes(*leads)
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for array, (name, _) in zip(arrays, expected, strict=True))
        raise ShapeError(f"leading axes do not fit together: {shapes}", place=place) from None

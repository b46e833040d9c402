"""Native calls: a kernel as a built-in function of Python, which reads NumPy's arrays and allocates its results natively.

A call of a kernel's Python method takes ten times as long as the computing of one state. The function here does what the method
does for the usual call: exact `ndarray`s of the kernel's dtype, aligned and C-contiguous, whose leading axes are alike. It hands
every other call (lists, other types, broadcasting, `out=`, keywords, large batches) on to the method, so that there is one
general path, with one set of errors.

The function is the LLVM text in `native_text`, compiled once for all kernels; a `CallTable` describes one kernel to it, from the
kernel's first call on, so that a method that is held before is as fast as one that is taken later. It uses
Python's stable ABI, and of NumPy what every compiled extension uses: `PyArray_New` from the table `_ARRAY_API`, and the fields of
an array, which the macros of NumPy's headers read too. That takes some 2 ns an array; `PyObject_GetBuffer`, for which NumPy
describes the array anew in every call, takes 50 to 100. Where Python or NumPy has another layout there is no native call.
"""

from __future__ import annotations

import ctypes
import functools
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from armwright.kernels.batch import Kernel
from armwright.kernels.engine import Engine
from armwright.kernels.memory import LARGE
from armwright.kernels.target import select_target

if TYPE_CHECKING:
    from armwright.kernels.format import Format
    from armwright.kernels.native_text import NativeText

ABI = 0x02000000  # of NumPy 2; `import_array` of an extension compares it as well
VERSION, NEW = 0, 93  # places of PyArray_GetNDArrayCVersion and PyArray_New in `_ARRAY_API`
HEADER = object.__basicsize__  # bytes of what every object begins with; a pointer to its type ends it
PORTS, AXES = 8, 2  # a kernel may have so many inputs and outputs, each with so many axes of its own
HOLD = 20_000  # operations that are done without releasing the GIL: some ten microseconds
FASTCALL_KEYWORDS = 0x0080 | 0x0002  # METH_FASTCALL | METH_KEYWORDS
MODULE = "armwright.kernels.compiled"

FUNCTIONS = (
    *("PyTuple_GetItem", "PyTuple_New", "PyTuple_SetItem", "PyLong_AsVoidPtr", "PyObject_Vectorcall", "Py_DecRef"),
    *("PyEval_SaveThread", "PyEval_RestoreThread"),
)


class ArrayAxes(ctypes.Structure):
    """The axes of one input or output behind the leading ones."""

    _fields_ = (("count", ctypes.c_int64), ("lengths", ctypes.c_int64 * AXES))


class CallTable(ctypes.Structure):
    """All that the native function knows of a kernel; `%Table` in its text.

    Fields:
        entry: the kernel's function over a table of pointers.   general: the Python function for every other call.
        new: PyArray_New.   array_type, dtype, number: NumPy's type of an array, and of its numbers, by object and by number.
        inputs, outputs: how many.   most: states of a native call.   hold: states that are computed while the GIL is held.
        axes: of the inputs, then of the outputs.
    """

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("entry", "general", "new", "array_type", "dtype")),
        *((name, ctypes.c_int64) for name in ("number", "inputs", "outputs", "most", "hold")),
        ("axes", ArrayAxes * PORTS),
    )


class MethodDef(ctypes.Structure):
    """PyMethodDef of Python's C API."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


class NativeCall(tuple):
    """`__self__` of a native function: (address of its table, its arm without native calls, what both keep alive …).

    Python pickles a built-in function as an attribute of its `__self__`; this one is pickled as the arm.
    """

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        return _itself, (self[1],)


class NativeMethod(NamedTuple):
    """A built-in function and the table that says what it calls."""

    function: Callable[..., Any]
    table: CallTable


def _itself(value: Any) -> Any:
    return value


def native_call(arm: Any, general: Callable[..., Any], signature: str, format: Format) -> NativeMethod | None:
    """The built-in function of a kernel that may not be compiled yet, or None where there can be none.

    Args:
        arm: what the function is pickled as an attribute of, and which keeps its kernels.
        general: called with the arguments of every call that is not the usual one, and of all until `enter`.
        signature: such as "(q, qd, out=None)"; name and docstring are those of `general`.   format: of its numbers.
    """
    api, function = numpy_api(), native_function()
    if api is None or function is None:
        return None
    table = CallTable(
        0, id(general), api, id(np.ndarray), id(format.dtype), format.dtype.num, 0, 0, 0, 0, (ArrayAxes * PORTS)()
    )
    name = general.__name__.encode()
    doc = f"{general.__name__}($self, {signature.removeprefix('(')}\n--\n\n{general.__doc__}".encode()
    definition = MethodDef(name, _address(function), FASTCALL_KEYWORDS, doc)
    kept = NativeCall((ctypes.addressof(table), arm, table, general, function, definition, name, doc))
    new = ctypes.pythonapi["PyCFunction_NewEx"]
    new.restype, new.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.py_object, ctypes.py_object)
    return NativeMethod(new(ctypes.addressof(definition), kept, MODULE), table)


def enter(table: CallTable, kernel: Kernel) -> None:
    """From now on usual calls are the kernel's, which must live as long as the table and has no check of its own."""
    program = kernel.program
    ports = (*program.inputs, *program.outputs)
    if len(ports) > PORTS or not program.inputs or not all(len(p.shape) <= AXES and p.size > 0 for p in ports):
        return
    for k, port in enumerate(ports):
        table.axes[k] = ArrayAxes(len(port.shape), tuple(port.shape))
    table.inputs, table.outputs = len(program.inputs), len(program.outputs)
    table.entry = _address(kernel.bound_entry)
    table.hold = HOLD // kernel.operations * kernel.target.width
    # the last: as long as it is 0 every call goes to `general`
    table.most = max(0, min((LARGE - 1) // max(port.size for port in program.outputs), 2 * kernel.least - 1))


def _address(function: Any) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value or 0


@functools.cache
def native_function() -> Any:
    """The function that all native calls share, compiled or from the cache; None where Python lacks something."""
    if sys.implementation.name != "cpython" or ctypes.sizeof(ctypes.c_void_p) != 8:
        return None
    try:
        symbols = {name: _address(getattr(ctypes.pythonapi, name)) for name in FUNCTIONS}
    except AttributeError:
        return None
    return Engine(select_target(), native_text, HEADER, symbols=symbols).function("call")


def native_text(width: int, header: int) -> NativeText:
    """The module of the native function, for objects with a header of so many bytes."""
    from armwright.kernels.native_text import NativeText

    return NativeText(header)


@functools.cache
def numpy_api() -> int | None:
    """The address of PyArray_New; None where NumPy is another version, or an array is laid out otherwise."""
    try:
        capsule = np._core._multiarray_umath._ARRAY_API  # type: ignore[attr-defined]
    except AttributeError:
        return None
    pointer = ctypes.pythonapi["PyCapsule_GetPointer"]
    pointer.restype, pointer.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    api = ctypes.cast(pointer(capsule, None), ctypes.POINTER(ctypes.c_void_p))
    version = ctypes.CFUNCTYPE(ctypes.c_uint)(api[VERSION] or 0)()
    return api[NEW] if version == ABI and _laid_out_as_known() else None


class ArrayFields(ctypes.Structure):
    """An array of NumPy in memory, as far as it is read; `%Array` in the text."""

    _fields_ = (
        ("header", ctypes.c_char * (HEADER - 8)),
        ("type", ctypes.c_void_p),
        ("data", ctypes.c_void_p),
        ("axes", ctypes.c_int),
        ("shape", ctypes.POINTER(ctypes.c_int64)),
        ("strides", ctypes.c_void_p),
        ("base", ctypes.c_void_p),
        ("dtype", ctypes.c_void_p),
        ("flags", ctypes.c_int),
    )


def _laid_out_as_known() -> bool:
    """True if some arrays have their fields at the expected offsets."""
    whole = np.arange(24.0).reshape(2, 3, 4)
    for array in (whole, whole[:, ::2], whole.T, np.zeros((), np.float32), np.zeros(5, np.int16)):
        fields = ArrayFields.from_address(id(array))
        found = fields.type, fields.data, fields.axes, fields.dtype, fields.flags
        if found != (id(type(array)), array.ctypes.data, array.ndim, id(array.dtype), array.flags.num):
            return False
        if tuple(fields.shape[k] for k in range(array.ndim)) != array.shape:
            return False
    return True

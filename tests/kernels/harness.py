"""A tiny just-in-time compiler for the tests: one operation or function over the machine, mapped over arrays."""

import ctypes
import functools
from collections.abc import Callable

import numpy as np
from llvmlite import binding

from armwright.kernels.format import DOUBLE, Format
from armwright.kernels.llvm_machine import LlvmMachine
from armwright.kernels.target import register_libm


class ArrayFunction:
    """body(machine, *values) -> values, compiled for lanes of `width` reals; a call maps it over (n,) arrays.

    The engine lives as long as this object: dropping it unmaps the code.
    """

    def __init__(self, body: Callable, arity: int, width: int, optimise: int = 3, format: Format = DOUBLE):
        self.arity, self.width, self.dtype = arity, width, format.dtype
        self.results, text = module_text(body, arity, width, format)
        self.module, machine = _optimised(text, optimise)
        self.engine = binding.create_mcjit_compiler(self.module, machine)
        self.assembly = machine.emit_assembly(self.module)
        self.engine.finalize_object()
        kind = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * (arity + self.results), ctypes.c_int64)
        self.function = kind(self.engine.get_function_address("mapped"))

    def __call__(self, *arrays):
        arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(a, dtype=self.dtype)) for a in arrays))
        size = arrays[0].size
        padded = -(-size // self.width) * self.width
        inputs = [np.pad(a, (0, padded - size)) for a in arrays]
        outputs = [np.empty(padded, self.dtype) for _ in range(self.results)]
        self.function(*(a.ctypes.data for a in (*inputs, *outputs)), padded)
        outputs = [a[:size] for a in outputs]
        return outputs[0] if self.results == 1 else tuple(outputs)


def module_text(body: Callable, arity: int, width: int, format: Format = DOUBLE) -> tuple[int, str]:
    """The number of results and the module: a loop over tiles of `width` reals around the body."""
    m = LlvmMachine(width, format=format)
    m.begin("loop")
    m.lines.append("  %i = phi i64 [ 0, %entry ], [ %next, %LAST ]")

    def place(pointer: str) -> str:
        return m.emit(f"getelementptr {format.real}, ptr {pointer}, i64 %i")

    values = [m.emit(f"load {m.real}, ptr {place(f'%in{k}')}, align {format.bytes}") for k in range(arity)]
    results = body(m, *values)
    results = results if isinstance(results, tuple) else (results,)
    for k, value in enumerate(results):
        m.lines.append(f"  store {m.real} {value}, ptr {place(f'%out{k}')}, align {format.bytes}")
    parameters = [f"ptr noalias %in{k}" for k in range(arity)] + [f"ptr noalias %out{k}" for k in range(len(results))]
    lines = [
        *sorted(m.declarations),
        *m.definitions.values(),
        f"define void @mapped({', '.join(parameters)}, i64 %n) {{",
        "entry:",
        "  br label %loop",
        *m.lines,
        f"  %next = add i64 %i, {width}",
        "  %more = icmp slt i64 %next, %n",
        "  br i1 %more, label %loop, label %done",
        "done:",
        "  ret void",
        "}",
    ]
    return len(results), "\n".join(lines).replace("%LAST", f"%{m.block}")


@functools.cache
def _initialise() -> None:
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    register_libm()


def _optimised(text: str, level: int):
    """The module after LLVM's passes, and the target machine of this computer with its full vector width."""
    _initialise()
    features = binding.get_host_cpu_features()
    features["prefer-256-bit"] = False
    machine = binding.Target.from_default_triple().create_target_machine(
        cpu=binding.get_host_cpu_name(), features=features.flatten(), opt=level, jit=True
    )
    module = binding.parse_assembly(text)
    module.triple = machine.triple
    module.data_layout = str(machine.target_data)
    module.verify()
    options = binding.create_pipeline_tuning_options(speed_level=level)
    builder = binding.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return module, machine


#: Whether NumPy's long doubles carry 64 bits of mantissa, enough to measure errors in ulp (Linux on x86).
EXTENDED = np.finfo(np.longdouble).nmant >= 63


def ulp_error(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """|found - truth| in units of the last place of the truth, which is in higher precision; inf for a wrong NaN."""
    about = np.finfo(found.dtype)
    with np.errstate(all="ignore"):
        nearest = truth.astype(found.dtype)
    magnitude = np.minimum(np.abs(nearest), about.max)
    unit = np.spacing(magnitude)
    # A truth just below a power of two was rounded up to it: its own unit is the smaller one below.
    at_power = (np.frexp(magnitude)[0] == 0.5) & (np.abs(truth) < magnitude) & (magnitude > about.tiny)
    with np.errstate(all="ignore"):
        error = np.abs(found.astype(truth.dtype) - truth) / np.where(at_power, unit / 2, unit).astype(truth.dtype)
    same = (found == nearest) | (np.isnan(found) & np.isnan(nearest))
    error = np.where(np.isnan(error), np.where(same, 0.0, np.inf), error)
    return np.where(same, np.minimum(error, 0.5), error).astype(float)


def same_bits(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """True where two arrays of one format agree to the bit; all NaNs are equal."""
    integer = {8: np.int64, 4: np.int32}[a.dtype.itemsize]
    return (a.view(integer) == b.view(integer)) | (np.isnan(a) & np.isnan(b))

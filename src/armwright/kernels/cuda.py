"""Program → CUDA C: one thread a state, or one thread a whole simulated trajectory; compiled by NVRTC through CuPy.

Arrays are those of the other kernels: row-major, one row a state. The text is the sequence of IEEE operations that LLVM and C
are given; NVRTC gets --fmad=false, so that only what is written as fma() is fused. Where libm is called (angles beyond
2^20 rad, and the few operations without a polynomial of ours) it is CUDA's own, which may differ in the last place.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armwright.errors import ModelError, ShapeError
from armwright.kernels.batch import common_lead, wrong_count
from armwright.kernels.c import Unit
from armwright.kernels.c_syntax import Dialect, identifier
from armwright.program import Program

#: CUDA C as a dialect of C99: other words for integers, bits and functions of the device.
CUDA = Dialect(
    integer="unsigned long long",
    literal="0x{:016x}ULL",
    function="static __device__ ",
    never_inlined="static __device__ __noinline__ ",
    infinity="__longlong_as_double(0x7ff0000000000000LL)",
    nan="__longlong_as_double(0x7ff8000000000000LL)",
    guarded=False,
)

#: What the machine calls for the bits of a double; NVRTC includes no headers, and these need none.
BITS = """\
static __device__ unsigned long long {prefix}bits_of(double x)
{{
    return (unsigned long long)__double_as_longlong(x);
}}

static __device__ double {prefix}from_bits(unsigned long long i)
{{
    return __longlong_as_double((long long)i);
}}
"""

OPTIONS = ("--fmad=false", "--std=c++14")
THREADS = 128  # a block

_THREAD = """\
    const long long lane = (long long)blockIdx.x * blockDim.x + threadIdx.x;
    if (lane >= count) {
        return;
    }"""


def cuda_source(program: Program) -> str:
    """The program as a CUDA kernel `name(count, in0, step0, in1, step1, …, out0, out1, …)`, one thread a state.

    Args:
        program: what is printed.
    Returns:
        text: a file for NVRTC or nvcc with --fmad=false. A step is the number of doubles from a state's row of an input to
            the next: the row's size, or 0 for one row that serves all states.
    """
    unit = Unit(CUDA, f"{identifier(program.name)}_")
    state = unit.add_function(program, _state_function(program))
    inputs = [f"const double *in{k}, long long step{k}" for k in range(len(program.inputs))]
    outputs = [f"double *out{k}" for k in range(len(program.outputs))]
    rows = [f"in{k} + lane * step{k}" for k in range(len(program.inputs))]
    rows += [f"out{k} + lane * {port.size}" for k, port in enumerate(program.outputs)]
    lines = [
        f'extern "C" __global__ void {identifier(program.name)}(long long count, {", ".join([*inputs, *outputs])})',
        *("{", _THREAD, f"    {state}({', '.join(rows)});", "}"),
    ]
    return _text(unit, lines)


def cuda_trajectory_source(step: Program) -> str:
    """A CUDA kernel that takes every lane through `ticks` steps, one thread a lane, commands held.

    In NumPy, for one lane:

        record[0] = x
        for k in range(ticks):
            new = step(x, u, h)
            if frozen < 0:  x, frozen = (new, frozen) if isfinite(new).all() else (x, k)
            if (k + 1) % every == 0:  record[(k + 1) // every] = x

    which is the loop of the simulator for constant commands, to the bit.

    Args:
        step: (x, u, h) → x⁺, as the simulator traces it.
    Returns:
        text: the kernel `name_trajectory(count, ticks, every, h, x, x_step, u, u_step, record, frozen)`; record is
            (ticks // every + 1, count, nx), frozen (count,) the tick at which a lane diverged, or -1.
    """
    _check_step(step)
    unit = Unit(CUDA, f"{identifier(step.name)}_")
    function = unit.add_function(step, _state_function(step))
    n = step.inputs[0].size
    lines = [
        f'extern "C" __global__ void {identifier(step.name)}_trajectory(long long count, long long ticks, long long every,',
        "    double h, const double *x0, long long x0_step, const double *u, long long u_step, double *record,",
        "    double *frozen)",
        *("{", _THREAD, f"    double x[{n}], next[{n}];", "    double stopped = -1.0;"),
        *_each(n, f"x[e] = x0[lane * x0_step + e];\n        record[lane * {n} + e] = x[e];"),
        "    for (long long k = 0; k < ticks; k++) {",
        "        if (stopped < 0.0) {",
        f"            {function}(x, u + lane * u_step, &h, next);",
        "            double sum = 0.0; /* of 0 x, which is NaN where x is not finite */",
        *_each(n, "sum = fma(next[e], 0.0, sum);", "            "),
        "            if (sum == 0.0) {",
        *_each(n, "x[e] = next[e];", "                "),
        *("            } else {", "                stopped = (double)k;", "            }", "        }"),
        "        if ((k + 1) % every == 0) {",
        *_each(n, f"record[((k + 1) / every * count + lane) * {n} + e] = x[e];", "            "),
        *("        }", "    }", "    frozen[lane] = stopped;", "}"),
    ]
    return _text(unit, lines)


def _each(n: int, statement: str, indent: str = "    ") -> list[str]:
    return [f"{indent}for (int e = 0; e < {n}; e++) {{", f"{indent}    {statement}", f"{indent}}}"]


def _state_function(program: Program) -> str:
    return f"{identifier(program.name)}_state"


def _check_step(step: Program) -> None:
    sizes = [port.size for port in step.inputs]
    assert len(sizes) == 3, sizes
    assert sizes[2] == 1, sizes
    assert [port.size for port in step.outputs] == sizes[:1]


def _text(unit: Unit, kernel: list[str]) -> str:
    helpers = [BITS.format(prefix=unit.prefix)] if unit.uses("bits_of") or unit.uses("from_bits") else []
    return "\n".join([*helpers, *(f"{text}\n" for text in unit.functions.values()), *kernel, ""])


class CudaKernel:
    """A program on the GPU: `kernel(a, b, …)` takes CuPy arrays (…, *shape) and broadcasts over their leading axes."""

    def __init__(self, program: Program):
        """Compiles the program.

        Raises:
            ModelError: CuPy is not installed, or there is no GPU.
        """
        self.program = program
        self._function = _compiled(cuda_source(program), identifier(program.name))

    def __call__(self, *arrays: Any) -> Any:
        """The program's outputs for all states.

        Args:
            arrays: one an input, (…, *shape), CuPy or NumPy; leading axes are broadcast against each other.
        Returns:
            results: CuPy arrays (…, *shape); a tuple where there are several. They may still be in the making.
        Raises:
            ShapeError: an array of the wrong shape.
        """
        cupy = _cupy()
        ports = self.program.inputs
        if len(arrays) != len(ports):
            raise wrong_count(self.program.name, arrays, ports)
        inputs = [cupy.asarray(array, dtype=np.float64) for array in arrays]
        lead = common_lead(self.program.name, inputs, [(port.name, port.shape) for port in ports])
        count = math.prod(lead)
        values: list[Any] = [np.int64(count)]
        for array, port in zip(inputs, ports, strict=True):
            if array.size == port.size:
                values += [cupy.ascontiguousarray(array), np.int64(0)]
            else:
                rows = cupy.broadcast_to(array, lead + port.shape)
                values += [cupy.ascontiguousarray(rows), np.int64(port.size)]
        results = [cupy.empty(lead + port.shape) for port in self.program.outputs]
        if count:
            self._function((-(-count // THREADS),), (THREADS,), (*values, *results))
        return results[0] if len(results) == 1 else tuple(results)


class CudaTrajectory:
    """A step program on the GPU: whole trajectories with constant commands, one thread a lane."""

    def __init__(self, step: Program):
        """Compiles the loop around the step.

        Raises:
            ModelError: CuPy is not installed, or there is no GPU.
        """
        self.step = step
        self._function = _compiled(cuda_trajectory_source(step), f"{identifier(step.name)}_trajectory")

    def __call__(self, x: Any, u: Any, h: float, ticks: int, every: int = 1) -> tuple[Any, Any]:
        """The states of every lane.

        Args:
            x: (lanes, nx) initial states.   u: (nu,) or (lanes, nu) commands, held.
            h: [s] the step.   ticks: how many.   every: a row is recorded after every so many.
        Returns:
            record: CuPy (ticks // every + 1, lanes, nx), row 0 the initial states.
            frozen: CuPy (lanes,) the tick at which a lane diverged, or -1.
        Raises:
            ShapeError: x or u of the wrong shape.
        """
        cupy = _cupy()
        nx, nu = self.step.inputs[0].size, self.step.inputs[1].size
        x, u = cupy.asarray(x, dtype=np.float64), cupy.asarray(u, dtype=np.float64)
        if x.ndim != 2 or x.shape[1] != nx or u.shape not in ((nu,), (len(x), nu)):
            expected = f"(lanes, {nx}) and ({nu},) or (lanes, {nu})"
            raise ShapeError(f"shapes {x.shape} and {u.shape}", place="trajectory: x and u", expected=expected)
        lanes = len(x)
        record, frozen = cupy.empty((ticks // every + 1, lanes, nx)), cupy.empty(lanes)
        sizes = (np.int64(lanes), np.int64(ticks), np.int64(every), np.float64(h))
        rows = (cupy.ascontiguousarray(x), np.int64(nx), cupy.ascontiguousarray(u), np.int64(nu if u.ndim == 2 else 0))
        if lanes:
            self._function((-(-lanes // THREADS),), (THREADS,), (*sizes, *rows, record, frozen))
        return record, frozen


def _compiled(text: str, name: str) -> Any:
    return _cupy().RawModule(code=text, options=OPTIONS).get_function(name)


def _cupy() -> Any:
    try:
        import cupy  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ModelError("CuPy is not installed: pip install cupy-cuda12x", place="CUDA kernels") from None
    try:
        devices = cupy.cuda.runtime.getDeviceCount()
    except cupy.cuda.runtime.CUDARuntimeError as error:
        raise ModelError(str(error), place="CUDA kernels", expected="an NVIDIA GPU with its driver") from None
    if devices == 0:
        raise ModelError("there is none", place="CUDA kernels", expected="an NVIDIA GPU")
    return cupy

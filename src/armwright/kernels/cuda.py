"""Program → CUDA C: one thread a state. `cuda_device` compiles it, by NVRTC.

Arrays are those of the other kernels: row-major, one row a state. The text is the sequence of IEEE operations that LLVM and C
are given; NVRTC gets --fmad=false, so that only what is written as fma() is fused. Where libm is called it is CUDA's own, which
may differ in the last place: for angles beyond 2^20 rad, in float 2^17, and the few operations without a polynomial of ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from armwright.kernels.c import Unit
from armwright.kernels.c_syntax import Dialect, identifier
from armwright.kernels.format import DOUBLE, SINGLE, Format
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
CUDA_FLOAT = replace(
    CUDA,
    format=SINGLE,
    integer="unsigned int",
    literal="0x{:08x}U",
    infinity="__int_as_float(0x7f800000)",
    nan="__int_as_float(0x7fc00000)",
)
DIALECTS = {dialect.format: dialect for dialect in (CUDA, CUDA_FLOAT)}

#: What the machine calls for the bits of a number; NVRTC includes no headers, and these need none.
BITS = """\
static __device__ {integer} {prefix}bits_of({real} x)
{{
    return ({integer}){to_bits}(x);
}}

static __device__ {real} {prefix}from_bits({integer} i)
{{
    return {from_bits}(({signed})i);
}}
"""
_WORDS = {  # of BITS
    DOUBLE: {"to_bits": "__double_as_longlong", "from_bits": "__longlong_as_double", "signed": "long long"},
    SINGLE: {"to_bits": "__float_as_int", "from_bits": "__int_as_float", "signed": "int"},
}

THREADS = 128  # a block
WARP = 32  # threads that run in step
COLUMNS = 16  # of a row that pass through a warp's tile at once; a tile's rows are one longer, which keeps banks apart
UNROLLED = 64  # numbers in a row that can stay in registers; those of longer ones are copied in a loop

# A warp's 32 rows lie in one piece of memory. It reads and writes them number after number, so that neighbouring threads touch
# neighbouring numbers, and a tile in shared memory hands each thread its own row.
_TILES = """\
template <int size, int width>
static __device__ __forceinline__ void load_columns(const {real} *rows, int first, int count, {real} *tile, {real} *own)
{{
    const int lane = threadIdx.x % {warp}, row = lane < count ? lane : 0; /* threads without a state repeat the first */
    #pragma unroll
    for (int k = lane; k < {warp} * width; k += {warp}) {{
        if (k / width < count) {{
            tile[k / width * {pitch} + k % width] = rows[k / width * size + first + k % width];
        }}
    }}
    __syncwarp();
    #pragma unroll
    for (int e = 0; e < width; e++) {{
        own[first + e] = tile[row * {pitch} + e];
    }}
    __syncwarp();
}}

template <int size, int width>
static __device__ __forceinline__ void store_columns({real} *rows, int first, int count, {real} *tile, const {real} *own)
{{
    const int lane = threadIdx.x % {warp};
    #pragma unroll
    for (int e = 0; e < width; e++) {{
        tile[lane * {pitch} + e] = own[first + e];
    }}
    __syncwarp();
    #pragma unroll
    for (int k = lane; k < {warp} * width; k += {warp}) {{
        if (k / width < count) {{
            rows[k / width * size + first + k % width] = tile[k / width * {pitch} + k % width];
        }}
    }}
    __syncwarp();
}}
"""


def cuda_source(program: Program, format: Format = DOUBLE) -> str:
    """The program as a CUDA kernel `name(count, in0, step0, in1, step1, …, out0, out1, …)`, one thread a state.

    It is launched in blocks of `THREADS`. Inputs and outputs without entries are left out of the parameters.

    Args:
        program: what is printed.   format: of its numbers.
    Returns:
        text: a file for NVRTC or nvcc with --fmad=false. A step is the number of entries from a state's row of an input to
            the next: the row's size, or 0 for one row that serves all states.
    """
    dialect = DIALECTS[format]
    real, name = dialect.real, identifier(program.name)
    unit = Unit(dialect, f"{name}_")
    state = unit.add_function(program, _state_function(program))
    inputs = [(k, port.size) for k, port in enumerate(program.inputs) if port.size]
    outputs = [(k, port.size) for k, port in enumerate(program.outputs) if port.size]
    parameters = [f"const {real} *in{k}, long long step{k}" for k, _ in inputs] + [
        f"{real} *out{k}" for k, _ in outputs
    ]
    own = [f"own{k}" for k, _ in inputs] + [f"result{k}" for k, _ in outputs]
    sizes = [size for _, size in (*inputs, *outputs)]
    lines = [
        f'extern "C" __global__ void __launch_bounds__({THREADS}) {name}(long long count, {", ".join(parameters)})',
        "{",
        f"    __shared__ {real} tiles[{THREADS // WARP}][{WARP * (COLUMNS + 1)}];",
        f"    {real} *tile = tiles[threadIdx.x / {WARP}];",
        f"    const long long first = ((long long)blockIdx.x * {THREADS} + threadIdx.x) / {WARP} * {WARP}; /* of the warp */",
        "    if (first >= count) {",
        "        return;",
        "    }",
        f"    const int rows = count - first < {WARP} ? (int)(count - first) : {WARP};",
        *(f"    {real} {array}[{size}];" for array, size in zip(own, sizes, strict=True)),
    ]
    for k, size in inputs:
        lines += [f"    if (step{k} == 0) {{", "        #pragma unroll", f"        for (int e = 0; e < {size}; e++) {{"]
        lines += [f"            own{k}[e] = in{k}[e];", "        }", "    } else {"]
        lines += [f"    {line}" for line in _columns("load", size, f"in{k} + first * {size}", f"own{k}")]
        lines += ["    }"]
    lines += [f"    {state}({', '.join(own)});"]
    for k, size in outputs:
        lines += _columns("store", size, f"out{k} + first * {size}", f"result{k}")
    tiles = _TILES.format(real=real, warp=WARP, pitch=COLUMNS + 1)
    return cuda_text(unit, [tiles, *lines, "}"])


def _columns(verb: str, size: int, rows: str, own: str) -> list[str]:
    """Calls that load or store a port's rows, up to `COLUMNS` of their columns at a time."""
    whole, rest = divmod(size, COLUMNS)

    def call(width: int, first: object) -> str:
        return f"{verb}_columns<{size}, {width}>({rows}, {first}, rows, tile, {own});"

    if size <= UNROLLED:
        lines = [f"    {call(COLUMNS, k * COLUMNS)}" for k in range(whole)]
    else:
        lines = [f"    for (int column = 0; column < {whole * COLUMNS}; column += {COLUMNS}) {{"]
        lines += [f"        {call(COLUMNS, 'column')}", "    }"]
    return lines + [f"    {call(rest, whole * COLUMNS)}"] * (rest > 0)


def _state_function(program: Program) -> str:
    return f"{identifier(program.name)}_state"


def cuda_text(unit: Unit, kernel: Sequence[str], head: Sequence[str] = ()) -> str:
    """The file of a unit: what its functions need before them, the functions, the kernel."""
    uses = unit.uses("bits_of") or unit.uses("from_bits")
    helpers = [bits(unit.dialect, unit.prefix)] if uses else []
    return "\n".join([*head, *helpers, *(f"{text}\n" for text in unit.functions.values()), *kernel, ""])


def bits(dialect: Dialect, prefix: str) -> str:
    """The functions between numbers and their bits."""
    return BITS.format(prefix=prefix, integer=dialect.integer, real=dialect.real, **_WORDS[dialect.format])

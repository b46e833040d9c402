"""The CUDA text: C++ that a CPU can run with a few words defined, where it has the bits of the compiled kernels."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.kernels.c import Unit
from armwright.kernels.cuda import CUDA, bits, cuda_source
from armwright.kernels.format import DOUBLE, SINGLE
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.program import Program, trace
from armwright.program.operations import OPERATIONS
from kernels.fake_cuda import on_the_cpu
from kernels.harness import same_bits
from kernels.test_operations import COMPUTED, arguments, compiled
from physics.arms import arm

KERNELS = ("inverse_dynamics", "forward_dynamics", "mass_matrix", "forward_kinematics")
BLOCK = 128  # threads


def pointer(array: np.ndarray) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


def grid(count: int, *, backwards: bool = False) -> list:
    return [ctypes.c_longlong(-(-count // BLOCK)), ctypes.c_longlong(BLOCK), ctypes.c_int(backwards)]


def run(folder: Path, program: Program, inputs: Sequence[np.ndarray], count: int, format=DOUBLE) -> list[np.ndarray]:
    """A program's kernel on the CPU, in both orders of threads; an input of one row serves all states."""
    return launched(on_the_cpu(folder, cuda_source(program, format), program.name), program, inputs, count)


def launched(library: ctypes.CDLL, program: Program, inputs: Sequence[np.ndarray], count: int) -> list[np.ndarray]:
    given: list = [ctypes.c_longlong(count)]
    for array, port in zip(inputs, program.inputs, strict=True):
        given += [pointer(array), ctypes.c_longlong(0 if array.shape == port.shape else port.size)]
    found = []
    for backwards in (False, True):
        outputs = [np.full((count + 1, *port.shape), np.nan, inputs[0].dtype) for port in program.outputs]
        launch = getattr(library, f"{program.name}_blocks")
        launch(*grid(count, backwards=backwards), *given, *(pointer(array) for array in outputs))
        assert all(np.isnan(array[-1]).all() for array in outputs)  # nothing behind the last state
        found.append([array[:-1] for array in outputs])
    assert all(same_bits(a, b).all() for a, b in zip(*found, strict=True))
    return found[0]


@pytest.mark.sample(4)
@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("name", ["puma560", "workshop"])
def test_kernels_have_the_bits_of_the_compiled_ones(tmp_path, name, kernel):
    program = trace_kernel(arm(name), SIGNATURES[kernel])
    inputs = [np.random.default_rng(k).normal(size=(1001, *port.shape)) for k, port in enumerate(program.inputs)]
    inputs[0][-1] = np.nan
    found = run(tmp_path, program, inputs, 1001)
    expected = getattr(aw.compile(arm(name)), kernel)(*inputs)
    assert same_bits(found[0], np.ascontiguousarray(expected)).all()


@pytest.mark.parametrize("kernel", ["inverse_dynamics", "mass_matrix"])
def test_single_precision_has_its_bits(tmp_path, kernel):
    program = trace_kernel(arm("puma560"), SIGNATURES[kernel])
    inputs = [np.random.default_rng(k).normal(size=(77, *p.shape)).astype("f") for k, p in enumerate(program.inputs)]
    expected = getattr(aw.compile(arm("puma560"), dtype="float32"), kernel)(*inputs)
    assert same_bits(run(tmp_path, program, inputs, 77, SINGLE)[0], expected).all()


@pytest.mark.parametrize("width", [1, 15, 16, 17, 64, 65, 100])
def test_rows_of_any_length_reach_their_state(tmp_path, width):
    """Columns that fill a tile or not, warps that have all their states or not."""
    program = trace("doubled", lambda x: x + x, {"x": (width,)})
    library = on_the_cpu(tmp_path, cuda_source(program), "doubled")
    for count in (1, 31, 32, 33, 128, 129):
        x = np.random.default_rng(count).normal(size=(count, width))
        assert np.array_equal(launched(library, program, [x], count)[0], 2 * x)


def test_one_row_serves_all_states(tmp_path):
    model = arm("puma560")
    program = trace_kernel(model, SIGNATURES["inverse_dynamics"])
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 40, 6))
    found = run(tmp_path, program, [q, qd[0].copy(), qdd], 40)
    assert np.array_equal(found[0], aw.compile(model).inverse_dynamics(q, qd[0], qdd))


def test_every_operation_has_llvm_s_bits(tmp_path):
    dialect = CUDA
    unit, heads = Unit(dialect, "t_"), {}
    for name in COMPUTED:
        m, values = unit.machine(), ["a[i]", "b[i]", "c[i]"][: OPERATIONS[name].arity]
        body = m.text([f"r[i] = {unit.lower(m, name, *values)};"])
        heads[f"op_{name}"] = ", ".join(["long long count", *(f"const double *{v[0]}" for v in values), "double *r"])
        loop = "    const long long i = blockIdx.x * blockDim.x + threadIdx.x;\n    if (i >= count) {\n        return;\n    }\n"
        unit.functions[f"op_{name}"] = (
            f'extern "C" __global__ void op_{name}({heads[f"op_{name}"]})\n{{\n{loop}{body}\n}}'
        )
    library = on_the_cpu(tmp_path, "\n\n".join([bits(dialect, "t_"), *unit.functions.values()]), *heads, strict=())
    for name in COMPUTED:
        values = [np.ascontiguousarray(array) for array in arguments(OPERATIONS[name])]
        found = np.empty_like(values[0])
        count = ctypes.c_longlong(len(found))
        getattr(library, f"op_{name}_blocks")(*grid(len(found)), count, *map(pointer, values), pointer(found))
        assert same_bits(found, compiled(name, 8)(*values)).all(), name


@pytest.mark.parametrize("name", ["panda", "workshop"])
def test_the_text_is_whole(name):
    """Braces close, no C99 words are left, every function is the device's, and NVRTC needs no header."""
    for kernel in KERNELS:
        text = cuda_source(trace_kernel(arm(name), SIGNATURES[kernel]))
        for left, right in ("{}", "()", "[]"):
            assert text.count(left) == text.count(right)
        assert not re.search(r"uint64_t|UINT64_C|#include|INFINITY|NAN|memcpy|\bfloat\b", text)
        assert re.findall(r"^static (?!__device__)", text, re.MULTILINE) == []
        assert text.count('extern "C" __global__ void') == 1
        assert text == cuda_source(trace_kernel(arm(name), SIGNATURES[kernel]))

"""The CUDA text: C++ that a CPU can run with a few words defined, where it has the bits of the compiled kernels."""

from __future__ import annotations

import ctypes
import importlib.util
import re
import sys
import types
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError, ShapeError
from armwright.kernels.c import Unit
from armwright.kernels.cuda import BITS, CUDA, CudaKernel, CudaTrajectory, cuda_source, cuda_trajectory_source
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.program import Program, trace
from armwright.program.operations import OPERATIONS
from armwright.simulation.loop.compiled import compile_loop
from kernels.c_compilers import FMA, build, compiler
from kernels.harness import same_bits
from kernels.test_operations import COMPUTED, arguments, compiled
from physics.arms import arm

SHIM = Path(__file__).with_name("cuda_shim.h")
KERNELS = ("inverse_dynamics", "forward_dynamics", "mass_matrix", "forward_kinematics")


def on_the_cpu(folder: Path, text: str, parameters: dict[str, str], *strict: str) -> ctypes.CDLL:
    """The text through g++, with a function `name_blocks` beside each kernel that runs its threads one by one."""
    drivers = []
    for name, listed in parameters.items():
        words = [word.split()[-1].lstrip("*") for word in listed.split(",")]
        drivers.append(
            f'extern "C" void {name}_blocks({listed})\n{{\n    blockDim.x = 32;\n'
            "    for (blockIdx.x = 0; blockIdx.x * 32 < count; blockIdx.x++) {\n"
            "        for (threadIdx.x = 0; threadIdx.x < 32; threadIdx.x++) {\n"
            f"            {name}({', '.join(words)});\n        }}\n    }}\n}}\n"
        )
    (folder / "kernel.cpp").write_text("\n".join([text, *drivers]), encoding="ascii")
    flags = ("-std=c++14", "-O2", *FMA, "-ffp-contract=off", *strict, "-include", SHIM)
    build([compiler("g++"), *flags, "-shared", "-fPIC", folder / "kernel.cpp", "-o", folder / "kernel.so"])
    return ctypes.CDLL(str(folder / "kernel.so"))


def parameters_of(text: str, name: str) -> str:
    match = re.search(rf'extern "C" __global__ void {name}\(([^)]*)\)', text)
    assert match is not None
    return " ".join(match[1].split())


def pointer(array: np.ndarray) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


def run(folder: Path, program: Program, inputs: Sequence[np.ndarray], count: int) -> list[np.ndarray]:
    """A program's kernel on the CPU; an input of one row serves all states."""
    text = cuda_source(program)
    library = on_the_cpu(folder, text, {program.name: parameters_of(text, program.name)}, "-Wall", "-Wextra", "-Werror")
    given: list = [ctypes.c_longlong(count)]
    for array, port in zip(inputs, program.inputs, strict=True):
        given += [pointer(array), ctypes.c_longlong(0 if array.shape == port.shape else port.size)]
    outputs = [np.full((count, *port.shape), np.nan) for port in program.outputs]
    getattr(library, f"{program.name}_blocks")(*given, *(pointer(array) for array in outputs))
    return outputs


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


def test_one_row_serves_all_states(tmp_path):
    model = arm("puma560")
    program = trace_kernel(model, SIGNATURES["inverse_dynamics"])
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 40, 6))
    found = run(tmp_path, program, [q, qd[0].copy(), qdd], 40)
    assert np.array_equal(found[0], aw.compile(model).inverse_dynamics(q, qd[0], qdd))


@pytest.mark.parametrize("name", ["cmu-dd", "two-link"])
def test_trajectories_have_the_bits_of_the_simulator(tmp_path, name):
    """RK3 with constant commands: one thread a lane, a row every fifth step."""
    model, lanes, ticks, every = arm(name), 9, 50, 5
    u = np.random.default_rng(0).normal(size=(lanes, model.n))
    q0 = np.random.default_rng(1).normal(size=(lanes, model.n))
    scenario = aw.Scenario(
        model, command=aw.Batch(u), duration=ticks * 1e-3, start=aw.Batch(q0), recording=aw.Recording(every=every),
        solver=aw.Solver("rk3"),
    )  # fmt: skip
    simulator = compile_loop(model)
    expected = aw.simulate(scenario, loop=simulator)
    record, frozen = trajectory(tmp_path, simulator.step, np.hstack([q0, 0 * q0]), u, 1e-3, ticks, every)
    assert np.array_equal(record[:, :, : model.n].transpose(1, 0, 2), expected["q"])
    assert np.array_equal(record[:, :, model.n :].transpose(1, 0, 2), expected["qd"])
    assert (frozen == -1.0).all()


def trajectory(folder, step, x, u, h, ticks, every):
    text = cuda_trajectory_source(step)
    name = f"{step.name}_trajectory"
    library = on_the_cpu(folder, text, {name: parameters_of(text, name)}, "-Wall", "-Wextra", "-Werror")
    record, frozen = np.full((ticks // every + 1, *x.shape), np.nan), np.empty(len(x))
    sizes = (ctypes.c_longlong(len(x)), ctypes.c_longlong(ticks), ctypes.c_longlong(every), ctypes.c_double(h))
    rows = (pointer(x), ctypes.c_longlong(x.shape[1]), pointer(u), ctypes.c_longlong(u.shape[1] if u.ndim == 2 else 0))
    getattr(library, f"{name}_blocks")(*sizes, *rows, pointer(record), pointer(frozen))
    return record, frozen


def test_a_lane_that_leaves_the_finite_numbers_is_frozen(tmp_path):
    step = trace("step", lambda x, u, h: x * x + u * h, {"x": (1,), "u": (1,), "h": ()}, ("x_next",))
    x = np.array([[0.5], [1e100], [np.inf], [3.0]])
    record, frozen = trajectory(tmp_path, step, x, np.zeros(1), 1.0, 12, 4)
    assert frozen.tolist() == [-1.0, 1.0, 0.0, 9.0]
    assert record[:, 1, 0].tolist() == [1e100, 1e200, 1e200, 1e200]
    assert record[-1, 0, 0] == 0.5**4096


def test_every_operation_has_llvm_s_bits(tmp_path):
    unit, heads = Unit(CUDA, "t_"), {}
    for name in COMPUTED:
        m, values = unit.machine(), ["a[i]", "b[i]", "c[i]"][: OPERATIONS[name].arity]
        body = m.text([f"r[i] = {unit.lower(m, name, *values)};"])
        heads[f"op_{name}"] = ", ".join(["long long count", *(f"const double *{v[0]}" for v in values), "double *r"])
        loop = "    const long long i = blockIdx.x * 32 + threadIdx.x;\n    if (i >= count) {\n        return;\n    }\n"
        unit.functions[f"op_{name}"] = (
            f'extern "C" __global__ void op_{name}({heads[f"op_{name}"]})\n{{\n{loop}{body}\n}}'
        )
    library = on_the_cpu(tmp_path, "\n\n".join([BITS.format(prefix="t_"), *unit.functions.values()]), heads)
    for name in COMPUTED:
        values = [np.ascontiguousarray(array) for array in arguments(OPERATIONS[name])]
        found = np.empty_like(values[0])
        getattr(library, f"op_{name}_blocks")(ctypes.c_longlong(len(found)), *map(pointer, values), pointer(found))
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


@pytest.mark.skipif(importlib.util.find_spec("cupy") is not None, reason="CuPy is installed")
def test_without_cupy_it_says_what_to_install():
    program = trace("f", lambda x: x + 1.0, {"x": ()})
    with pytest.raises(ModelError, match="pip install cupy"):
        CudaKernel(program)
    step = trace("step", lambda x, u, h: x + u * h, {"x": (1,), "u": (1,), "h": ()}, ("x_next",))
    with pytest.raises(ModelError, match="pip install cupy"):
        CudaTrajectory(step)


class _NoDevice(Exception):
    pass


def fake_cupy(monkeypatch, devices: int | None, launched: list | None = None) -> None:
    """A CuPy of NumPy arrays whose kernels do nothing but remember how they were launched."""

    def count() -> int:
        if devices is None:
            raise _NoDevice("cudaErrorNoDevice: no CUDA-capable device is detected")
        return devices

    module = types.ModuleType("cupy")
    runtime = types.SimpleNamespace(getDeviceCount=count, CUDARuntimeError=_NoDevice)
    kernel = types.SimpleNamespace(get_function=lambda name: lambda *launch: launched.append((name, *launch)))
    words = {name: getattr(np, name) for name in ("asarray", "empty", "broadcast_to", "ascontiguousarray")}
    words |= {"cuda": types.SimpleNamespace(runtime=runtime), "RawModule": lambda **_: kernel}
    for name, value in words.items():
        setattr(module, name, value)
    monkeypatch.setitem(sys.modules, "cupy", module)


@pytest.mark.parametrize(("devices", "message"), [(0, "there is none"), (None, "no CUDA-capable device")])
def test_without_a_gpu_it_says_so(monkeypatch, devices, message):
    fake_cupy(monkeypatch, devices)
    with pytest.raises(ModelError, match=message):
        CudaKernel(trace("f", lambda x: x + 1.0, {"x": ()}))


def test_how_kernels_are_launched(monkeypatch):
    """Blocks for all states, rows that serve all with a step of 0, results of the broadcast shape."""
    launched: list = []
    fake_cupy(monkeypatch, 1, launched)
    kernel = CudaKernel(trace_kernel(arm("puma560"), SIGNATURES["bias_torques"]))
    assert kernel(np.zeros((5, 40, 6)), np.zeros(6)).shape == (5, 40, 6)
    name, blocks, threads, (count, q, q_step, _, qd_step, _) = launched.pop()
    assert (name, blocks, threads, count, q.shape, q_step, qd_step) == (
        "bias_torques",
        (2,),
        (128,),
        200,
        (5, 40, 6),
        6,
        0,
    )
    assert kernel(np.zeros((0, 6)), np.zeros(6)).shape == (0, 6)
    assert not launched
    for wrong, message in [
        ((np.zeros(6),), r"1 arrays; expected 2: q, qd"),
        ((np.zeros(5), np.zeros(6)), r"q: shape \(5,\); expected \(…, 6\)"),
        ((np.zeros((2, 6)), np.zeros((3, 6))), r"leading axes do not fit together: q \(2, 6\), qd \(3, 6\)"),
    ]:
        with pytest.raises(ShapeError, match=message):
            kernel(*wrong)
    step = trace("step", lambda x, u, h: x + u * h, {"x": (2,), "u": (2,), "h": ()}, ("x_next",))
    loop = CudaTrajectory(step)
    record, frozen = loop(np.zeros((300, 2)), np.zeros(2), 1e-3, 10, 5)
    assert (record.shape, frozen.shape, launched[0][0], launched[0][1]) == (
        (3, 300, 2),
        (300,),
        "step_trajectory",
        (3,),
    )
    with pytest.raises(ShapeError, match=r"x and u: shapes \(2,\) and \(2,\); expected \(lanes, 2\)"):
        loop(np.zeros(2), np.zeros(2), 1e-3, 1)


@pytest.mark.skipif(importlib.util.find_spec("cupy") is None, reason="CuPy is not installed, or there is no GPU")
def test_on_a_gpu():
    """The bits of the compiled kernel and of the simulator, where nothing needs libm."""
    import cupy  # pyright: ignore[reportMissingImports]

    model = arm("puma560")
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 10_000, 6))
    found = CudaKernel(trace_kernel(model, SIGNATURES["inverse_dynamics"]))(q, qd, qdd)
    assert np.array_equal(cupy.asnumpy(found), aw.compile(model).inverse_dynamics(q, qd, qdd))
    simulator = compile_loop(model)
    scenario = aw.Scenario(
        model, command=np.ones(6), duration=0.05, start=aw.Batch(q[:100]), recording=aw.Recording(every=5)
    )
    record, _ = CudaTrajectory(simulator.step)(np.hstack([q[:100], 0 * q[:100]]), np.ones(6), 1e-3, 50, 5)
    expected = aw.simulate(scenario, loop=simulator)["q"]
    assert np.array_equal(cupy.asnumpy(record)[:, :, :6].transpose(1, 0, 2), expected)

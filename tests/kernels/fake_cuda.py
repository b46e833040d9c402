"""A GPU of this machine's processor: cuda-python's bindings, as far as `kernels` calls them, over g++ and the shim.

Its compiler hands the text through as machine code; its driver compiles that for the CPU and runs launches at once. It refuses
what a real one would answer with a fault: no current context, pointers that are nobody's, a write behind an array's end. A
launch may run a warp's threads forwards or backwards: a result that depends on it lacks a barrier.
"""

from __future__ import annotations

import ctypes
import re
import sys
import types
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from kernels.c_compilers import FMA, build, compiler

SHIM = Path(__file__).with_name("cuda_shim.h")
STRICT = ("-Wall", "-Wextra", "-Werror", "-Wno-unknown-pragmas", "-Wno-clobbered")  # the last: of the shim
SIZES = {"long long": 8, "double": 8, "float": 4}
FENCE = 64  # bytes behind each array, that nothing may write
MARK = 0xA5


def parameters_of(text: str, name: str) -> list[tuple[str, str]]:
    """(type, name) of a kernel's parameters; a pointer's type ends in *."""
    match = re.search(rf'extern "C" __global__ void (?:__launch_bounds__\(\d+\) )?{name}\(([^)]*)\)', text)
    assert match is not None, name
    found = []
    for word in match[1].split(","):
        kind, star, variable = re.fullmatch(r"\s*(?:const )?(.*?) (\*?)(\w+)\s*", word).groups()  # type: ignore[union-attr]
        found.append((kind + star, variable))
    return found


def on_the_cpu(folder: Path, text: str, *names: str, strict: tuple[str, ...] = STRICT) -> ctypes.CDLL:
    """The text through g++, with `name_blocks(blocks, threads, backwards, …)` beside each kernel, which launches it."""
    drivers = []
    for name in names:
        parameters = parameters_of(text, name)
        head = "".join(f", {kind.replace('*', ' *')} {variable}" for kind, variable in parameters)
        call = f"{name}({', '.join(variable for _, variable in parameters)});"
        drivers.append(
            f'extern "C" void {name}_blocks(long long blocks, long long threads, int backwards{head})\n'
            f"{{\n    launch(blocks, threads, backwards != 0, [&] {{ {call} }});\n}}\n"
        )
    (folder / "kernel.cpp").write_text("\n".join([text, *drivers]), encoding="ascii")
    flags = ("-std=c++14", "-O2", *FMA, "-ffp-contract=off", *strict, "-include", SHIM)
    build([compiler("g++"), *flags, "-shared", "-fPIC", folder / "kernel.cpp", "-o", folder / "kernel.so"])
    return ctypes.CDLL(str(folder / "kernel.so"))


class FakeCuda:
    """The bindings' two modules over one GPU, and what was asked of them.

    Attributes:
        backwards: the order of a warp's threads in the next launches.   launches: (name, blocks, threads, stream) of each.
        compiled: architectures that texts were compiled for.   memory: arrays that are there, by address.
        room: [bytes] the largest array that there is memory for.
    """

    CAPABILITY = (9, 0)

    def __init__(self, folder: Path, count: int = 1):
        self.folder, self.count, self.room = folder, count, 1 << 24
        self.backwards, self.launches, self.compiled = False, [], []
        self.memory: dict[int, tuple[np.ndarray, int]] = {}
        self.foreign: list[np.ndarray] = []  # arrays that a library owns
        self._contexts: list[str] = []
        self._texts: dict[int, str] = {}

    def install(self, monkeypatch: Any) -> FakeCuda:
        """Puts the modules where `import cuda.bindings` finds them."""
        for name in ("cuda", "cuda.bindings"):
            monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
        for name in ("driver", "nvrtc"):
            monkeypatch.setitem(sys.modules, f"cuda.bindings.{name}", getattr(self, name)())
        return self

    def driver(self) -> SimpleNamespace:
        names = [name for name in dir(self) if name.startswith("cu")]
        functions = {name: getattr(self, name) for name in names}
        major, minor = "COMPUTE_CAPABILITY_MAJOR", "COMPUTE_CAPABILITY_MINOR"
        attributes = SimpleNamespace(**{f"CU_DEVICE_ATTRIBUTE_{name}": name for name in (major, minor)})
        types_ = {"CUresult": SimpleNamespace(CUDA_SUCCESS=0), "CUdevice_attribute": attributes, "CUstream": int}
        return SimpleNamespace(**functions, **types_)

    def nvrtc(self) -> SimpleNamespace:
        def compile_program(program: dict, count: int, options: list[bytes]) -> tuple[int]:
            assert count == len(options)
            assert b"--fmad=false" in options
            self.compiled += [each.decode()[-5:] for each in options if each.startswith(b"--gpu-architecture=")]
            return (0,)

        def fill(program: dict, key: str, into: bytearray) -> tuple[int]:
            into[:] = program[key]
            return (0,)

        return SimpleNamespace(
            nvrtcResult=SimpleNamespace(NVRTC_SUCCESS=0),
            nvrtcVersion=lambda: (0, 13, 0),
            nvrtcGetSupportedArchs=lambda: (0, [80, 90, 100]),
            nvrtcCreateProgram=lambda text, name, count, headers, names: (0, {"text": text, "log": b"\0"}),
            nvrtcCompileProgram=compile_program,
            nvrtcGetProgramLogSize=lambda program: (0, len(program["log"])),
            nvrtcGetProgramLog=lambda program, into: fill(program, "log", into),
            nvrtcGetCUBINSize=lambda program: (0, len(program["text"])),
            nvrtcGetCUBIN=lambda program, into: fill(program, "text", into),
            nvrtcDestroyProgram=lambda program: (0,),
        )

    # --- the driver ---------------------------------------------------------------------------------------------------

    def cuInit(self, flags: int) -> tuple:
        return (0,) if self.count else (100,)

    def cuGetErrorString(self, code: int) -> tuple:
        return 0, {100: b"no CUDA-capable device is detected", 2: b"out of memory"}[code]

    def cuDeviceGetCount(self) -> tuple:
        return 0, self.count

    def cuDeviceGet(self, index: int) -> tuple:
        assert 0 <= index < self.count
        return 0, index

    def cuDeviceGetAttribute(self, attribute: str, device: int) -> tuple:
        return 0, self.CAPABILITY[attribute.endswith("MINOR")]

    def cuDevicePrimaryCtxRetain(self, device: int) -> tuple:
        return 0, f"context {device}"

    def cuCtxPushCurrent(self, context: str) -> tuple:
        self._contexts.append(context)
        return (0,)

    def cuCtxPopCurrent(self) -> tuple:
        return 0, self._contexts.pop()

    def cuMemAlloc(self, size: int) -> tuple:
        assert self._contexts
        assert size > 0
        if size > self.room:
            return 2, 0
        block = np.full(size + FENCE, MARK, np.uint8)
        self.memory[block.ctypes.data] = block, size
        return 0, block.ctypes.data

    def cuMemFree(self, address: int) -> tuple:
        assert self._contexts
        self._check_fences()
        del self.memory[address]
        return (0,)

    def cuMemcpyHtoD(self, to: int, source: int, size: int) -> tuple:
        assert self._contexts
        assert size <= self._room(to)
        ctypes.memmove(to, source, size)
        return (0,)

    def cuMemcpyDtoH(self, to: int, source: int, size: int) -> tuple:
        assert self._contexts
        assert size <= self._room(source)
        ctypes.memmove(to, source, size)
        return (0,)

    def cuStreamSynchronize(self, stream: int) -> tuple:
        assert self._contexts
        return (0,)

    def cuModuleLoadData(self, code: bytes) -> tuple:
        assert self._contexts
        self._texts[len(self._texts)] = code.decode()
        return 0, len(self._texts) - 1

    def cuModuleGetFunction(self, module: int, name: bytes) -> tuple:
        folder = self.folder / str(module)
        folder.mkdir()
        text = self._texts[module]
        library = on_the_cpu(folder, text, name.decode())
        return 0, (name.decode(), parameters_of(text, name.decode()), library)

    def cuLaunchKernel(self, function: tuple, *launch: Any) -> tuple:
        (blocks, y, z, threads, ty, tz, shared, stream, parameters, extra) = launch
        assert self._contexts
        assert (y, z, ty, tz, shared, extra) == (1, 1, 1, 1, 0, 0)
        assert 0 < blocks < 1 << 31
        assert threads % 32 == 0
        name, kinds, library = function
        pointers = (ctypes.c_void_p * len(kinds)).from_address(parameters)
        values = [ctypes.c_longlong(blocks), ctypes.c_longlong(threads), ctypes.c_int(self.backwards)]
        for pointer, (kind, _) in zip(pointers, kinds, strict=True):
            cell = {"long long": ctypes.c_longlong, "double": ctypes.c_double}.get(kind, ctypes.c_void_p)
            values.append(cell.from_address(pointer))
            if kind.endswith("*"):
                assert self._room(values[-1].value) > 0, f"{name}: {kind} points nowhere"
        getattr(library, f"{name}_blocks")(*values)
        self._check_fences()
        self.launches.append((name, blocks, threads, stream))
        return (0,)

    def _room(self, address: int) -> int:
        """Bytes from an address to the end of its array, 0 where it is in none."""
        spans = [(start, size) for start, (_, size) in self.memory.items()]
        spans += [(array.ctypes.data, array.nbytes) for array in self.foreign]
        return max((start + size - address for start, size in spans if start <= address < start + size), default=0)

    def _check_fences(self) -> None:
        for block, size in self.memory.values():
            assert (block[size:] == MARK).all(), "written behind the end of an array"


def fake_cupy(gpu: FakeCuda) -> types.ModuleType:
    """A CuPy whose arrays are NumPy's, known to the fake driver."""

    class Array(np.ndarray):
        @property
        def data(self) -> Any:
            return SimpleNamespace(ptr=self.ctypes.data)

        def __dlpack_device__(self, *_: Any) -> tuple[int, int]:
            return 2, 0

    Array.__module__ = "cupy"

    def owned(array: Any) -> Any:
        found = np.ascontiguousarray(array).view(Array)
        gpu.foreign.append(found)
        return found

    module: Any = types.ModuleType("cupy")
    module.asarray = lambda value, dtype=None: owned(np.asarray(value, dtype))
    module.broadcast_to = lambda array, shape: np.broadcast_to(array, shape, subok=True)
    module.ascontiguousarray = owned
    module.empty = lambda shape, dtype: owned(np.full(shape, np.nan, dtype))
    module.cuda = SimpleNamespace(get_current_stream=lambda: SimpleNamespace(ptr=7))
    return module


def fake_torch(gpu: FakeCuda) -> types.ModuleType:
    """A PyTorch whose tensors are NumPy's arrays, known to the fake driver."""
    cupy: Any = fake_cupy(gpu)

    class Tensor:
        def __init__(self, array: Any, place: str = "cuda", requires_grad: bool = False):
            self.array, self.place, self.requires_grad = cupy.ascontiguousarray(array), place, requires_grad
            self.shape, self.ndim, self.dtype = self.array.shape, self.array.ndim, self.array.dtype

        def contiguous(self) -> Any:
            return self

        def data_ptr(self) -> int:
            return self.array.ctypes.data

        def __dlpack_device__(self) -> tuple[int, int]:
            return (2, 0) if self.place == "cuda" else (1, 0)

    Tensor.__module__ = "torch"

    def as_tensor(value: Any, dtype: Any, device: str) -> Any:
        assert device == "cuda 0"
        return Tensor(np.asarray(value.array if isinstance(value, Tensor) else value, dtype))

    module: Any = types.ModuleType("torch")
    module.float32, module.float64, module.Tensor = np.float32, np.float64, Tensor
    module.device = lambda kind, index: f"{kind} {index}"
    module.as_tensor = as_tensor
    module.broadcast_to = lambda tensor, shape: Tensor(np.broadcast_to(tensor.array, shape))
    module.empty = lambda shape, dtype, device: Tensor(np.full(shape, np.nan, dtype))
    module.cuda = SimpleNamespace(current_stream=lambda device: SimpleNamespace(cuda_stream=9))
    return module

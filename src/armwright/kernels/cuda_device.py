"""Gpu: one GPU through cuda-python's bindings of the driver, and NVRTC, which compiles CUDA C for it or for another.

A GPU is used through its primary context, which CuPy, PyTorch and JAX use as well, so their arrays can be passed by address.
Compiled kernels are kept with the other code on disk (`cache`).
"""

from __future__ import annotations

import ctypes
import importlib
import math
import sys
import weakref
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from armwright.errors import ModelError
from armwright.kernels import cache

OPTIONS = ("--fmad=false", "--std=c++14")
PREFIX = "cuda"  # a device is "cuda", or "cuda:1" for the second GPU
INSTALL = 'pip install "armwright[cuda]"'
DRIVER = "an NVIDIA GPU with its driver"
CELLS = {int: ctypes.c_longlong, float: ctypes.c_double}  # parameters of kernels; addresses are ctypes.c_void_p


class Gpu:
    """One GPU of this machine, used through its primary context; `with gpu:` makes that current.

    Attributes:
        index: its number, as the driver counts.   capability: its compute capability, such as (9, 0).
    """

    def __init__(self, index: int = 0):
        """Args: index: its number.

        Raises:
            ModelError: the bindings or the driver are not installed; no such GPU.
        """
        self._driver = _bindings("driver")
        try:
            self._call("cuInit", 0)
            count = self._call("cuDeviceGetCount")
        except RuntimeError as error:  # of the bindings, which load the driver now
            what = "NVIDIA's driver (libcuda) is not installed, or there is no GPU; `nvidia-smi` shows both"
            raise ModelError(what, place="device", value="cuda", expected=DRIVER) from error
        if index >= count:
            have = "there is no GPU" if count == 0 else f"there are {count}, counted from 0"
            raise ModelError(have, place="device", value=f"cuda:{index}", expected=DRIVER)
        self.index = index
        device = self._call("cuDeviceGet", index)
        attributes = self._driver.CUdevice_attribute
        major, minor = (
            self._call("cuDeviceGetAttribute", attribute, device)
            for attribute in (
                attributes.CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR,
                attributes.CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR,
            )
        )
        self.capability = int(major), int(minor)
        self._context = self._call("cuDevicePrimaryCtxRetain", device)

    def __enter__(self) -> Gpu:
        self._call("cuCtxPushCurrent", self._context)
        return self

    def __exit__(self, *_: object) -> None:
        self._call("cuCtxPopCurrent")

    def function(self, name: str, build: Callable[..., str], *ingredients: Any) -> GpuFunction:
        """The kernel of that name in the CUDA text of `build(*ingredients)`, compiled or from the cache.

        Args:
            name: of the kernel.   build: a function at the top level of a file of `kernels`.   ingredients: programs and words.
        Raises:
            ModelError: NVRTC is not installed, or makes no code for this GPU.
        """
        version, architectures = nvrtc_can()
        architecture = _architecture(self.capability, architectures, version)
        key = cache.key(build, ingredients, "cuda", version, architecture, OPTIONS)
        code = cache.load(key)
        if code is None:
            code, _ = cubin(build(*ingredients), architecture)
            cache.store(key, code)
        with self:
            module = self._call("cuModuleLoadData", code)
            return GpuFunction(self, module, self._call("cuModuleGetFunction", module, name.encode()))

    def launch(self, function: Any, blocks: int, threads: int, cells: Sequence[Any], stream: int) -> None:
        """Starts a kernel; it runs when what the stream has before it is done.

        Args:
            function: of the driver.   blocks, threads: of the grid, and of a block.   stream: its handle; 0: the usual one.
            cells: the kernel's parameters as ctypes objects.
        """
        pointers = (ctypes.c_void_p * len(cells))(*map(ctypes.addressof, cells))
        grid = (blocks, 1, 1, threads, 1, 1, 0)
        with self:
            handle = self._driver.CUstream(stream)
            self._call("cuLaunchKernel", function, *grid, handle, ctypes.addressof(pointers), 0)

    def wait(self, stream: int = 0) -> None:
        """Waits until everything in a stream is done."""
        with self:
            self._call("cuStreamSynchronize", self._driver.CUstream(stream))

    def array(self, shape: tuple[int, ...], dtype: np.dtype) -> DeviceArray:
        """A new array on the GPU, its entries undefined."""
        with self:
            address = int(self._call("cuMemAlloc", max(1, math.prod(shape)) * dtype.itemsize))
        return DeviceArray(self, address, shape, dtype)

    def put(self, values: np.ndarray) -> DeviceArray:
        """A copy of an array on the GPU."""
        values = np.ascontiguousarray(values)
        array = self.array(values.shape, values.dtype)
        if values.size:
            with self:
                self._call("cuMemcpyHtoD", array.address, values.ctypes.data, values.nbytes)
        return array

    def get(self, array: DeviceArray) -> np.ndarray:
        """A copy of a GPU's array, when what computes it is done."""
        values = np.empty(array.shape, array.dtype)
        if values.size:
            with self:
                self._call("cuMemcpyDtoH", values.ctypes.data, array.address, values.nbytes)
        return values

    def free(self, address: int) -> None:
        """Gives an array's memory back."""
        with self:
            self._call("cuMemFree", address)

    def _call(self, name: str, *arguments: Any) -> Any:
        """Result of a function of the driver.

        Raises:
            ModelError: it fails; says the driver's reason.
        """
        code, *values = getattr(self._driver, name)(*arguments)
        if code != self._driver.CUresult.CUDA_SUCCESS:
            _, text = self._driver.cuGetErrorString(code)
            why = text.decode() if isinstance(text, bytes) else str(code)
            raise ModelError(f"{name}: {why}", place="device", value="cuda", expected=DRIVER)
        return values[0] if values else None


def gpu_index(device: Any) -> int:
    """The GPU's number in a device's name.

    Raises:
        ModelError: another device.
    """
    kind, colon, number = device.partition(":") if isinstance(device, str) else ("", "", "")
    if kind != PREFIX or (colon and not number.isdecimal()):
        raise ModelError(place="device", value=device, expected='"cpu", "cuda", or "cuda:1" for the second GPU')
    return int(number or 0)


class GpuFunction:
    """A kernel on a GPU: `function(count, threads, parameters, stream)`, a thread each of `count` states."""

    def __init__(self, gpu: Gpu, module: Any, function: Any):
        self._gpu, self._module, self._function = gpu, module, function

    def __call__(self, count: int, threads: int, parameters: Sequence[Any], stream: int) -> None:
        """Starts it for `count` states, its first parameter, in blocks of some threads.

        Args:
            parameters: behind the count: integers, floats and ctypes objects.
        """
        cells = [CELLS[type(each)](each) if type(each) in CELLS else each for each in (count, *parameters)]
        self._gpu.launch(self._function, -(-count // threads), threads, cells, stream)


class DeviceArray:
    """Numbers on a GPU, for whatever reads `__cuda_array_interface__`. Memory without an owner is given back with this object.

    Attributes:
        gpu: where it is.   address: of its first entry.   shape, dtype: as NumPy's; row-major.   owner: of the memory, or None.
    """

    def __init__(self, gpu: Gpu, address: int, shape: tuple[int, ...], dtype: np.dtype, owner: Any = None):
        self.gpu, self.address, self.shape, self.dtype, self.owner = gpu, address, tuple(shape), dtype, owner
        if owner is None:
            # the driver frees what is left when the process ends
            weakref.finalize(self, gpu.free, address).atexit = False

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        """The address, shape and type, as CuPy, PyTorch and Numba read them."""
        return {
            "shape": self.shape,
            "typestr": self.dtype.str,
            "data": (self.address, False),
            "version": 3,
            "stream": 1,
        }

    def numpy(self) -> np.ndarray:
        """A copy for NumPy."""
        return self.gpu.get(self)


def cubin(text: str, architecture: str, *options: str) -> tuple[bytes, str]:
    """Machine code of a CUDA text, by NVRTC, which needs no GPU.

    Args:
        text: CUDA C.   architecture: such as "sm_90".   options: more of NVRTC's, such as "--ptxas-options=-v".
    Returns:
        code: what the driver loads.   log: what the compiler says.
    Raises:
        ModelError: NVRTC is not installed, or does not know the architecture.
    """
    nvrtc = _bindings("nvrtc")
    every = [option.encode() for option in (*OPTIONS, f"--gpu-architecture={architecture}", *options)]
    done = nvrtc.nvrtcResult.NVRTC_SUCCESS
    _, program = _loaded(nvrtc.nvrtcCreateProgram, text.encode(), b"kernel.cu", 0, [], [])
    (code,) = nvrtc.nvrtcCompileProgram(program, len(every), every)
    _, size = nvrtc.nvrtcGetProgramLogSize(program)
    log = bytearray(size)
    nvrtc.nvrtcGetProgramLog(program, log)
    words = log.rstrip(b"\0").decode()
    if code != done:
        nvrtc.nvrtcDestroyProgram(program)
        raise ModelError(f"NVRTC: {words.strip() or code}", place="architecture", value=architecture)
    _, size = nvrtc.nvrtcGetCUBINSize(program)
    made = bytearray(size)
    nvrtc.nvrtcGetCUBIN(program, made)
    nvrtc.nvrtcDestroyProgram(program)
    return bytes(made), words


def nvrtc_can() -> tuple[str, tuple[int, ...]]:
    """NVRTC's version, and the architectures that it makes code for: 90 is compute capability 9.0.

    Raises:
        ModelError: it is not installed.
    """
    nvrtc = _bindings("nvrtc")
    _, major, minor = _loaded(nvrtc.nvrtcVersion)
    _, architectures = nvrtc.nvrtcGetSupportedArchs()
    return f"{major}.{minor}", tuple(architectures)


def _architecture(capability: tuple[int, int], known: Sequence[int], version: str) -> str:
    """The newest architecture whose code a GPU runs: of its major number, its minor number or an older one."""
    major, minor = capability
    fitting = [number for number in known if number // 10 == major and number % 10 <= minor]
    if not fitting:
        choices = tuple(f"{number // 10}.{number % 10}" for number in known)
        what = f"NVRTC {version} makes no code for a GPU of compute capability {major}.{minor}, but for {', '.join(choices)}"
        raise ModelError(what, place="device", value="cuda")
    return f"sm_{max(fitting)}"


def _bindings(name: str) -> Any:
    if sys.platform == "darwin":
        raise ModelError("NVIDIA makes no driver for macOS", place="device", value="cuda", expected="cpu")
    try:
        return importlib.import_module(f"cuda.bindings.{name}")
    except ImportError:
        what = f"cuda-bindings, which reaches the GPU's driver, is not installed: {INSTALL}"
        raise ModelError(what, place="device", value="cuda") from None


def _loaded(function: Callable[..., Any], *arguments: Any) -> Any:
    """Result of NVRTC's first function, which loads the library."""
    try:
        return function(*arguments)
    except RuntimeError as error:
        what = f"NVRTC, the compiler of CUDA C, is not installed: {INSTALL}"
        raise ModelError(what, place="device", value="cuda") from error

"""Arrays on a GPU: those of CuPy, PyTorch and JAX, whatever has `__cuda_array_interface__`, and copies of NumPy's.

Inputs are passed by address, without a copy where they are contiguous and of the kernel's type. Results are arrays of the same
library, from its own memory pool, and the kernel runs in the library's current stream, so that its order of work is kept.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from armwright.errors import ModelError, ShapeError
from armwright.kernels.batch import as_numbers
from armwright.kernels.cuda_device import DeviceArray, Gpu

ON_A_GPU = 2  # kDLCUDA, DLPack's number of the kind of device
NAMES = {"cupy": "CuPy", "torch": "PyTorch", "jax": "JAX"}


class HostArrays:
    """NumPy arrays, lists and numbers: copied to the GPU, results copied back."""

    def __init__(self, gpu: Gpu):
        self.gpu, self.stream = gpu, 0

    def array(self, value: Any, dtype: np.dtype, place: str, name: str) -> Any:
        """The value as an array of the type; it has `shape` and `ndim`.

        Raises:
            ShapeError: it holds something else than real numbers.
        """
        return as_numbers(value, place, name, dtype)

    def rows(self, array: Any, shape: tuple[int, ...], place: str, name: str) -> Any:
        """The array, broadcast to a shape, row-major on the GPU."""
        return self.gpu.put(np.broadcast_to(array, shape))

    def empty(self, shape: tuple[int, ...], dtype: np.dtype) -> Any:
        """A new array on the GPU."""
        return self.gpu.array(shape, dtype)

    def address(self, array: Any) -> int:
        """Address of an array's first entry."""
        return array.address

    def results(self, arrays: list[Any]) -> list[Any]:
        """The results as their user gets them."""
        return [array.numpy() for array in arrays]


class DeviceArrays(HostArrays):
    """Arrays that only say where they are (`__cuda_array_interface__`); nothing converts them, or broadcasts their rows."""

    def array(self, value: Any, dtype: np.dtype, place: str, name: str) -> Any:
        """An array on the GPU as it is, another value for a copy.

        Raises:
            ShapeError: an array of another type or layout.
        """
        described = getattr(value, "__cuda_array_interface__", None)
        if described is None:
            return super().array(value, dtype, place, name)
        shape = tuple(described["shape"])
        row_major = tuple(np.cumprod((dtype.itemsize, *shape[:0:-1]))[::-1])
        if described["typestr"] != dtype.str or (described.get("strides") or row_major) != row_major:
            expected = f"contiguous rows of {dtype.name}; CuPy, PyTorch and JAX convert by themselves"
            raise ShapeError(f"{described['typestr']} {shape}", place=f"{place}: {name}", expected=expected)
        return DeviceArray(self.gpu, described["data"][0], shape, dtype, owner=value)

    def rows(self, array: Any, shape: tuple[int, ...], place: str, name: str) -> Any:
        """The array, whose shape must fit already.

        Raises:
            ShapeError: it does not.
        """
        if isinstance(array, np.ndarray):
            return super().rows(array, shape, place, name)
        if array.shape != shape:
            expected = f"contiguous rows of {array.dtype.name} {shape}; CuPy, PyTorch and JAX broadcast by themselves"
            raise ShapeError(f"shape {array.shape}", place=f"{place}: {name}", expected=expected)
        return array

    def results(self, arrays: list[Any]) -> list[Any]:
        """The arrays themselves."""
        return arrays


class CupyArrays(HostArrays):
    """CuPy's arrays."""

    def __init__(self, gpu: Gpu):
        super().__init__(gpu)
        self._cupy = importlib.import_module("cupy")
        self.stream = self._cupy.cuda.get_current_stream().ptr

    def array(self, value: Any, dtype: np.dtype, place: str, name: str) -> Any:
        """The value as an array of the type on the GPU."""
        return self._cupy.asarray(_real(value, dtype, place, name), dtype=dtype)

    def rows(self, array: Any, shape: tuple[int, ...], place: str, name: str) -> Any:
        """The array, broadcast to a shape, row-major."""
        return self._cupy.ascontiguousarray(self._cupy.broadcast_to(array, shape))

    def empty(self, shape: tuple[int, ...], dtype: np.dtype) -> Any:
        """A new array."""
        return self._cupy.empty(shape, dtype=dtype)

    def address(self, array: Any) -> int:
        """Address of an array's first entry."""
        return array.data.ptr

    def results(self, arrays: list[Any]) -> list[Any]:
        """The arrays themselves: whatever comes behind them in the stream finds them computed."""
        return arrays


class TorchArrays(HostArrays):
    """PyTorch's tensors. The kernel is no node of its graph of derivatives."""

    def __init__(self, gpu: Gpu):
        super().__init__(gpu)
        self._torch = importlib.import_module("torch")
        self._device = self._torch.device("cuda", gpu.index)
        self.stream = self._torch.cuda.current_stream(self._device).cuda_stream

    def array(self, value: Any, dtype: np.dtype, place: str, name: str) -> Any:
        """The value as a tensor of the type on the GPU.

        Raises:
            ShapeError: a tensor that wants its gradient.
        """
        if getattr(value, "requires_grad", False):
            expected = "tensor.detach(); aw.interop.torch has gradients"
            raise ShapeError("a tensor that requires a gradient", place=f"{place}: {name}", expected=expected)
        value = _real(value, dtype, place, name)
        return self._torch.as_tensor(value, dtype=getattr(self._torch, dtype.name), device=self._device)

    def rows(self, array: Any, shape: tuple[int, ...], place: str, name: str) -> Any:
        """The tensor, broadcast to a shape, row-major."""
        return self._torch.broadcast_to(array, shape).contiguous()

    def empty(self, shape: tuple[int, ...], dtype: np.dtype) -> Any:
        """A new tensor."""
        return self._torch.empty(shape, dtype=getattr(self._torch, dtype.name), device=self._device)

    def address(self, array: Any) -> int:
        """Address of a tensor's first entry."""
        return array.data_ptr()

    def results(self, arrays: list[Any]) -> list[Any]:
        """The tensors themselves: whatever comes behind them in the stream finds them computed."""
        return arrays


class JaxArrays(HostArrays):
    """JAX's arrays, outside of `jit`. JAX hides its streams: a call waits for its inputs, and for its results."""

    def __init__(self, gpu: Gpu):
        super().__init__(gpu)
        self._jax = importlib.import_module("jax")

    def array(self, value: Any, dtype: np.dtype, place: str, name: str) -> Any:
        """The value as an array of the type.

        Raises:
            ShapeError: a tracer of `jit` or `grad`, or doubles that JAX is not set up for.
        """
        if isinstance(value, self._jax.core.Tracer):
            expected = "an array with values; under jit, vmap and grad use aw.interop.jax"
            raise ShapeError("a traced array", place=f"{place}: {name}", expected=expected)
        if self._jax.dtypes.canonicalize_dtype(dtype) != dtype:
            expected = 'jax.config.update("jax_enable_x64", True), or aw.compile(arm, device="cuda", dtype="float32")'
            raise ShapeError("JAX has no doubles", place=f"{place}: {name}", expected=expected)
        return self._jax.numpy.asarray(_real(value, dtype, place, name), dtype)

    def rows(self, array: Any, shape: tuple[int, ...], place: str, name: str) -> Any:
        """The array, broadcast to a shape; JAX keeps them row-major."""
        return self._jax.block_until_ready(self._jax.numpy.broadcast_to(array, shape))

    def empty(self, shape: tuple[int, ...], dtype: np.dtype) -> Any:
        """A new array that nobody else has, to be written once before anybody reads it."""
        return self._jax.block_until_ready(self._jax.numpy.zeros(shape, dtype))

    def address(self, array: Any) -> int:
        """Address of an array's first entry."""
        return array.unsafe_buffer_pointer()

    def results(self, arrays: list[Any]) -> list[Any]:
        """The arrays, when they are computed."""
        self.gpu.wait(self.stream)
        return arrays


LIBRARIES: dict[str, type[HostArrays]] = {"cupy": CupyArrays, "torch": TorchArrays, "jax": JaxArrays}


def select_arrays(values: Sequence[Any], gpu: Gpu, place: str) -> HostArrays:
    """The library that the arrays of a call are of.

    Raises:
        ModelError: arrays of two libraries; an array that is not on this GPU.
    """
    names = {_library(value) for value in values} - {"numpy"}
    if len(names) > 1:
        found = " and ".join(sorted(NAMES.get(name, name) for name in names))
        raise ModelError(f"arrays of {found}", place=place, expected="arrays of one library, and NumPy's")
    for value in values:
        if _library(value) in LIBRARIES and hasattr(value, "__dlpack_device__"):
            kind, index = value.__dlpack_device__()
            if (int(kind), index) != (ON_A_GPU, gpu.index):
                where = f"an array on cuda:{index}" if int(kind) == ON_A_GPU else "an array that is not on a GPU"
                raise ModelError(
                    where, place=place, expected=f"arrays on cuda:{gpu.index}, or NumPy's, which are copied"
                )
    name = next(iter(names), "numpy")
    return HostArrays(gpu) if name == "numpy" else LIBRARIES.get(name, DeviceArrays)(gpu)


def _library(value: Any) -> str:
    """The package of a value's type, "numpy" where it is not on a GPU by its nature."""
    package = type(value).__module__.partition(".")[0].replace("jaxlib", "jax")
    return package if package in LIBRARIES or hasattr(value, "__cuda_array_interface__") else "numpy"


def _real(value: Any, dtype: np.dtype, place: str, name: str) -> Any:
    """The value, of which NumPy makes real numbers where it is no array of the library.

    Raises:
        ShapeError: it holds something else than real numbers.
    """
    if _library(value) == "numpy":
        return as_numbers(value, place, name, dtype)
    if "complex" in str(value.dtype):
        raise ShapeError(str(value.dtype), place=f"{place}: {name}", expected="an array of real numbers")
    return value

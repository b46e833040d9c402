"""CudaArm: the kernels of one arm as methods that run on a GPU, and what they are made of."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from armwright.errors import ModelError
from armwright.kernels.batch import common_lead, wrong_count
from armwright.kernels.c_syntax import identifier
from armwright.kernels.compiled import CompiledArm
from armwright.kernels.cuda import THREADS, cuda_source
from armwright.kernels.cuda_arrays import select_arrays
from armwright.kernels.cuda_device import PREFIX, Gpu, gpu_index
from armwright.kernels.format import DOUBLE, Format
from armwright.model import Model
from armwright.program import Program


class CudaKernel:
    """A program on a GPU. `kernel(a, b, …)` takes (…, *shape) arrays and broadcasts over the leading axes.

    Attributes:
        program: what is computed.   format: of the numbers that it takes, computes with and gives.   dtype: NumPy's type of them.
    """

    def __init__(
        self,
        program: Program,
        gpu: Gpu,
        format: Format = DOUBLE,
        check: Callable[[tuple[Any, ...]], None] | None = None,
    ):
        """Args: program: what is compiled.   gpu: for which.   format: of the numbers.   check: of the arrays of every call.

        Raises:
            ModelError: NVRTC is not installed, or makes no code for this GPU.
        """
        self.program, self.format, self.dtype = program, format, format.dtype
        self._gpu, self._check = gpu, check
        self._expected = [(port.name, port.shape) for port in program.inputs]
        self._function = gpu.function(identifier(program.name), cuda_source, program, format)

    def __call__(self, *arrays: Any, out: Any = None, threads: int = 1) -> Any:
        """The program's outputs for all states.

        Args:
            arrays: one an input, (…, *shape); of CuPy, PyTorch or JAX on this GPU, or of NumPy, which are copied there.
            out: None.   threads: not used: there is one for each state.
        Returns:
            results: (…, *shape) an output, of the inputs' library; a tuple where there are several. CuPy's and PyTorch's may
                still be in the making, in the stream that was current.
        Raises:
            ShapeError: an array of the wrong shape or type.   ModelError: an array that is not on this GPU; `out` is given.
        """
        name, ports = self.program.name, self.program.inputs
        if out is not None:
            raise ModelError("is not offered on a GPU", place=f"{name}: out", expected="None; results are new arrays")
        if len(arrays) != len(ports):
            raise wrong_count(name, arrays, ports)
        if self._check is not None:
            self._check(arrays)
        library = select_arrays(arrays, self._gpu, name)
        values = [library.array(value, self.dtype, name, port.name) for value, port in zip(arrays, ports, strict=True)]
        lead = common_lead(name, values, self._expected)
        parameters, kept = [], []
        for value, port in zip(values, ports, strict=True):
            if not port.size:
                continue
            one = math.prod(value.shape) == port.size
            rows = library.rows(value, tuple(value.shape) if one else (*lead, *port.shape), name, port.name)
            kept.append(rows)
            parameters += [ctypes.c_void_p(library.address(rows)), 0 if one else port.size]
        results = [library.empty((*lead, *port.shape), self.dtype) for port in self.program.outputs]
        filled = [result for result, port in zip(results, self.program.outputs, strict=True) if port.size]
        if math.prod(lead) and filled:
            parameters += [ctypes.c_void_p(library.address(result)) for result in filled]
            self._function(math.prod(lead), THREADS, parameters, library.stream)
        results = library.results(results)
        return results[0] if len(results) == 1 else tuple(results)


class CudaArm(CompiledArm[Any]):
    """Kernels for one arm on a GPU: `aw.compile(arm, device="cuda")`. Arrays are those of `CompiledArm`, on the GPU.

    Attributes:
        device: such as "cuda:0".   arm, dtype, varied: as of `CompiledArm`.
    """

    def __init__(
        self,
        arm: Model,
        target: str | None = None,
        vary: Sequence[str] = (),
        dtype: str | type | np.dtype = DOUBLE.name,
        device: str = PREFIX,
    ):
        """Args: arm, vary, dtype: as of `CompiledArm`.   target: None.   device: "cuda", or "cuda:1" for the second GPU.

        Raises:
            ModelError: as `CompiledArm`; a target; no such device, no driver, or no bindings of it.
        """
        if target is not None:
            place, expected = f"target of device {device!r}", "None: code is made for the GPU that runs it"
            raise ModelError(place=place, value=target, expected=expected)
        super().__init__(arm, None, vary, dtype)
        self._gpu = Gpu(gpu_index(device))
        self.device = f"{PREFIX}:{self._gpu.index}"
        self._bare = True  # no native functions in the methods' places

    def __repr__(self) -> str:
        varying = f", varying {', '.join(self.varied.names)}" if self.varied is not None else ""
        major, minor = self._gpu.capability
        return f"<compiled {self.arm.name} for {self.device}, compute capability {major}.{minor}, in {self.format.name}{varying}>"

    def __reduce__(self) -> tuple[Any, ...]:
        vary = () if self.varied is None else self.varied.names
        return type(self), (self.arm, None, vary, self.format.name, self.device)  # without what is on the GPU

    def bind(self, name: str, *optional: str, lead: tuple[int, ...] = (), options: Any = None, **arrays: Any) -> Any:
        """Not offered: starting a kernel on a GPU costs more than a bound call saves.

        Raises:
            ModelError: always.
        """
        expected = (
            "the methods, or aw.compile(arm) on the CPU, whose bound call of one state is faster than a GPU's launch"
        )
        raise ModelError("is not offered on a GPU", place=f"{name}: bind", expected=expected)

    def _compiled(self, name: str, program: Any, *, other_process: bool = False) -> Any:
        return CudaKernel(program, self._gpu, self.format, self._parameter_check(name))

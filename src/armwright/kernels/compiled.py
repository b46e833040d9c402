"""CompiledArm: the kernels of one arm as methods, compiled when first used. The methods are made from the table."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable
from typing import Any

from armwright.errors import ShapeError, nearest
from armwright.kernels.signatures import SIGNATURES, Signature, trace_kernel
from armwright.model import Model


class CompiledArm:
    """Kernels for one arm. Arrays are (…, *shape) and broadcast over their leading axes; each method takes `out=`.

    Attributes:
        arm: the model, frozen.   threads: how many threads share a large batch; results do not depend on it.
        target: the processor that code is made for.
    """

    def __init__(self, arm: Model, target: str | None = None):
        from armwright.kernels.llvm import select_target

        self.arm = arm
        self.target = select_target(target)
        self.threads = os.cpu_count() or 1
        self._kernels: dict[tuple[str, ...], Any] = {}

    def __repr__(self) -> str:
        return f"<compiled {self.arm.name} for {self.target.cpu}, {self.target.width} states at once>"

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"no kernel {name!r}; {nearest(name, SIGNATURES)}")

    def kernel(self, name: str, *optional: str) -> Any:
        """The compiled kernel of that name; compiles it where this is its first use.

        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        """
        if (name, *optional) not in self._kernels:
            from armwright.kernels.batch import Kernel

            program = trace_kernel(self.arm, SIGNATURES[name], optional)
            self._kernels[name, *optional] = Kernel(program, self.target)
        return self._kernels[name, *optional]


def _method(signature: Signature) -> Callable[..., Any]:
    required = [a.name for a in signature.inputs]
    optional = [a.name for a in signature.optional]

    key = (signature.name,)

    def method(self: CompiledArm, *arrays: Any, out: Any = None, **named: Any) -> Any:
        if len(arrays) == len(required) and not named and key in self._kernels:
            return self._kernels[key](*arrays, out=out, threads=self.threads)
        values = list(arrays)
        for name in [*required, *optional][len(values) :]:
            if name in named:
                values.append(named.pop(name))
            elif name in required:
                raise ShapeError(f"{signature.name}: {name} is missing; expected {', '.join(required)}")
        if named or len(values) > len(required) + len(optional):
            extra = f"unknown argument {next(iter(named))!r}" if named else f"{len(values)} arrays"
            raise ShapeError(f"{signature.name}: {extra}; expected {', '.join([*required, *optional])}")
        if len(values) > len(required) and values[-1] is None:
            values.pop()
        return self.kernel(signature.name, *optional[: len(values) - len(required)])(
            *values, out=out, threads=self.threads
        )

    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    parameters = [inspect.Parameter("self", kind), *(inspect.Parameter(name, kind) for name in required)]
    parameters += [inspect.Parameter(name, kind, default=None) for name in optional]
    parameters.append(inspect.Parameter("out", inspect.Parameter.KEYWORD_ONLY, default=None))
    method.__name__ = signature.name
    method.__qualname__ = f"CompiledArm.{signature.name}"
    method.__doc__ = _docstring(signature)
    method.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return method


def _docstring(signature: Signature) -> str:
    equation = (signature.function.__doc__ or "").split("\n\n")[0]

    def line(argument: Any) -> str:
        return f"    {argument.name}: (…, {', '.join(str(size) for size in argument.shape)}) [{argument.unit}]"

    inputs = [line(a) for a in signature.inputs] + [f"{line(a)}, optional" for a in signature.optional]
    output = line(signature.output)
    return "\n".join(
        [equation, "", "Args:", *inputs, "    out: where to write the result, float64.", "Returns:", output]
    )


for _signature in SIGNATURES.values():
    setattr(CompiledArm, _signature.name, _method(_signature))


def compile_arm(arm: Model, target: str | None = None) -> CompiledArm:
    """Kernels for an arm, compiled when first used.

    Args:
        arm: the model.
        target: a processor level such as "x86-64-v3" to make code for; by default the processor this runs on. One
            program gives the same bits on every target that has fused multiply-add.
    Returns:
        dyn: the kernels as methods, (…, n) arrays in and out.
    Raises:
        ModelError: an unknown target, or one that this processor does not reach.
    """
    return CompiledArm(arm, target)

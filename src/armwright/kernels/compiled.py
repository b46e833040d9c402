"""CompiledArm: the kernels of one arm as methods, compiled when first used. The methods are made from the table."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable
from typing import Any

import numpy as np

from armwright.errors import ModelError, ShapeError, nearest
from armwright.kernels.signatures import SIGNATURES, Signature, trace_kernel
from armwright.model import Model, check_arm


class CompiledArm:
    """Kernels for one arm. Arrays are (…, *shape) and broadcast over their leading axes; each method takes `out=`.

    A copy, or a pickle that is read elsewhere, is of the same arm and compiles its kernels anew when they are used.

    Attributes:
        arm: the model, frozen.   target: the processor that code is made for.
    """

    def __init__(self, arm: Model, target: str | None = None):
        from armwright.kernels.llvm import select_target

        check_arm(arm)
        self.arm = arm
        self.target = select_target(target)
        self._asked = target
        self._threads = os.cpu_count() or 1
        self._kernels: dict[tuple[Any, ...], Any] = {}

    def __repr__(self) -> str:
        return f"<compiled {self.arm.name} for {self.target.cpu}, {self.target.width} states at once>"

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (type(self), self.arm, self._asked, self._threads)  # without the native code

    @property
    def threads(self) -> int:
        """How many threads share a large batch, 1 or more; results do not depend on it."""
        return self._threads

    @threads.setter
    def threads(self, count: int) -> None:
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < 1:
            raise ModelError(f"threads = {count!r}: expected a whole number, 1 or more")
        self._threads = int(count)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"no kernel {name!r}; {nearest(name, SIGNATURES)}")

    def kernel(self, name: str, *optional: str, **options: Any) -> Any:
        """The compiled kernel of that name; compiles it where this is its first use.

        Args:
            name: of the table.   optional: names of the optional inputs that it takes.
            options: keyword arguments that are fixed when it is compiled, such as `frame`.
        Returns:
            kernel: takes and returns arrays, (…, *shape).
        Raises:
            ShapeError: no kernel has that name.
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        """
        if name not in SIGNATURES:
            raise ShapeError(f"no kernel {name!r}; {nearest(str(name), SIGNATURES)}")
        key = (name, *optional, *sorted(options.items()))
        if key not in self._kernels:
            from armwright.kernels.batch import Kernel

            program = trace_kernel(self.arm, SIGNATURES[name], optional, **options)
            self._kernels[key] = Kernel(program, self.target)
        return self._kernels[key]

    def bind(self, name: str, *optional: str, lead: tuple[int, ...] = (), options: Any = None, **arrays: Any) -> Any:
        """A kernel with its arrays fixed: a call of it costs little more than the computing, for control loops.

        Args:
            name: of the table.   optional: names of the optional inputs that it takes.
            lead: leading axes of the arrays; () for one state.
            options: keyword arguments of the kernel, such as {"frame": "tool"}.
            arrays: by name, float64 and contiguous, to use as inputs and outputs; the others are allocated.
        Returns:
            bound: `bound.inputs["q"][:] = q; tau = bound()`.
        Raises:
            ShapeError: an unknown name, or an array that does not fit.
        """
        from armwright.kernels.bound import Bound

        return Bound(self.kernel(name, *optional, **(options or {})), tuple(lead), arrays)

    def casadi(self, name: str, *optional: str, **options: Any) -> Any:
        """The kernel's traced function for CasADi, for optimal control: symbols in, symbols out, differentiable.

        Args:
            name: of the table.   optional: names of the optional inputs that it takes.
            options: keyword arguments that are fixed, such as `frame`.
        Returns:
            function: `casadi.Function` with the table's names; vectors are columns, matrices have their own shape.
        Raises:
            ShapeError: no kernel has that name.
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        """
        if name not in SIGNATURES:
            raise ShapeError(f"no kernel {name!r}; {nearest(str(name), SIGNATURES)}")
        return trace_kernel(self.arm, SIGNATURES[name], optional, **options).casadi()


def _again(kind: type[CompiledArm], arm: Model, target: str | None, threads: int) -> CompiledArm:
    dyn = kind(arm, target)
    dyn.threads = threads
    return dyn


def _method(signature: Signature) -> Callable[..., Any]:
    required = [a.name for a in signature.inputs]
    optional = [a.name for a in signature.optional]
    usual, count = (signature.name,), len(required)

    def method(self: CompiledArm, *arrays: Any, out: Any = None, **named: Any) -> Any:
        if not named and len(arrays) == count and (kernel := self._kernels.get(usual)) is not None:
            return kernel(*arrays, out=out, threads=self._threads)
        options = {name: named.pop(name) for name in signature.options if named.get(name) is not None}
        values = list(arrays)
        for name in [*required, *optional][len(values) :]:
            if name in named:
                values.append(named.pop(name))
            elif name in required:
                raise ShapeError(f"{signature.name}: {name} is missing; expected {', '.join(required)}")
        named = {name: value for name, value in named.items() if name not in signature.options}
        if named or len(values) > len(required) + len(optional):
            extra = f"unknown argument {next(iter(named))!r}" if named else f"{len(values)} arrays"
            expected = ", ".join([*required, *optional, *signature.options])
            raise ShapeError(f"{signature.name}: {extra}; expected {expected}")
        if len(values) > len(required) and values[-1] is None:
            values.pop()
        kernel = self.kernel(signature.name, *optional[: len(values) - len(required)], **options)
        return kernel(*values, out=out, threads=self._threads)

    kind, keyword = inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY
    parameters = [inspect.Parameter("self", kind), *(inspect.Parameter(name, kind) for name in required)]
    parameters += [inspect.Parameter(name, kind, default=None) for name in optional]
    parameters += [inspect.Parameter(name, keyword, default=None) for name in (*signature.options, "out")]
    method.__name__ = signature.name
    method.__qualname__ = f"CompiledArm.{signature.name}"
    method.__doc__ = _docstring(signature)
    method.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return method


OPTIONS = {"frame": "name of a frame of the arm; by default its tip"}


def _docstring(signature: Signature) -> str:
    equation = (signature.function.__doc__ or "").split("\n\n")[0]

    def line(argument: Any) -> str:
        return f"    {argument.name}: ({', '.join(['…', *map(str, argument.shape)])}) [{argument.unit}]"

    inputs = [line(a) for a in signature.inputs] + [f"{line(a)}, optional" for a in signature.optional]
    options = [f"    {name}: {OPTIONS[name]}." for name in signature.options]
    out = "    out: where to write the result, float64."
    if len(signature.outputs) > 1:
        out = "    out: tuple of arrays to write the results into, float64."
    outputs = [line(a) for a in signature.outputs]
    return "\n".join([equation, "", "Args:", *inputs, *options, out, "Returns:", *outputs])


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
        ModelError: no arm, an unknown target, or one that this processor does not reach.
    """
    return CompiledArm(arm, target)

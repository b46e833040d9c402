"""KernelMethods: a method for every kernel of the table, with signature and docstring.

Editors and type checkers read `kernel_methods.pyi`, which `tools/kernel_stub.py` makes from the same table.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np

from armwright.errors import ShapeError
from armwright.kernels.signatures import PARAMETERS, SIGNATURES, Signature

Real = TypeVar("Real", bound=np.floating)  # of an arm's results


class KernelMethods(Generic[Real]):
    """Methods of `CompiledArm`, one for each kernel."""


def kernel_method(signature: Signature) -> KernelMethod:
    """The method of a row of the table."""
    inputs = [a.name for a in signature.inputs]
    optional = [a.name for a in signature.optional]
    usual = (signature.name,)

    def method(self: Any, *arrays: Any, out: Any = None, **named: Any) -> Any:
        required = inputs if self.varied is None else [*inputs, PARAMETERS]
        count = len(required)
        if not named and len(arrays) == count:
            kernel = self._kernels.get(usual) or self.kernel(signature.name)
            if signature.name in self._waiting:
                self._enter(signature.name, kernel)
            return kernel(*arrays, out=out, threads=self._threads)
        options = {name: named.pop(name) for name in signature.options if named.get(name) is not None}
        values = list(arrays)
        for name in [*required, *optional][len(values) :]:
            if name in named:
                values.append(named.pop(name))
            elif name in required:
                raise ShapeError("missing", place=f"{signature.name}: {name}", expected=", ".join(required))
        named = {name: value for name, value in named.items() if name not in signature.options}
        if named or len(values) > len(required) + len(optional):
            known = [*required, *optional, *signature.options]
            if named:
                raise ShapeError(place=f"{signature.name}: argument", value=next(iter(named)), choices=known)
            raise ShapeError(f"{len(values)} arrays", place=signature.name, expected=", ".join(known))
        if len(values) > len(required) and values[-1] is None:
            values.pop()
        kernel = self.kernel(signature.name, *optional[: len(values) - len(required)], **options)
        return kernel(*values, out=out, threads=self._threads)

    kind, keyword = inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY
    parameters = [inspect.Parameter("self", kind), *(inspect.Parameter(name, kind) for name in inputs)]
    parameters += [inspect.Parameter(name, kind, default=None) for name in optional]
    parameters += [inspect.Parameter(name, keyword, default=None) for name in (*signature.options, "out")]
    method.__name__ = signature.name
    method.__qualname__ = f"KernelMethods.{signature.name}"
    method.__doc__ = _docstring(signature)
    method.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return KernelMethod(method, str(inspect.Signature(parameters[1:])))


class KernelMethod:
    """A method that an arm may have as a native function, from its first use on."""

    def __init__(self, function: Callable[..., Any], form: str):
        self.function, self.form = function, form

    def __get__(self, arm: Any, kind: Any = None) -> Callable[..., Any]:
        return self.function if arm is None else arm._method(self.function, self.form)


OPTIONS = {"frame": "name of a frame of the arm; by default its tip"}


def _docstring(signature: Signature) -> str:
    equation = (signature.function.__doc__ or "").split("\n\n")[0]

    def line(argument: Any) -> str:
        return f"    {argument.name}: ({', '.join(['…', *map(str, argument.shape)])}) [{argument.unit}]"

    inputs = [line(a) for a in signature.inputs] + [f"{line(a)}, optional" for a in signature.optional]
    options = [f"    {name}: {OPTIONS[name]}." for name in signature.options]
    out = "    out: where to write the result, of `dyn.dtype`."
    if len(signature.outputs) > 1:
        out = "    out: tuple of arrays to write the results into, of `dyn.dtype`."
    outputs = [line(a) for a in signature.outputs]
    raises = ["    ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip."]
    if signature.most_joints is not None:
        raises = [f"    ModelError: an arm of more than {signature.most_joints} joints, for which this is not offered."]
    sections = ["Args:", *inputs, *options, out, "Returns:", *outputs, "Raises:", *raises]
    return "\n".join([equation, "", *sections, *_example(signature)])


def _example(signature: Signature) -> list[str]:
    """The example of the float reference, with the same results from the compiled arm."""
    text = inspect.cleandoc(signature.function.__doc__ or "").partition("\nExample:\n")[2]
    compiled = re.sub(r"arm = aw\.load\((.*?)\)", r"dyn = aw.compile(\1)", text)
    compiled = re.sub(r"aw\.(\w+)\(arm, ", r"dyn.\1(", compiled)
    return ["Example:", compiled.replace(" arm.", " dyn.arm.")] if text else []


for _signature in SIGNATURES.values():
    setattr(KernelMethods, _signature.name, kernel_method(_signature))

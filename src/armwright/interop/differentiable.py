"""Kernels with exact derivatives to any order, for packages that differentiate programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armwright.errors import ModelError, ShapeError
from armwright.kernels.compiled import CompiledArm


class Differentiable:
    """A compiled kernel, and its derivatives as further ones, compiled when first used.

    Attributes:
        kernel: of arrays (…, *shape).   inputs, outputs: names and shapes.
    """

    def __init__(self, dyn: CompiledArm, name: str, kernel: Any):
        """Args: dyn: the arm.   name: of the kernel in the table.   kernel: compiled."""
        self.kernel, self._dyn, self._name = kernel, dyn, name
        self.inputs, self.outputs = kernel.program.inputs, kernel.program.outputs
        self._slopes: dict[tuple[int, ...], Differentiable] = {}

    @classmethod
    def of(cls, dyn: CompiledArm, name: str, optional: Sequence[str], options: dict[str, Any]) -> Differentiable:
        """A kernel of the table.

        Raises:
            ModelError: no compiled arm; as `dyn.kernel`.   ShapeError: no such kernel, input or option.
        """
        if not isinstance(dyn, CompiledArm):
            raise ModelError(place="dyn", value=dyn, expected="a compiled arm: aw.compile(arm)")
        return cls(dyn, name, dyn.kernel(name, *optional, **options))

    def slopes(self, places: Sequence[int]) -> Differentiable:
        """The derivatives of every output by some inputs, ∂y/∂b (…, *shape of y, *shape of b), those by the first input first."""
        key = tuple(places)
        if key not in self._slopes:
            from armwright.program.derivative import slopes

            program = slopes(self.kernel.program, [self.inputs[place].name for place in key])
            self._slopes[key] = Differentiable(self._dyn, self._name, self._dyn._compiled(self._name, program))
        return self._slopes[key]

    def __call__(self, *arrays: np.ndarray) -> tuple[np.ndarray, ...]:
        """One array an output."""
        found = self.kernel(*arrays, threads=self._dyn.threads)
        return found if isinstance(found, tuple) else (found,)

    def common_lead(self, shapes: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
        """Leading axes of the outputs for inputs of these shapes, (…, *shape).

        Raises:
            ShapeError: another number of arrays than inputs; a shape that does not end with that of its input; leading axes
                that do not go together.
        """
        if len(shapes) != len(self.inputs):
            expected = f"{len(self.inputs)}: {', '.join(port.name for port in self.inputs)}"
            raise ShapeError(f"{len(shapes)} arrays", place=self._name, expected=expected)
        leads = []
        for shape, port in zip(shapes, self.inputs, strict=True):
            split = len(shape) - len(port.shape)
            if split < 0 or tuple(shape[split:]) != port.shape:
                expected = f"(…, {', '.join(map(str, port.shape))})"
                raise ShapeError(f"shape {tuple(shape)}", place=f"{self._name}: {port.name}", expected=expected)
            leads.append(tuple(shape[:split]))
        try:
            return np.broadcast_shapes(*leads)
        except ValueError:
            what = f"leading axes {', '.join(map(str, leads))}"
            raise ShapeError(what, place=self._name, expected="axes that broadcast") from None


def installed(name: str, what: str) -> Any:
    """A package that is imported when it is first needed.

    Raises:
        ModelError: it is not installed.
    """
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError:
        raise ModelError(f"{what} is not installed: pip install {name}", place=f"aw.interop.{name}") from None

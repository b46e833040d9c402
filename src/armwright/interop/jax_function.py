"""Kernels as functions of JAX: under jit, vmap, jvp, grad and any composition of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from armwright.interop.differentiable import Differentiable, installed
from armwright.kernels.compiled import CompiledArm


def jax(dyn: CompiledArm, name: str, *optional: str, **options: Any) -> Callable[..., Any]:
    """A kernel as a function of JAX arrays, with exact derivatives to any order.

    JAX calls the compiled kernel on the host (`pure_callback`), once for a whole batch of `vmap`. The tangent of an output is

        ẏ = Σ ∂y/∂b ḃ    over the inputs b that have a tangent ḃ

    with the derivative ∂y/∂b as one more compiled kernel, whose tangent is made in the same way. JAX transposes that sum for
    reverse mode. Results are of float64 where JAX has it (`jax.config.update("jax_enable_x64", True)`), else rounded to float32.

    Args:
        dyn: the compiled arm; parameters that it varies are one more input.   name: of the kernel, such as "inverse_dynamics".
        optional: names of the optional inputs that it takes, such as "wrench".   options: such as `frame`, as of `dyn.kernel`.
    Returns:
        function: takes arrays (…, *shape) in the kernel's order, whose leading axes broadcast; gives an array (…, *shape), or a
            tuple of them.
    Raises:
        ModelError: JAX is not installed, or the arm lacks what the kernel needs.   ShapeError: no such kernel, input or option;
            called with other shapes.
    Example:
        >>> torques = aw.interop.jax(aw.compile("two-link"), "inverse_dynamics")
        >>> rest = np.zeros(2)
        >>> [round(float(each), 1) for each in torques(rest, rest, rest)]  # gravity's [N m]
        [84.4, 15.7]
    """
    package = installed("jax", "JAX")
    node = Differentiable.of(dyn, name, optional, options)
    inner = _with_tangents(package, node)

    def function(*arrays: Any) -> Any:
        dtype = package.dtypes.canonicalize_dtype(dyn.dtype)
        numbers = [package.numpy.asarray(array, dtype) for array in arrays]
        rank = len(node.common_lead([array.shape for array in numbers]))
        found: Any = inner(
            *(_with_lead(array, rank + len(port.shape)) for array, port in zip(numbers, node.inputs, strict=True))
        )
        return found if len(found) > 1 else found[0]

    function.__name__ = function.__qualname__ = name
    function.__doc__ = f"{name} of {dyn.arm.name}: ({', '.join(port.name for port in node.inputs)})"
    return function


def _with_lead(array: Any, rank: int) -> Any:
    """An array with leading axes of 1 up to a rank: `vmap` puts its own axis in front of them."""
    return array.reshape((1,) * (rank - array.ndim) + array.shape)


def _with_tangents(package: Any, node: Differentiable) -> Callable[..., tuple[Any, ...]]:
    """A kernel's function of arrays of one rank of leading axes; the functions of its derivatives are made when they are used."""
    derived: dict[tuple[int, ...], Callable[..., tuple[Any, ...]]] = {}

    def on_host(*arrays: Any) -> tuple[np.ndarray, ...]:
        own = node.kernel.dtype
        found = node(*(np.asarray(array, own) for array in arrays))
        return tuple(np.asarray(each, arrays[0].dtype) for each in found)

    @package.custom_jvp
    def function(*arrays: Any) -> tuple[Any, ...]:
        lead = node.common_lead([array.shape for array in arrays])
        kinds = tuple(package.ShapeDtypeStruct((*lead, *port.shape), arrays[0].dtype) for port in node.outputs)
        return package.pure_callback(on_host, kinds, *arrays, vmap_method="expand_dims")

    def carried(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        zero = package.custom_derivatives.SymbolicZero
        active = tuple(place for place, each in enumerate(tangents) if not isinstance(each, zero))
        values = function(*primals)
        if not active:
            return values, tuple(map(package.numpy.zeros_like, values))
        if active not in derived:
            derived[active] = _with_tangents(package, node.slopes(active))
        slopes = iter(derived[active](*primals))
        sums: list[Any] = [0.0] * len(values)
        for place in active:
            inner = node.inputs[place].shape
            tangent = tangents[place]
            column = tangent.reshape((*tangent.shape[: tangent.ndim - len(inner)], -1, 1))
            for k, value in enumerate(values):
                slope = next(slopes)
                matrix = slope.reshape((*slope.shape[: value.ndim - len(node.outputs[k].shape)], -1, column.shape[-2]))
                sums[k] += (matrix @ column).reshape(value.shape)
        return values, tuple(sums)

    function.defjvp(carried, symbolic_zeros=True)
    return function

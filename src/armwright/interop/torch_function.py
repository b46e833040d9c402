"""Kernels as functions of PyTorch tensors: backward, double backward, and the transforms of `torch.func`."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from armwright.interop.differentiable import Differentiable, installed
from armwright.kernels.compiled import CompiledArm


def torch(dyn: CompiledArm, name: str, *optional: str, **options: Any) -> Callable[..., Any]:
    """A kernel as a function of PyTorch tensors, with exact derivatives to any order.

    An `autograd.Function` around the compiled kernel. From the gradient ȳ of the outputs follows that of an input b,

        b̄ = Σ (∂y/∂b)ᵀ ȳ    over the outputs y

    with the derivative ∂y/∂b as one more compiled kernel, which has a gradient in the same way. Tensors on the CPU and of the
    arm's dtype are passed by DLPack without a copy, those of a GPU are copied to the host and back.

    Args:
        dyn: the compiled arm; parameters that it varies are one more input.   name: of the kernel, such as "inverse_dynamics".
        optional: names of the optional inputs that it takes, such as "wrench".   options: such as `frame`, as of `dyn.kernel`.
    Returns:
        function: takes tensors (…, *shape) in the kernel's order, whose leading axes broadcast; gives a tensor (…, *shape), or
            a tuple of them, of the first tensor's dtype and device.
    Raises:
        ModelError: PyTorch is not installed, or the arm lacks what the kernel needs.   ShapeError: no such kernel, input or
            option; called with other shapes.
    Example:
        >>> import torch
        >>> torques = aw.interop.torch(aw.compile("two-link"), "inverse_dynamics")
        >>> rest = torch.zeros(2, dtype=torch.float64)
        >>> torques(rest, rest, rest).numpy().round(1)  # gravity's [N m]
        array([84.4, 15.7])
    """
    package = installed("torch", "PyTorch")
    node = Differentiable.of(dyn, name, optional, options)
    call = _autograd_function(package).apply

    def function(*tensors: Any) -> Any:
        rank = len(node.common_lead([tuple(tensor.shape) for tensor in tensors]))
        first, pairs = tensors[0], zip(tensors, node.inputs, strict=True)
        leads = [(1,) * (rank + len(port.shape) - tensor.ndim) for tensor, port in pairs]
        moved = [
            tensor.to(first.device, first.dtype).reshape((*lead, *tensor.shape))
            for tensor, lead in zip(tensors, leads, strict=True)
        ]
        found = call(node, *moved)
        return found if len(found) > 1 else found[0]

    function.__name__ = function.__qualname__ = name
    function.__doc__ = f"{name} of {dyn.arm.name}: ({', '.join(port.name for port in node.inputs)})"
    return function


@functools.cache
def _autograd_function(package: Any) -> Any:
    """The `autograd.Function` of all kernels."""

    class Called(package.autograd.Function):
        """A kernel, (node, *tensors) → tuple of tensors."""

        @staticmethod
        def forward(node: Differentiable, *tensors: Any) -> tuple[Any, ...]:
            own = node.kernel.dtype
            arrays = [np.asarray(np.from_dlpack(tensor.detach().cpu()), own) for tensor in tensors]
            first = tensors[0]
            return tuple(package.from_dlpack(each).to(first.device, first.dtype) for each in node(*arrays))

        @staticmethod
        def setup_context(ctx: Any, inputs: tuple[Any, ...], output: tuple[Any, ...]) -> None:
            ctx.node = inputs[0]
            ctx.save_for_backward(*inputs[1:])
            ctx.save_for_forward(*inputs[1:])

        @staticmethod
        def backward(ctx: Any, *gradients: Any) -> tuple[Any, ...]:
            node, tensors = ctx.node, ctx.saved_tensors
            active = tuple(place for place in range(len(tensors)) if ctx.needs_input_grad[place + 1])
            slopes = iter(_slopes(node, active, tensors))
            found: list[Any] = [None] * len(tensors)
            for place in active:
                sums: Any = 0.0
                for gradient, port in zip(gradients, node.outputs, strict=True):
                    lead = gradient.shape[: gradient.ndim - len(port.shape)]
                    column = gradient.reshape(*lead, port.size, 1)
                    sums = sums + (next(slopes).reshape(*lead, port.size, -1).mT @ column)
                shaped = sums.reshape((*sums.shape[:-2], *node.inputs[place].shape))
                found[place] = shaped.sum_to_size(tensors[place].shape)
            return (None, *found)

        @staticmethod
        def jvp(ctx: Any, _: Any, *tangents: Any) -> tuple[Any, ...]:
            node, tensors = ctx.node, ctx.saved_tensors
            active = tuple(place for place, each in enumerate(tangents) if each is not None)
            slopes = iter(_slopes(node, active, tensors))
            sums: list[Any] = [0.0] * len(node.outputs)
            for place in active:
                inner, tangent = node.inputs[place], tangents[place]
                column = tangent.reshape(*tangent.shape[: tangent.ndim - len(inner.shape)], inner.size, 1)
                for k, port in enumerate(node.outputs):
                    slope = next(slopes)
                    lead = slope.shape[: slope.ndim - len(port.shape) - len(inner.shape)]
                    product = slope.reshape(*lead, port.size, inner.size) @ column
                    sums[k] = sums[k] + product.reshape((*lead, *port.shape))
            return tuple(sums)

        @staticmethod
        def vmap(info: Any, in_dims: tuple[Any, ...], node: Differentiable, *tensors: Any) -> tuple[Any, Any]:
            pairs = zip(tensors, in_dims[1:], strict=True)
            moved = [tensor[None] if axis is None else tensor.movedim(axis, 0) for tensor, axis in pairs]
            return Called.apply(node, *moved), (0,) * len(node.outputs)

    def _slopes(node: Differentiable, active: tuple[int, ...], tensors: tuple[Any, ...]) -> tuple[Any, ...]:
        return Called.apply(node.slopes(active), *tensors) if active else ()

    return Called

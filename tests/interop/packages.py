"""JAX and PyTorch under one set of names, with NumPy arrays in and out."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

import armwright as aw


class Jax:
    """JAX with 64-bit numbers."""

    def __init__(self):
        self.jax = pytest.importorskip("jax")
        self.jax.config.update("jax_enable_x64", True)
        self.function = aw.interop.jax
        self.func = self.jax
        self.error = Exception

    def array(self, values):
        return self.jax.numpy.asarray(values)

    def transforms(self):
        """jacfwd, jacrev, vmap, hessian; jit is in all of them."""
        jax = self.jax
        return tuple(lambda *a, by=each: jax.jit(by(*a)) for each in (jax.jacfwd, jax.jacrev, jax.vmap, jax.hessian))


class Torch:
    """PyTorch with the transforms of torch.func."""

    def __init__(self):
        self.torch = pytest.importorskip("torch")
        self.function = aw.interop.torch

    def array(self, values):
        return self.torch.from_numpy(np.array(values))

    def transforms(self):
        """jacfwd, jacrev, vmap, hessian."""
        func = importlib.import_module("torch.func")
        return func.jacfwd, func.jacrev, func.vmap, func.hessian


PACKAGES = {"jax": Jax, "torch": Torch}

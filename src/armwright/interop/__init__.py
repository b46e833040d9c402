"""Kernels of an arm in other packages' differentiable programs: JAX and PyTorch."""

from armwright.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__)

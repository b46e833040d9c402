"""Sweeps: simulations of more lanes than fit one process, in chunks that are stored as they finish."""

from armwright.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__)

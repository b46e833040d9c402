"""Motions: positions of the arm as functions of time, and their limits."""

from armwright.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__)

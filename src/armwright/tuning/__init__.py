"""Tuning: search for the gains of a scenario's controller over many simulations, under a margin constraint."""

from armwright.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__)

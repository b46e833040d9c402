"""Identification: parameters with error bars from logs of measurements, and a verdict on data that the fit did not use."""

from armwright.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__)

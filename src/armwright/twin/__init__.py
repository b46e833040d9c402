"""The simulated arm as CiA 402 drives on a CAN bus, and the master that runs a scenario's controller over that bus."""

from armwright.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__)

"""Shadow: a model run beside its arm, with residuals of torque and position, and alarms with their cause."""

from armwright.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__)

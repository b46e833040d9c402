"""Export of an arm or a controller: C for microcontrollers, FMU, URDF, MJCF, ROS 2."""

from armwright.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__)

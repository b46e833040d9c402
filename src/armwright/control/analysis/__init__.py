"""Analysis of sampled loops: linear maps at a pose, margins, and their range over the workspace."""

from armwright.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__)

"""Moving and interactive pictures: animated glTF, a page with a player, plots with zoom."""

from armwright.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__)

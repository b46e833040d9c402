"""Arms from modules: the library, assembly, every arm that a library can make, and the best of them for a task."""

from armwright.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__)

"""Robot files: compare two, check one, convert one to another format, start a new one."""

from armwright.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__)

"""Distances of an arm's links from each other and from obstacles, by capsules."""

from armwright.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__)

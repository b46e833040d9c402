"""Frozen all the way down: what a frozen dataclass holds cannot be changed in place either."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from armwright import scalar


class Frozen:
    """Parent of frozen dataclasses: their arrays become read-only copies, of floats unless a Symbol is inside, and
    their mappings read-only. Copies and pickles are made anew from the fields, and so are as frozen.
    """

    def __post_init__(self) -> None:
        for name, value in _fields(self).items():
            kept = _kept(value)
            if kept is not value:
                object.__setattr__(self, name, kept)

    def __reduce__(self) -> tuple[Any, ...]:
        values = (dict(value) if isinstance(value, Mapping) else value for value in _fields(self).values())
        return type(self), tuple(values)


def _fields(thing: Any) -> dict[str, Any]:
    return {name: getattr(thing, name) for name in _names(type(thing))}


@cache
def _names(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind))


def _kept(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        if not value.flags.writeable and value.base is None:
            return value  # frozen before: an array that owns its numbers
        copy = np.array(value) if value.dtype == np.float64 else scalar.array(value)
        copy.flags.writeable = False
        return copy
    return MappingProxyType(dict(value)) if isinstance(value, Mapping) else value

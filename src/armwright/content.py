"""Checksums of values by their content: equal in every process for values that are equal."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Mapping, Set
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

PLAIN = (bool, int, float, complex, str, bytes, Path, range)  # what says by its text which it is


def checksum(value: Any) -> str:
    """SHA-256 of all that a value holds: numbers, texts, arrays, containers, fields of objects, code of functions.

    Of a class its name alone counts, and of a function not what it uses from its module. An object that says how it is copied
    (`__reduce__`, `__getstate__`) counts by that: of a compiled arm the arm and its settings, not the code compiled so far.
    """
    hashed = hashlib.sha256()

    def add(piece: bytes) -> None:
        hashed.update(piece + b"\n")

    _add(add, value, frozenset())
    return hashed.hexdigest()


def _add(add: Callable[[bytes], None], value: Any, within: frozenset[int]) -> None:
    """Adds bytes that are equal for equal values in every process; pickles are not."""
    if id(value) in within:
        add(b"itself")
        return
    add(type(value).__qualname__.encode())
    if value is None or isinstance(value, PLAIN):
        add(repr(value).encode())
        return
    inner = within | {id(value)}
    if isinstance(value, Enum):
        add(value.name.encode())
    elif isinstance(value, (np.ndarray, np.generic)) and value.dtype != object:
        add(f"{value.dtype.str} {value.shape}".encode())
        add(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, (list, tuple, np.ndarray)):
        add(str(len(value)).encode())
        for each in value:
            _add(add, each, inner)
    elif isinstance(value, Set):
        for piece in sorted(_joined(each, inner) for each in value):
            add(piece)
    else:
        _add_object(add, value, inner)


def _joined(value: Any, within: frozenset[int]) -> bytes:
    pieces: list[bytes] = []
    _add(pieces.append, value, within)
    return b"".join(pieces)


def _add_object(add: Callable[[bytes], None], value: Any, within: frozenset[int]) -> None:
    """Adds bytes of a mapping, a dataclass, a function or another object, by its fields."""
    if isinstance(value, Mapping):
        items = {str(key): each for key, each in value.items()}
    elif isinstance(value, type):
        items = {"module": value.__module__, "name": value.__qualname__}
    elif is_dataclass(value):
        items = {each.name: getattr(value, each.name) for each in fields(value)}
    elif hasattr(value, "__code__"):
        closed = [cell.cell_contents for cell in value.__closure__ or ()]
        constants = [each for each in value.__code__.co_consts if not hasattr(each, "co_code")]
        items = {"code": value.__code__.co_code, "constants": constants, "closed": closed, "of": value.__defaults__}
    elif hasattr(value, "model_dump"):
        items = value.model_dump()
    elif hasattr(value, "__func__"):
        items = {"method": value.__func__, "of": value.__self__}
    elif type(value).__reduce__ is not object.__reduce__:
        items = {"made by": value.__reduce__()}
    elif type(value).__getstate__ is not object.__getstate__:
        items = {"state": value.__getstate__()}
    else:
        items = dict(getattr(value, "__dict__", {}))
        if not items:
            items = {"pickle": pickle.dumps(value, protocol=5)}
    add(str(len(items)).encode())
    for name, each in items.items():
        add(name.encode())
        _add(add, each, within)

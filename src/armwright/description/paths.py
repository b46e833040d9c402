"""Numbers of a record by dotted path: `link3.mass_kg`, `joint2.friction.viscous_n_m_s_per_rad`, `gravity_m_s2`.

A name with dots or spaces stands in quotes, as in TOML: `"joint_0.0".motor.gear_ratio`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from armwright.quantity import Quantity, Reading, Record

UNNAMEABLE = re.compile(r'["\[\]\x00-\x1f\x7f-\x9f\u2028\u2029\ufeff]')  # what readers of other formats replace by _
PLAIN = re.compile(r"[^\s.]+")  # names that stand without quotes
HEAD = re.compile(r'"(?P<quoted>[^"]+)"(?=\.|$)|(?P<plain>[^.]*)')


def path_name(name: str) -> str:
    """A name as paths have it: in quotes where it holds dots or spaces."""
    return name if PLAIN.fullmatch(name) else f'"{name}"'


def split_path(path: str) -> tuple[str, str]:
    """The name that a path begins with, without its quotes, and the rest behind the dot.

    `split_path('"joint_0.0".motor.gear_ratio')` → ("joint_0.0", "motor.gear_ratio").
    """
    head = HEAD.match(path)
    assert head is not None
    return head["quoted"] or head["plain"], path[head.end() + 1 :]


def quantities(record: Record, *, pictures: bool = True) -> Iterator[tuple[str, Quantity, str | None]]:
    """Every quantity below a record: its dotted path, itself, and the source that holds for it.

    Args:
        record: where to look.   pictures: whether those of visuals count, which no dynamics read.
    """

    def walk(value: Any, path: str, source: str | None) -> Iterator[tuple[str, Quantity, str | None]]:
        if isinstance(value, Quantity):
            yield path, value, value.source or source
        else:
            nearest_source = getattr(value, "source", None) or source if isinstance(value, Record) else source
            for name, child in below(value, path):
                if pictures or not name.endswith(".visuals"):
                    yield from walk(child, name, nearest_source)

    yield from walk(record, "", None)


def with_values(record: Any, values: Mapping[str, Any], path: str = "") -> Any:
    """A record with other values at some paths, numbers or symbols, unchecked."""
    if isinstance(record, Quantity):
        return Quantity.model_construct(**{**dict(record), "value": values[path]}) if path in values else record
    pairs = [(child, with_values(child, values, name)) for name, child in below(record, path)]
    if all(new is old for old, new in pairs):
        return record
    if isinstance(record, tuple):
        return tuple(new for _, new in pairs)
    fields = zip(type(record).model_fields, pairs, strict=True)
    return record.model_copy(update={name: new for name, (old, new) in fields if new is not old})


UNITS = {
    "kg": "kg", "m": "m", "m2": "m²", "m3": "m³", "s": "s", "s2": "s²", "n": "N", "v": "V", "a": "A", "w": "W", "j": "J",
    "k": "K", "c": "°C", "hz": "Hz", "ohm": "Ω", "h": "H", "f": "F", "rad": "rad", "rad2": "rad²", "rad3": "rad³", "deg": "°",
}  # fmt: skip
"""Endings of keys → their unit."""


def unit_at(path: str) -> str:
    """The unit that a key states: `unit_at("joint2.friction.viscous_n_m_s_per_rad")` → "N m s/rad"; "1" where it states none."""
    rest = split_path(path)[1] or path  # names of joints and links state no unit
    for key in reversed(rest.split("[")[0].split(".")):
        over, _, under = key.partition("_per_")
        words, units = over.split("_"), []
        while len(words) > 1 and words[-1] in UNITS:
            units.insert(0, UNITS[words.pop()])
        if under:
            return f"{' '.join(units) or '1'}/{' '.join(UNITS.get(word, word) for word in under.split('_'))}"
        if units == ["m", "s²"]:  # of an acceleration, in the report's way
            return "m/s²"
        if units:
            return " ".join(units)
    return "1"


def reading_at(record: Record, path: str) -> Reading:
    """Reading of the quantity at a path: the allowed values."""
    parent, field = next(_fields(record, path, ""))
    info = type(parent).model_fields[field]
    annotations = (info.metadata, *(getattr(kind, "__metadata__", ()) for kind in get_args(info.annotation)))
    return next(note for metadata in annotations for note in metadata if isinstance(note, Reading))


def _fields(value: Any, wanted: str, path: str) -> Iterator[tuple[Record, str]]:
    """The record that holds the quantity at a path, and the name of its field there."""
    for name, child in below(value, path):
        if isinstance(child, Quantity):
            if name == wanted:
                yield value, name.rsplit(".", 1)[-1]
        elif wanted.startswith(name) or not isinstance(
            child, Record
        ):  # lists are not named in the paths of their items
            yield from _fields(child, wanted, name)


def below(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Items directly below a record or a list, by path. Links, joints and frames go by their own names."""
    if isinstance(value, Record):
        for name in type(value).model_fields:
            yield f"{path}.{name}" if path else name, getattr(value, name)
    elif isinstance(value, tuple):
        for k, item in enumerate(value):
            own = getattr(item, "name", None) if "." not in path else None
            yield (f"{path}[{k}]" if own is None else path_name(own)), item

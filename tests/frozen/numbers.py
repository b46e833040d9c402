"""Numbers that public functions answer with, as `numbers/` keeps them: every value of a result, and what differs from it.

A case is a call; what it returns is taken apart into named values: tables of a result and its sentences, fields of a dataclass,
variables of a dataset, files of a folder. Values whose names differ in a number stand together, as `joints.*.mass`. Long arrays
are kept as sums, long texts and files as digests.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from armwright.results.result import Result

FOLDER = Path(__file__).with_name("numbers")
ROOMS = tuple(sorted(path.stem for path in Path(__file__).with_name("cases").glob("[a-z]*.py")))
LONG = 40  # entries of a column that are kept one by one
WHOLE = 6  # entries of an array that are kept one by one
DIGITS = 8  # that are kept
CLOSE = 1e-6  # of a value: libraries and processors differ in the last bits
ROUNDED = 1e-3  # of that, of the largest of its list
NOT_FINITE = ("nan", "inf", "-inf")  # as they are kept
SUMS = "sums"  # begins what is kept of a long array
DEEP = 6  # levels of fields


@dataclass(frozen=True)
class Case:
    """A call, and how exactly its numbers are those of other machines.

    Attributes:
        call: takes an empty folder.   close: largest difference, relative.   ignored: parts of names of values that are rounding
            or differ from one machine to another.   study: True: it takes seconds, and `make test-all` alone runs it.
    """

    call: Callable[[Path], Any]
    close: float = CLOSE
    ignored: tuple[str, ...] = ()
    study: bool = False


@cache
def cases(room: str) -> dict[str, Case]:
    """The cases of a room by name, from `cases/`."""
    found = importlib.import_module(f"frozen.cases.{room}").CASES
    return {name: each if isinstance(each, Case) else Case(each) for name, each in found.items()}


def kept(room: str) -> dict[str, Any]:
    """Frozen values of a room: case → name → value."""
    path = FOLDER / f"{room}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def computed(room: str, name: str, folder: Path) -> dict[str, Any]:
    """Values of a case, computed now."""
    case = cases(room)[name]
    found = dict(_parts("", case.call(folder), DEEP))
    return _together({key: value for key, value in found.items() if not any(word in key for word in case.ignored)})


def _together(found: Mapping[str, Any]) -> dict[str, Any]:
    """Single values whose names differ in numbers alone, as lists."""
    groups: dict[str, list[Any]] = {}
    for name, value in found.items():
        alike = ".".join("*" if each.isdigit() else each for each in name.split("."))
        alike += " in words" if isinstance(value, str) and value not in NOT_FINITE and alike != name else ""
        groups.setdefault(name if isinstance(value, list) else alike, []).append(value)
    return {name: _column(values) if len(values) > 1 else values[0] for name, values in groups.items()}


def differing(before: Mapping[str, Any], now: Mapping[str, Any], close: float = CLOSE) -> list[str]:
    """A line for each value that changed, came or went."""
    return [
        f"{name}: {before.get(name, 'nothing')} → {now.get(name, 'nothing')}"
        for name in [*before, *(each for each in now if each not in before)]
        if name not in before or name not in now or not alike(before[name], now[name], close)
    ]


def alike(before: Any, now: Any, close: float) -> bool:
    """True where two values are as near as `close` asks. Rounding of the largest number of a list is none of a small one's."""
    if not (isinstance(before, list) and isinstance(now, list)):
        before, now = [before], [now]
    scale = max((abs(each) for each in before if _is_number(each)), default=0.0)
    absolute = close * scale * (1.0 if before[:1] == [SUMS] else ROUNDED)
    return len(before) == len(now) and all(
        abs(a - b) <= max(absolute, close * max(abs(a), abs(b))) if _is_number(a) and _is_number(b) else a == b
        for a, b in zip(before, now, strict=True)
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)


def _parts(name: str, value: Any, deep: int) -> Iterator[tuple[str, Any]]:
    """The values in a result, each with its path."""
    at = f"{name}." if name else ""
    match value:
        case None | bool() | int() | float() | np.bool_() | np.number():
            yield name, _number(value)
        case str() | bytes():
            yield name, _text(value)
        case np.ndarray():
            yield name, _array(value)
        case Path():
            yield from _files(value)
        case Result():
            yield from _result(at, value)
        case xr.Dataset() | xr.DataArray():
            each = value.data_vars if isinstance(value, xr.Dataset) else {"values": value}
            for key in sorted(map(str, each)):
                yield f"{at}{key}", _array(each[key].values)
        case Mapping():
            for key in value:
                yield from _parts(f"{at}{key}", value[key], deep - 1)
        case list() | tuple() if all(_is_number(each) for each in value):
            yield name, _array(np.array(value))
        case list() | tuple():
            for k, each in enumerate(value):
                yield from _parts(f"{at}{k}", each, deep - 1)
        case _ if is_dataclass(value) and deep > 0:
            for field in fields(value):
                if not field.name.startswith("_"):
                    yield from _parts(f"{at}{field.name}", getattr(value, field.name), deep - 1)


def _result(at: str, value: Result) -> Iterator[tuple[str, Any]]:
    """Columns of its tables, and its sentences with the numbers in them as they are rounded there."""
    for k, table in enumerate(value.tables()):
        rows = table.rows()
        for column in rows[0] if rows else ():
            values = [row[column] for row in rows]
            if any(each is not None for each in values):
                yield f"{at}{k}.{column}", _column(values)
    yield f"{at}sentences", value.sentences()
    yield f"{at}good", value.good


def _column(values: list[Any]) -> Any:
    """Entries of a table's column; of a long one what `_array` keeps."""
    simple = [
        each if each is None or isinstance(each, bool | float | int | np.generic) else str(each) for each in values
    ]
    if len(simple) <= LONG:
        return [each if isinstance(each, str) else _number(each) for each in simple]
    words = any(isinstance(each, str) and each not in NOT_FINITE for each in simple)
    return _array(np.array(simple, str if words else float))


def as_text(found: Mapping[str, Mapping[str, Any]]) -> str:
    """JSON with a line for each case."""
    lines = [f"{json.dumps(name)}: {json.dumps(values, ensure_ascii=False)}" for name, values in found.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _number(value: Any) -> Any:
    if value is None or isinstance(value, bool | np.bool_):
        return None if value is None else bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    return float(f"{float(value):.{DIGITS}g}") if math.isfinite(value) else str(float(value))


def _array(values: np.ndarray) -> Any:
    """Its entries; of many the sum of their sizes, two sums with weights, the shape, and how many are finite."""
    if values.dtype.kind not in "fiub":
        return _text(json.dumps(values.astype(str).tolist()))
    if values.size <= WHOLE:
        return [_number(each) for each in values.ravel().tolist()]
    flat = values.ravel().astype(float)
    finite = np.isfinite(flat)
    flat, place = np.where(finite, flat, 0.0), np.arange(flat.size)
    weights = np.cos(place), np.cos(0.618 * place + 1.0)
    size = float(np.abs(flat).sum())
    return [SUMS, *map(_number, (size, *(flat @ each for each in weights))), *values.shape, int(finite.sum())]


def _text(value: str | bytes) -> str:
    """A short text itself, of a long one its digest."""
    if isinstance(value, str) and len(value) < 120:
        return value
    return hashlib.sha256(value.encode() if isinstance(value, str) else value).hexdigest()[:16]


def _files(path: Path) -> Iterator[tuple[str, str]]:
    """Digests of the files of a folder, without versions of the package and dates."""
    for each in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if each.is_file():
            text = re.sub(rb"\d+\.\d+\.\d+(?:\.dev\d+)?|\d{4}-\d\d-\d\d", b"", each.read_bytes())
            yield str(each.relative_to(path) if path.is_dir() else each.name), _text(text)

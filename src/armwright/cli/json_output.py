"""Option `--json`: the results of a command as one JSON document on standard output.

    {"command": "simulate",
     "tables": [{"title": "at the end, t = 1 s", "units": {"q": "rad"}, "rows": [{"joint": "joint1", "q": 0.27041…}]}],
     "results": [],                     objects that the command computed, field by field
     "text": ["two-link: 1 s in …"]}    lines that it shows beside tables

Every command shows through `armwright.terminal`, so that this is the only place that knows of JSON. Numbers have all their
digits, NaN and infinity are null, and notes, warnings and errors stay on standard error.
"""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from math import isfinite
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armwright.results.table import Table
from armwright.terminal import PrintableStream, gathered

if TYPE_CHECKING:
    import numpy as np

MOST = 10_000  # numbers of an array that is written; a longer one belongs into a file
DEEPEST = 6  # objects in objects
JSON = Annotated[bool, typer.Option("--json", help="Print one JSON document in place of tables, with all digits.")]


def with_json(command: Callable[..., None], name: str) -> Callable[..., None]:
    """The command with an option --json; the document is written when the command ends, whatever its exit code.

    Args:
        command: the function, whose parameters typer reads.   name: how users call it.
    """

    def run(*args: Any, as_json: bool = False, **options: Any) -> None:
        if not as_json:
            return command(*args, **options)
        stopped = None
        with gathered() as things:
            try:
                command(*args, **options)
            except typer.Exit as stop:
                stopped = stop
        text = json.dumps(document(name, things), indent=1, ensure_ascii=False, allow_nan=False)
        PrintableStream(sys.stdout).write(text + "\n")
        if stopped is not None:
            raise stopped

    signature = inspect.signature(command, eval_str=True)
    option = inspect.Parameter("as_json", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=JSON)
    parameters = [*signature.parameters.values(), option]
    run.__doc__, run.__name__, run.__module__ = command.__doc__, command.__name__, command.__module__
    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    return run


def document(command: str, things: Iterable[Any]) -> dict[str, Any]:
    """The JSON document of a command's results.

    Args:
        command: its name.   things: texts, tables and results, in order.
    """
    tables, results, lines = [], [], []
    for thing in _flat(things):
        if isinstance(thing, Table):
            tables.append(_table(thing))
        elif is_dataclass(thing) and not isinstance(thing, type):
            results.append({"kind": type(thing).__name__, **_value(thing, DEEPEST)})
        elif isinstance(thing, Mapping):
            results.append(_value(thing, DEEPEST))
        else:
            lines += [line.strip() for line in str(thing).splitlines() if line.strip()]
    return {"command": command, "tables": tables, "results": results, "text": lines}


def _flat(things: Iterable[Any]) -> Iterator[Any]:
    """The items of nested rich groups as one flat list."""
    from rich.console import Group

    for thing in things:
        if isinstance(thing, Group):
            yield from _flat(thing.renderables)
        elif thing is not None:
            yield thing


def _table(table: Table) -> dict[str, Any]:
    rows = [{name: _value(cell, 0) for name, cell in row.items()} for row in table.rows()]
    return {"title": (table.title or "").strip(), "units": table.units, "rows": rows}


NAMED = ("Model", "RobotDescription", "Scenario")  # what a command was given: its name says enough
LEFT_OUT = object()  # of a value that is not made of numbers and words


def _value(value: Any, depth: int) -> Any:
    """A value of numbers, words, lists and mappings; a dataclass by its public fields."""
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, (int, float)):
        return value if isfinite(value) else None
    if hasattr(value, "tolist") and hasattr(value, "size"):
        return _array(value)
    if depth == 0:
        return LEFT_OUT
    if type(value).__name__ in NAMED:
        return getattr(value, "name", LEFT_OUT)
    if is_dataclass(value) and not isinstance(value, type):
        inside = {each.name: getattr(value, each.name) for each in fields(value) if not each.name.startswith("_")}
        return _mapping(inside, depth)
    if isinstance(value, Mapping) and not hasattr(value, "data_vars"):
        return _mapping(value, depth)
    if isinstance(value, Sequence):
        inner = [_value(each, depth - 1) for each in value]
        return inner if LEFT_OUT not in inner else LEFT_OUT
    return LEFT_OUT


def _mapping(pairs: Mapping[Any, Any], depth: int) -> dict[str, Any]:
    inner = {str(name): _value(each, depth - 1) for name, each in pairs.items()}
    return {name: each for name, each in inner.items() if each is not LEFT_OUT}


def _array(values: np.ndarray) -> Any:
    import numpy as np

    array = np.asarray(values)
    if array.size > MOST or array.dtype.kind not in "biufU":
        return LEFT_OUT
    if array.dtype.kind != "f":
        return array.tolist()
    finite = np.isfinite(array)
    return array.tolist() if finite.all() else np.where(finite, array.astype(object), None).tolist()  # type: ignore[arg-type]

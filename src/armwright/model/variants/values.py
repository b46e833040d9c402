"""An arm with other values of some numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from armwright.description.paths import path_name, quantities, reading_at
from armwright.description.robot import RobotDescription
from armwright.errors import DescriptionError, Problem, check_known
from armwright.model.variants.edits import CHOSEN, replaced
from armwright.quantity import Quantity, Record
from armwright.validation import Invalid


def with_values(robot: RobotDescription, values: Mapping[str, Any], source: str = CHOSEN) -> RobotDescription:
    """The description with other values of some of its numbers, checked as if a file had them.

    Args:
        robot: the description.
        values: by dotted path, such as {"link6.mass_kg": 2.0, "link6.com_m": [0, 0, 0.1], "link1.com_m[2]": 0.2}.
        source: where the new values come from, a key of the description's sources or a kind such as "measurement".
    Raises:
        DescriptionError: no number at a path, or a value that cannot stand there.
    """
    known = {path: quantity for path, quantity, _ in quantities(robot)}
    changes: dict[str, Quantity] = {}
    for name, value in values.items():
        path, entry = _split(name, known)
        check_known(DescriptionError, path, known, "no such number", place="with_values", file=robot.name)
        whole = value
        if entry is not None:
            old = changes.get(path, known[path]).value
            if not isinstance(old, tuple) or entry >= len(old):
                raise DescriptionError("no such entry", place="with_values", value=name, file=robot.name)
            whole = (*old[:entry], value, *old[entry + 1 :])
        try:
            read = reading_at(robot, path)(whole.tolist() if isinstance(whole, np.ndarray) else whole)
        except ValueError as error:
            problem = replace(error.problems[0] if isinstance(error, Invalid) else Problem(str(error)), value=value)
            raise DescriptionError.of(problem.within(f"with_values: {name}", robot.name)) from None
        changes[path] = Quantity(**{"source": source, **(read if isinstance(read, dict) else dict(read))})
    fields = {name: _with(getattr(robot, name), changes, name) for name in ("gravity_m_s2", "supply")}
    lists = {
        name: tuple(_with(item, changes, path_name(item.name)) for item in getattr(robot, name))
        for name in ("joints", "links", "frames", "cylinders")
    }
    return replaced(robot, "with_values", **fields, **lists)


def _split(name: str, known: Mapping[str, Any]) -> tuple[str, int | None]:
    """`link6.com_m[2]` is entry 2 of the numbers at `link6.com_m`."""
    path, bracket, rest = name.rpartition("[")
    if name not in known and bracket and rest.endswith("]") and rest[:-1].isdigit():
        return path, int(rest[:-1])
    return name, None


def _with(value: Any, changes: Mapping[str, Quantity], path: str) -> Any:
    """A record or list with other quantities, checked from the inside out."""
    if isinstance(value, Quantity):
        return changes.get(path, value)
    if isinstance(value, tuple):
        return tuple(_with(item, changes, f"{path}[{k}]") for k, item in enumerate(value))
    if not isinstance(value, Record) or not any(name.startswith(f"{path}.") for name in changes):
        return value
    fields = {name: getattr(value, name) for name in type(value).model_fields}
    new = {name: _with(item, changes, f"{path}.{name}") for name, item in fields.items()}
    changed = {name: item for name, item in new.items() if item is not fields[name]}
    try:
        return value.replace(**changed) if changed else value
    except DescriptionError as error:
        raise error.within(f"with_values: {path}") from None

"""What differs between two descriptions of an arm, number by number; pictures do not count."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from armwright.description.paths import quantities
from armwright.description.robot import RobotDescription


@dataclass(frozen=True)
class Change:
    """A number that is another one now.

    Args:
        path: as `provenance` takes it.   before, after: the values; None: there was, or is, no such number.
    """

    path: str
    before: float | tuple[float, ...] | None
    after: float | tuple[float, ...] | None


def changes(before: RobotDescription, after: RobotDescription) -> list[Change]:
    """Every number that differs, those of `after` in its order and then what it has lost."""
    old, new = _numbers(before), _numbers(after)
    found = [Change(path, old.get(path), value) for path, value in new.items() if old.get(path) != value]
    return found + [Change(path, value, None) for path, value in old.items() if path not in new]


def _numbers(robot: RobotDescription) -> dict[str, Any]:
    return {path: quantity.value for path, quantity, _ in quantities(robot, pictures=False)}

"""The description of an arm, for functions that write or check descriptions and are given either."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from armwright.description.robot import RobotDescription
from armwright.errors import ModelError


class Arm(Protocol):
    """An arm with the description that it was built from, as `armwright.Model` is."""

    @property
    def record(self) -> RobotDescription:
        """The description."""
        ...

    @property
    def changes(self) -> Mapping[str, Any]:
        """Changes that the description does not have."""
        ...


def record_of(arm: RobotDescription | Arm) -> RobotDescription:
    """The description of an arm; a description is its own.

    Raises:
        ModelError: neither of both, an arm without a description, or one with changes that no description holds.
    """
    if isinstance(arm, RobotDescription):
        return arm
    if isinstance(arm, (str, bytes)) or not hasattr(arm, "record"):
        raise ModelError(value=arm, expected="an arm or its description; load it first: aw.load(NAME or PATH)")
    record = arm.record
    if arm.changes:
        raise ModelError(
            f"differs from its description by replace({', '.join(f'{name}=…' for name in arm.changes)})",
            value=record.name,
            expected="an arm as its description has it; arm.description is that of the arm before",
        )
    return record

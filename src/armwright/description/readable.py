"""The readable part of a refused robot file, in which further mistakes can be found."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pydantic

from armwright.description.robot import JOINTS, Joint, Link, RobotDescription

LISTS = {"joints": Joint, "links": Link}  # of which a table that cannot be read leaves its names behind
NAMES = ("name", "parent", "child")


def readable_robot(data: Any, folder: Path | None) -> tuple[RobotDescription, list[str]]:
    """A robot from the tables of a document that can be read, unchecked, and the names of joints that cannot.

    Of a joint or a link that cannot be read only the names stay: it has no motor, no friction and no mass (None).

    Args:
        data: a document that is no valid robot.   folder: where the paths of meshes start.
    """
    fields: dict[str, Any] = {"name": "robot", "joints": (), "links": (), "frames": ()}
    unread: list[str] = []
    data = data if isinstance(data, Mapping) else {}
    for key in RobotDescription.model_fields:
        value = data.get(key)
        if key in LISTS and isinstance(data.get(key[:-1]), list):  # [[joint]], which is reported as such
            value = [*(value if isinstance(value, list) else ()), *data[key[:-1]]]
        if value is None:
            continue
        if key not in LISTS:
            read = _read(key, value, folder)
            fields[key] = _instead(key, value) if read is None else read
            continue
        tables = [table for table in value if _has_names(table, key)] if isinstance(value, list) else []
        records = [_read(key, table, folder) for table in tables]
        fields[key] = tuple(record or _bare(key, table) for record, table in zip(records, tables, strict=True))
        if key == "joints":
            unread = [table["name"] for record, table in zip(records, tables, strict=True) if record is None]
    if fields.get("frames") is None:  # the tip may be one of them
        fields["tip"] = None
    given = {key: value for key, value in fields.items() if value is not None}
    return RobotDescription.model_construct(**given), unread


def _instead(key: str, value: Any) -> Any:
    """Replacement for an unreadable field, so that the rest can be checked; None: its default."""
    if key == "sources":
        return dict.fromkeys(value) if isinstance(value, Mapping) else None
    return {"name": "robot", "source": "estimate", "command": "torque"}.get(key)


@cache
def _adapter(key: str) -> pydantic.TypeAdapter[Any]:
    return pydantic.TypeAdapter(LISTS.get(key) or RobotDescription.model_fields[key].rebuild_annotation())


def _read(key: str, value: Any, folder: Path | None) -> Any:
    """A value as what a field of a robot, or a table of a list, holds, or None."""
    try:
        return _adapter(key).validate_python(value, context={"folder": folder})
    except pydantic.ValidationError:
        return None


def _has_names(table: Any, key: str) -> bool:
    names = NAMES if key == "joints" else NAMES[:1]
    return isinstance(table, Mapping) and all(isinstance(table.get(name), str) for name in names)


def _bare(key: str, table: Mapping[str, Any]) -> Any:
    """A joint or a link of which only names are known."""
    if key == "links":
        return Link.model_construct(name=table["name"], mass_kg=None, com_m=None, inertia_kg_m2=None)
    return JOINTS["revolute"].model_construct(type="revolute", **{name: table[name] for name in NAMES})

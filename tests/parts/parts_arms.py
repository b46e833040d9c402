"""Parts databases for tests."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

from armwright.description.built_from import BuiltFrom
from armwright.parts.build import PartsBuild, arm_of_parts
from armwright.parts.records import PartsDatabase
from armwright.validation import validated

HERE = {"xyz_m": [0.0, 0.0, 0.0], "rpy_rad": [0.0, 0.0, 0.0]}
ORIGIN = BuiltFrom(file="arm.parts.toml", sha256="0" * 64)


def section(name: str = "block", **changes: Any) -> dict[str, Any]:
    """A box of 2 litres, unless changed."""
    return {"name": name, "solid": {"shape": "box", "size_m": [0.1, 0.1, 0.2]}, **HERE, **changes}


def part(*sections: dict[str, Any], name: str = "10-01", **changes: Any) -> dict[str, Any]:
    """A steel part at the origin of its link."""
    return {"name": name, "material": "steel", **HERE, "sections": list(sections), **changes}


def document(*parts: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """An arm of one link."""
    joint = {"name": "j", "type": "revolute", "parent": "base", "child": "arm"}
    row = {"alpha_rad": 0.0, "r_m": 0.0, "a_m": 0.0, "offset_rad": 0.0}
    link = {"name": "arm", "parts": list(parts)}
    if "frame" in changes:
        link["frame"] = changes.pop("frame")
    head = {"name": "one", "source": "drawing", "command": "torque"}
    return copy.deepcopy({**head, "joints": [{**joint, "dh": row}], "links": [link], **changes})  # nothing shared


def database(*parts: dict[str, Any], folder: Path | None = None, **changes: Any) -> PartsDatabase:
    """The document, read."""
    return validated(PartsDatabase, document(*parts, **changes), file="arm.parts.toml", folder=folder)


def built(*parts: dict[str, Any], folder: Path | None = None, **changes: Any) -> PartsBuild:
    """The document, read and built."""
    return arm_of_parts(database(*parts, folder=folder, **changes), ORIGIN)

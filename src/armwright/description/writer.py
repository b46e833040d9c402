"""A description as the text of its TOML database: canonical, so that equal descriptions are equal bytes.

One line a key, in the order of the records; what is absent or at its default is left out; floats as the shortest text
that reads back as the same bits. Joints stand before the link that they move.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from re import fullmatch
from typing import Any

from armwright.description.record_of import Arm, record_of
from armwright.description.robot import RobotDescription
from armwright.errors import OutputError
from armwright.output import whole_file
from armwright.quantity import Quantity, Record
from armwright.solids.mesh import Mesh

FIRST = ("source", "name", "type", "parent", "child")  # of a table, whatever the order of its record
# that have a heading of their own; others stand in one line
TABLES = ("motor", "friction", "limits", "spring", "built_from")
LISTS = ("joints", "links", "frames", "cylinders")


def to_toml(arm: Arm | RobotDescription, folder: str | os.PathLike[str] | None = None) -> str:
    """The TOML database of an arm. Reading it gives the description back, and writing that the same bytes.

    Args:
        arm: the arm or its description, which is written with every source, standard deviation and date.
        folder: where the file will stand; paths of meshes are written relative to it. None: as they are.
    Returns:
        text: the file.
    Raises:
        OutputError: a mesh that is not below the folder.
        ModelError: no arm, one without a description, or one that `replace` changed, which no description holds.
    Example:
        >>> aw.robotfiles.to_toml(aw.load("two-link")).splitlines()[0]
        'name = "two-link"'
    """
    description = record_of(arm)
    place = None if folder is None else Path(folder).resolve()
    head = {
        name: value
        for name, value in _present_fields(description).items()
        if name not in (*LISTS, "sources", "built_from", "fits")
    }
    blocks = ["".join(_lines(head, place))]
    if description.built_from is not None:
        blocks.append(_table("[built_from]", description.built_from, place))
    for key, source in description.sources.items():
        blocks.append(_table(f"[sources.{_key(key)}]", source, place))
    for key, fit in description.fits.items():
        blocks.append(_table(f"[fits.{_key(key)}]", fit, place))
    waiting, moved = list(description.links), set()
    for joint in description.joints:
        moved.add(joint.child)
        blocks.append(_table("[[joints]]", joint, place, "joints"))
        while waiting and waiting[0].name in moved:
            blocks.append(_table("[[links]]", waiting.pop(0), place, "links"))
    blocks += [_table("[[frames]]", frame, place) for frame in description.frames]
    blocks += [_table("[[cylinders]]", cylinder, place) for cylinder in description.cylinders]
    return "\n".join(blocks)


def write_toml(arm: Arm | RobotDescription, path: str | os.PathLike[str]) -> Path:
    """Writes `to_toml`, whole or not at all.

    Args:
        arm: the arm or its description.   path: of the file, usually ending in .toml; one that is there is replaced.
    Returns:
        path: where it is.
    Raises:
        OutputError: the file cannot be written, or a mesh is not below its folder.   ModelError: as `to_toml`.
    Example:
        >>> path = aw.robotfiles.write_toml(aw.load("two-link"), "arm.toml")
        >>> aw.load(path).n
        2
    """
    path, text = Path(path), to_toml(arm, Path(path).parent)
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    return path


def for_folder(robot: RobotDescription, folder: str | os.PathLike[str]) -> tuple[RobotDescription, tuple[str, ...]]:
    """A description as a file of that folder can hold it, and what it loses: visuals whose meshes are not below the folder.

    Robots of ROS keep meshes beside the folder of the URDF, so that this is usual.

    Args:
        robot: a description.   folder: where the file will stand.
    """
    place, links, far = Path(folder).resolve(), [], 0
    for link in robot.links:
        kept = tuple(
            each
            for each in link.visuals
            if not isinstance(each.solid, Mesh) or each.solid.path.resolve().is_relative_to(place)
        )
        far += len(link.visuals) - len(kept)
        links.append(link if len(kept) == len(link.visuals) else link.model_copy(update={"visuals": kept}))
    if not far:
        return robot, ()
    lost = f"{far} visual{'s' if far > 1 else ''}, whose meshes are not below {os.fspath(place)!r}"
    return robot.model_copy(update={"links": tuple(links)}), (lost,)


def _present_fields(record: Record) -> dict[str, Any]:
    """Fields that are not at their defaults, names first."""
    fields = type(record).model_fields
    names = [*(name for name in FIRST if name in fields), *(name for name in fields if name not in FIRST)]
    if isinstance(record, RobotDescription):
        names = list(fields)
    values = {name: getattr(record, name) for name in names}
    return {
        name: v
        for name, v in values.items()
        if v is not None and v != fields[name].get_default(call_default_factory=True, validated_data={})
    }


def _table(heading: str, record: Record, place: Path | None, path: str = "") -> str:
    """A table under its heading, and the tables within it under theirs."""
    fields = _present_fields(record)
    inner = {name: value for name, value in fields.items() if name in TABLES}
    many = {name: value for name, value in fields.items() if name == "visuals"}
    plain = {name: value for name, value in fields.items() if name not in (*inner, *many)}
    blocks = [f"{heading}\n{''.join(_lines(plain, place))}"]
    blocks += [_table(f"[{path}.{name}]", value, place) for name, value in inner.items()]
    blocks += [_table(f"[[{path}.{name}]]", item, place) for name, items in many.items() for item in items]
    return "\n".join(blocks)


def _lines(values: dict[str, Any], place: Path | None) -> Iterator[str]:
    for name, value in values.items():
        yield f"{_key(name)} = {_inline(value, place)}\n"


def _inline(value: Any, place: Path | None) -> str:
    """A value in one line."""
    if isinstance(value, Quantity):
        fields = _present_fields(value)
        value = fields if len(fields) > 1 or "source" in fields else value.value
        if isinstance(value, dict):
            value = {"value": value.pop("value"), **value}
    elif isinstance(value, Record):
        fields = _present_fields(value)
        value = {**fields, "file": _relative(value, place)} if isinstance(value, Mesh) else fields
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{_key(name)} = {_inline(inner, place)}' for name, inner in value.items())} }}"
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(_inline(inner, place) for inner in value)}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return _text(value) if isinstance(value, str) else repr(value)


def _relative(mesh: Mesh, place: Path | None) -> str:
    """The path of a mesh as a file in that folder names it."""
    if place is None:
        return mesh.file
    path = mesh.path.resolve()
    if not path.is_relative_to(place):
        expected = f"a path below {os.fspath(place)!r}, where the file would be"
        raise OutputError("not below the file's folder", place="mesh", value=os.fspath(mesh.path), expected=expected)
    return path.relative_to(place).as_posix()


def _key(name: str) -> str:
    return name if fullmatch(r"[A-Za-z0-9_-]+", name) else _text(name)


def _text(text: str) -> str:
    """A TOML string: JSON's escapes, and the one control character that JSON leaves alone."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")

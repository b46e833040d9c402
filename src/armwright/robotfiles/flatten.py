"""A description as a flat table: every number and every word by its dotted path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from armwright.description.paths import below
from armwright.description.robot import RobotDescription
from armwright.model.variants.edits import tip_of
from armwright.quantity import Quantity, Record

WHOLE = ("joints", "links", "frames")  # whose items come and go as a whole
NOT_PHYSICAL = ("sources", "built_from", "remarks", "notes", "title", "name", "source")  # of the description itself


@dataclass(frozen=True)
class Leaf:
    """What stands at a path: a number with standard deviation and source, or a word."""

    value: Any
    std: Any = None
    source: str | None = None
    is_whole: bool = False  # a joint, link or frame, whose own leaves tell what differs


def leaves(robot: RobotDescription) -> dict[str, Leaf]:
    """Every leaf of a description, in its own order.

    A joint, link or frame also has a leaf of its own name, so that one that is not in another description can be told as a
    whole; pictures are one leaf a link. Titles, notes and the list of sources are left out.
    """
    found: dict[str, Leaf] = {}
    for name in type(robot).model_fields:
        if name in WHOLE:
            for item in getattr(robot, name):
                found[item.name] = Leaf(_told(item, name), is_whole=True)
                found.update(_of_item(item, robot.source))
        elif name == "tip":
            found[name] = Leaf(tip_of(robot))
        elif name not in NOT_PHYSICAL:
            found.update(_walk(getattr(robot, name), name, robot.source))
    return found


def _of_item(item: Any, source: str | None) -> Iterator[tuple[str, Leaf]]:
    for path, value in below(item, item.name):
        key = path.rsplit(".", 1)[-1]
        if key == "visuals":
            yield path, Leaf(f"{len(value)} solids" if value else None, value)
        elif key not in ("name", "source"):
            yield from _walk(value, path, item.source or source)


def _walk(value: Any, path: str, source: str | None) -> Iterator[tuple[str, Leaf]]:
    if isinstance(value, Quantity):
        yield path, Leaf(value.value, value.std, value.source or source)
    elif isinstance(value, (Record, tuple)):
        own = getattr(value, "source", None) or source
        for inner, item in below(value, path):
            if not inner.endswith(".source"):
                yield from _walk(item, inner, own)
    elif value is not None:
        yield path, Leaf(value)


def _told(item: Any, kind: str) -> str:
    if kind == "links":
        return f"link of {float(item.mass_kg):g} kg"
    return f"{item.type} joint" if kind == "joints" else f"frame on {item.link}"

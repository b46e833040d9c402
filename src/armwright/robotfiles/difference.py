"""Difference of two robot files, number by number, and its effect on the dynamics."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from armwright.description import RobotDescription
from armwright.description.paths import below, path_name, split_path
from armwright.errors import ModelError
from armwright.features import Support
from armwright.model import Model, build_model
from armwright.model.load import load
from armwright.model.variants.edits import tip_of
from armwright.quantity import Quantity, Record, Source
from armwright.robotfiles.dynamic_effect import DynamicEffect, dynamic_effect

SUPPORT = Support("diff")

Arm = str | os.PathLike[str] | Model | RobotDescription
WHOLE = ("joints", "links", "frames", "cylinders")  # whose items come and go as a whole
NOT_PHYSICAL = (
    "sources",
    "built_from",
    "fits",
    "remarks",
    "without_masses",
    "notes",
    "title",
    "name",
    "source",
)  # of the description itself


@dataclass(frozen=True)
class Change:
    """One parameter that differs; None stands for an absent one.

    Attributes:
        path: such as `link3.mass_kg`; the name alone for a joint, link, frame or cylinder that is in only one of the two.
        before, after: the values.   std_before, std_after: their standard deviations.
        source_before, source_after: where they come from.
    """

    path: str
    before: Any
    after: Any
    std_before: Any = None
    std_after: Any = None
    source_before: Source | None = None
    source_after: Source | None = None

    @property
    def is_source_only(self) -> bool:
        """True if the value is the same and only its source or standard deviation differs."""
        return self.before == self.after


@dataclass(frozen=True, eq=False)
class Difference:
    """Result of `diff`.

    Attributes:
        a, b: names of the two.   changes: in the order of the first, then those that only the second has.
        effect: on the dynamics; None where they have no joint in common.
    """

    a: str
    b: str
    changes: tuple[Change, ...]
    effect: DynamicEffect | None

    def __bool__(self) -> bool:
        return bool(self.changes)


def diff(a: Arm, b: Arm) -> Difference:
    """Compares two robots parameter by parameter, with sources, and computes the effect on the dynamics.

    Args:
        a: the first: a name, a path, an arm or a description.   b: the second.
    Returns:
        difference: its `changes`, and as `effect` total mass, and gravity torques and inertias over sample poses.
    Raises:
        DescriptionError: a file that cannot be believed.   ModelError: an arm without a description.
    """
    one, other = _model(a), _model(b)
    first, second = one.description, other.description
    assert first is not None
    assert second is not None
    before, after = flattened(first), flattened(second)
    order = ("order of the joints", Leaf(_order(one, other)), Leaf(_order(other, one)))
    rows = [order] + [(path, before.get(path), after.get(path)) for path in dict.fromkeys((*before, *after))]
    lone = {path for path, old, new in rows if not split_path(path)[1] and (old is None or new is None)}
    changes = tuple(
        _change(path, old, new, first, second)
        for path, old, new in rows
        if (path in lone or path_name(split_path(path)[0]) not in lone) and not _same(old, new, first, second)
    )
    return Difference(_name(a), _name(b), changes, dynamic_effect(one, other))


def _model(arm: Arm) -> Model:
    if isinstance(arm, RobotDescription):
        return build_model(arm, on_impossible="warn")
    model = arm if isinstance(arm, Model) else load(arm, on_impossible="warn")
    if model.description is None:
        raise ModelError("this model has no description to compare", value=model.name)
    return model


def _name(arm: Arm) -> str:
    return arm.name if isinstance(arm, (Model, RobotDescription)) else os.fspath(arm)


def _order(arm: Model, other: Model) -> str:
    """Of the joints that both have."""
    return ", ".join(name for name in arm.names if name in other.names)


def _same(old: Leaf | None, new: Leaf | None, first: RobotDescription, second: RobotDescription) -> bool:
    if old is None or new is None:
        return (old or new or Leaf(None)).value is None
    if old.is_whole and new.is_whole:
        return True
    return (old.value, old.std) == (new.value, new.std) and _source(first, old) == _source(second, new)


def _source(robot: RobotDescription, leaf: Leaf | None) -> Source | None:
    return None if leaf is None or leaf.source is None else robot.source_of(leaf.source)


def _change(path: str, old: Leaf | None, new: Leaf | None, first: RobotDescription, second: RobotDescription) -> Change:
    before, after = old or Leaf(None), new or Leaf(None)
    pictures = path.endswith(".visuals")  # of which the deviation holds the solids
    std_before, std_after = (None if pictures else leaf.std for leaf in (before, after))
    return Change(path, before.value, after.value, std_before, std_after, _source(first, old), _source(second, new))


@dataclass(frozen=True)
class Leaf:
    """Value at a path: a number with standard deviation and source, or a word."""

    value: Any
    std: Any = None
    source: str | None = None
    is_whole: bool = False  # a joint, link, frame or cylinder: its fields have leaves of their own


def flattened(robot: RobotDescription) -> dict[str, Leaf]:
    """Every number and word of a description by its dotted path, in its order.

    A joint, link, frame or cylinder also has a leaf under its name alone, for one that the other description has not;
    pictures are one leaf a link. Titles, notes and the list of sources are left out.
    """
    flat: dict[str, Leaf] = {}
    for name in type(robot).model_fields:
        if name in WHOLE:
            for item in getattr(robot, name):
                flat[path_name(item.name)] = Leaf(_summary(item, name), is_whole=True)
                flat.update(_of_item(item, robot.source))
        elif name == "tip":
            flat[name] = Leaf(tip_of(robot))
        elif name not in NOT_PHYSICAL:
            flat.update(_walk(getattr(robot, name), name, robot.source))
    return flat


def _of_item(item: Any, source: str | None) -> Iterator[tuple[str, Leaf]]:
    for path, value in below(item, path_name(item.name)):
        key = path.rsplit(".", 1)[-1]
        if key == "visuals":
            yield path, Leaf(f"{len(value)} solids" if value else None, value)
        elif key not in ("name", "source"):
            yield from _walk(value, path, item.source or source)


def _walk(value: Any, path: str, source: str | None) -> Iterator[tuple[str, Leaf]]:
    if isinstance(value, Quantity):
        yield path, Leaf(value.value, value.std, value.source or source)
    elif isinstance(value, (Record, tuple)):
        source = getattr(value, "source", None) or source
        for inner, item in below(value, path):
            if not inner.endswith(".source"):
                yield from _walk(item, inner, source)
    elif value is not None:
        yield path, Leaf(value)


def _summary(item: Any, kind: str) -> str:
    if kind == "links":
        return f"link of {float(item.mass_kg):g} kg"
    if kind == "cylinders":
        return f"cylinder from {item.link_a} to {item.link_b}"
    return f"{item.type} joint" if kind == "joints" else f"frame on {item.link}"

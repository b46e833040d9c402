"""What two records of an arm differ in, number by number, and what that does to the arm."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

from armwright.description import RobotDescription
from armwright.errors import ModelError
from armwright.model import Model, build_model
from armwright.model.load import load
from armwright.quantity import Source
from armwright.robotfiles.dynamic_effect import Consequence, consequence
from armwright.robotfiles.flatten import Leaf, leaves

Arm = str | os.PathLike[str] | Model | RobotDescription


@dataclass(frozen=True)
class Change:
    """One parameter that is not the same; None stands for one that is not there.

    Attributes:
        path: such as `link3.mass_kg`; the name alone for a joint, link or frame that is in only one of the two.
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
        """Whether the value stayed, and only where it comes from or how sure it is did not."""
        return self.before == self.after


@dataclass(frozen=True, eq=False)
class Difference:
    """What `diff` found.

    Attributes:
        a, b: what the two are called.   changes: in the order of the first, then what only the second has.
        consequence: what the two arms do differently; None where they have no joint in common.
    """

    a: str
    b: str
    changes: tuple[Change, ...]
    consequence: Consequence | None

    def __bool__(self) -> bool:
        return bool(self.changes)


def diff(a: Arm, b: Arm) -> Difference:
    """Compares two records parameter by parameter, with sources, and says what the difference does to the arm.

    Args:
        a: the first: a name, a path, an arm or a description.   b: the second.
    Returns:
        difference: its `changes`, and as `consequence` total mass, and gravity torques and inertias over sample poses.
    Raises:
        DescriptionError: a file that cannot be believed.   ModelError: an arm without a description.
    """
    one, other = _model(a), _model(b)
    first, second = one.description, other.description
    assert first is not None
    assert second is not None
    before, after = leaves(first), leaves(second)
    order = ("order of the joints", Leaf(_order(one, other)), Leaf(_order(other, one)))
    rows = [order] + [(path, before.get(path), after.get(path)) for path in dict.fromkeys((*before, *after))]
    lone = {path for path, old, new in rows if "." not in path and (old is None or new is None)}
    changes = tuple(
        _change(path, old, new, first, second)
        for path, old, new in rows
        if (path in lone or path.split(".", 1)[0] not in lone) and not _same(old, new, first, second)
    )
    return Difference(_called(a), _called(b), changes, consequence(one, other))


def _model(arm: Arm) -> Model:
    if isinstance(arm, RobotDescription):
        return build_model(arm, on_impossible="warn")
    model = arm if isinstance(arm, Model) else load(arm, on_impossible="warn")
    if model.description is None:
        raise ModelError(f"{model.name}: this model was not made from a description, and has no record to compare")
    return model


def _called(arm: Arm) -> str:
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
    pictures = path.endswith(".visuals")
    return Change(
        path,
        None if old is None else old.value,
        None if new is None else new.value,
        None if old is None or pictures else old.std,
        None if new is None or pictures else new.std,
        _source(first, old),
        _source(second, new),
    )

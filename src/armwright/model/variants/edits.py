"""Steps shared by variants of a description: records from fields, checked names, the tip."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

from armwright.description.consistency import carrier
from armwright.description.robot import Joint, RobotDescription
from armwright.errors import DescriptionError, check_known
from armwright.model.build import tree_of
from armwright.model.cylinder_lengths import is_stretched
from armwright.quantity import Quantity, Record
from armwright.validation import validated

CHOSEN = "definition"  # the source of a number that whoever made the variant gave
SomeRecord = TypeVar("SomeRecord", bound=Record)


def checked(record: type[SomeRecord], place: str, **fields: Any) -> SomeRecord:
    """A record of these fields.

    Raises:
        DescriptionError: `place`, the field, its value and what was expected.
    """
    return validated(record, fields, place=place)


def replaced(robot: RobotDescription, place: str, **fields: Any) -> RobotDescription:
    """A description with other fields, no longer the one that was built from its parts.

    Raises:
        DescriptionError: `place` and what does not go together.
    """
    try:
        return robot.replace(built_from=None, **fields)
    except DescriptionError as error:
        raise error.within(place, file=robot.name) from None


def chosen(*numbers: Any) -> Quantity:
    """A quantity, one number or several, whose source is whoever called."""
    values = [float(number) for number in numbers]
    return Quantity(value=tuple(values) if len(values) > 1 else values[0], source=CHOSEN)


def moving_cylinders(
    robot: RobotDescription, joints: Sequence[Joint], base: str, held: Mapping[str, float]
) -> tuple[Any, ...]:
    """The cylinders whose two links are there and that are still stretched, with these joints and this base.

    Args:
        robot: the whole arm.   joints: those that are left.   base: theirs.   held: positions of those that move no more.
    """
    there = {base, *(joint.child for joint in joints)}
    tree = tree_of(robot)
    return tuple(
        record
        for record, cylinder in zip(robot.cylinders, tree.cylinders, strict=True)
        if {record.link_a, record.link_b} <= there
        and carrier(joints, record.link_a) != carrier(joints, record.link_b)
        and is_stretched(tree, cylinder, held)
    )


def check_name(robot: RobotDescription, place: str, name: str, known: Iterable[str]) -> None:
    """Refuses an unknown name.

    Raises:
        DescriptionError: with the known names.
    """
    known = list(known)
    check_known(DescriptionError, name, known, "unknown", place=place, file=robot.name)


def tip_of(robot: RobotDescription) -> str | None:
    """The tip's name: as the description has it, or the last link of a chain."""
    return robot.end_of_chain if robot.tip is None else robot.tip

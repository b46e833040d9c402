"""Kinds of joints, one value each: motion, units, keys. A new kind is one file here, and a row of `KINDS`.

A kind of a user's own is put into `KINDS` before the first robot is read, since every kind has a record.
"""

from __future__ import annotations

from armwright.errors import DescriptionError
from armwright.joint_kinds.fixed import Fixed
from armwright.joint_kinds.helical import Helical
from armwright.joint_kinds.kind import JointKind
from armwright.joint_kinds.prismatic import Prismatic
from armwright.joint_kinds.revolute import Revolute
from armwright.joint_kinds.units import LINEAR, ROTARY, UNITS, Dimension, JointUnits

KINDS: dict[str, type[JointKind]] = {kind.name: kind for kind in (Revolute, Prismatic, Helical, Fixed)}


def moving_kinds() -> dict[str, type[JointKind]]:
    """The kinds that have a coordinate, by their names."""
    return {name: kind for name, kind in KINDS.items() if kind.moves}


def kind_named(name: object, place: str = "type", file: object = "") -> type[JointKind]:
    """The kind that a `type` of a robot file names.

    Raises:
        DescriptionError: there is no such kind; names file, key and value, and the kinds that there are.
    """
    if not isinstance(name, str) or name not in KINDS:
        raise DescriptionError("no kind of joint", place=place, value=name, choices=KINDS, file=file)
    return KINDS[name]


__all__ = [
    "KINDS",
    "LINEAR",
    "ROTARY",
    "UNITS",
    "Dimension",
    "Fixed",
    "Helical",
    "JointKind",
    "JointUnits",
    "Prismatic",
    "Revolute",
    "kind_named",
    "moving_kinds",
]

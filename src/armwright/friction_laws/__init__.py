"""Friction laws, one file each: equation, keys, and all that follows in other rooms. A new law is one file, and a row of `LAWS`.

A law of a user's own is put into `LAWS` before the first robot is read, whose records have the keys of all laws.
"""

from __future__ import annotations

from collections.abc import Collection

from armwright.friction_laws.coulomb import Coulomb
from armwright.friction_laws.law import FrictionLaw, OwnKey
from armwright.friction_laws.load_dependent import LoadDependent
from armwright.friction_laws.lugre import LuGre
from armwright.friction_laws.sigmoid import Sigmoid
from armwright.joint_kinds import JointUnits

LAWS: dict[str, FrictionLaw] = {law.name: law for law in (Coulomb(), Sigmoid(), LuGre(), LoadDependent())}


def linear_parameters() -> tuple[tuple[str, int], ...]:
    """Law and place of every parameter of its own in which friction is linear: columns of `regressor_drive`."""
    return tuple((name, place) for name, law in LAWS.items() for place, key in enumerate(law.own) if key.linear)


def law_of_keys(keys: Collection[str], units: JointUnits) -> str:
    """Name of the law that has one of some keys of its own; Coulomb's, which has none, without."""
    own = {name: [units.key(key.stem, key.dimension) for key in law.own] for name, law in LAWS.items()}
    return next((name for name, each in own.items() if set(each) & set(keys)), "coulomb")


__all__ = ["LAWS", "FrictionLaw", "OwnKey", "law_of_keys", "linear_parameters"]

"""Springs of an arm, joint side; equations in `actuators.springs` and `dynamics.springs`."""

from __future__ import annotations

from dataclasses import dataclass

from armwright.interpolation import Outside
from armwright.scalar import Array, Scalar
from armwright.spatial import Frozen


@dataclass(frozen=True, eq=False)
class LinearSpring:
    """A joint's spring:  torque = preload - stiffness (q - rest)."""

    stiffness: Scalar  # [N m/rad | N/m]
    rest: Scalar  # [rad | m]
    preload: Scalar = 0.0  # [N m | N]


@dataclass(frozen=True, eq=False)
class TableSpring:
    """A joint's spring by a table of its torque over the position, straight lines between the points."""

    positions: tuple[Scalar, ...]  # [rad | m], strictly increasing
    torques: tuple[Scalar, ...]  # [N m | N] on the joint
    outside: Outside


Spring = LinearSpring | TableSpring


@dataclass(frozen=True, eq=False)
class SpringCylinder(Frozen):
    """A gas spring or counterbalance cylinder between two bodies:  force = preload - stiffness (ℓ - length), above 0 it pushes.

    An end is a body (BASE: the base) and a point in that body's frame; ℓ is the distance of the two.
    """

    name: str
    bodies: tuple[int, int]
    ends: Array  # (2, 3) [m]
    preload: Scalar  # [N] at that length
    length: Scalar  # [m]
    stiffness: Scalar  # [N/m]

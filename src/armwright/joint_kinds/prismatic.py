"""A joint that slides along its axis:  S = [z; 0]."""

from __future__ import annotations

from dataclasses import dataclass

from armwright import scalar
from armwright.joint_kinds.kind import JointKind, Regrouped
from armwright.joint_kinds.units import LINEAR
from armwright.scalar import Array, Scalar


@dataclass(frozen=True)
class Prismatic(JointKind):
    """A joint that slides along its axis."""

    name = "prismatic"
    about = "A joint that slides along the z axis of its frame (DH), or along `axis` in its frame."
    units = LINEAR
    turns, slides = False, True

    def motion(self, q: Scalar) -> tuple[Scalar, Scalar]:
        """(0, q)."""
        return 0.0, q

    def project(self, turning: Array, sliding: Array) -> Array:
        """The linear part."""
        return sliding

    def regrouped(self, mass: Scalar, first_moment: Array, inertia: Array) -> Regrouped:
        """A slide does not turn: the whole tensor moves."""
        return (0.0, scalar.zeros(3), inertia), {"inertia": 0.0 * inertia}

"""A joint that turns about its axis:  S = [0; z]."""

from __future__ import annotations

from dataclasses import dataclass

from armwright import scalar
from armwright.joint_kinds.kind import JointKind, Regrouped
from armwright.joint_kinds.units import ROTARY
from armwright.scalar import Array, Scalar
from armwright.spatial import second_moment


@dataclass(frozen=True)
class Revolute(JointKind):
    """A joint that turns about its axis."""

    name = "revolute"
    about = "A joint that turns about the z axis of its frame (DH), or about `axis` in its frame."
    units = ROTARY
    turns, slides = True, False

    def motion(self, q: Scalar) -> tuple[Scalar, Scalar]:
        """(q, 0)."""
        return q, 0.0

    def project(self, turning: Array, sliding: Array) -> Array:
        """The rotary part."""
        return turning

    def regrouped(self, mass: Scalar, first_moment: Array, inertia: Array) -> Regrouped:
        """A mass on the axis does not know which of the two bodies it belongs to: m, m c_z and ∫z² dm move, 7 of 10 are left."""
        along = second_moment(inertia)[2, 2]  # ∫ z² dm
        h = scalar.array([0.0, 0.0, first_moment[2]])
        tensor = scalar.array([[along, 0.0, 0.0], [0.0, along, 0.0], [0.0, 0.0, 0.0]])
        left = {"mass": 0.0, "first_moment": first_moment - h, "inertia": inertia - tensor}
        return (mass, h, tensor), left

"""A screw: it turns about its axis and moves along it by its pitch:  S = [p z; z]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armwright import scalar
from armwright.joint_kinds.kind import JointKind, Regrouped
from armwright.joint_kinds.units import ROTARY
from armwright.scalar import Array, Scalar


@dataclass(frozen=True)
class Helical(JointKind):
    """A joint that turns about its axis and moves along it, as a nut on a spindle. Its coordinate is the angle.

    Attributes:
        pitch: p [m/rad], above 0 of a right-handed screw; a thread's lead is 2π p.
    """

    pitch: Scalar

    name = "helical"
    about = "A screw: it turns by q about the z axis of its frame (DH), or about `axis`, and moves along it by its pitch times q."
    units = ROTARY
    turns, slides = True, True
    numbers: ClassVar[dict[str, str]] = {
        "pitch_m_per_rad": "Way along the axis by a radian of turn, lead / 2π; above 0 of a right-handed screw."
    }

    def motion(self, q: Scalar) -> tuple[Scalar, Scalar]:
        """(q, p q)."""
        return q, self.pitch * q

    def project(self, turning: Array, sliding: Array) -> Array:
        """The rotary part, and p times the linear part."""
        return turning + self.pitch * sliding

    def regrouped(self, mass: Scalar, first_moment: Array, inertia: Array) -> Regrouped:
        """A tensor diag(a, a, 0) has the energy a (ω_x² + ω_y²) / 2, which neither the turn nor the slide changes: Iyy moves."""
        a = inertia[1, 1]
        tensor = scalar.array([[a, 0.0, 0.0], [0.0, a, 0.0], [0.0, 0.0, 0.0]])
        return (0.0, scalar.zeros(3), tensor), {"inertia": inertia - tensor}

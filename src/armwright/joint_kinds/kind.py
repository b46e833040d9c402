"""A joint kind: the motion that a joint allows, and the units of its coordinate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from armwright.joint_kinds.units import JointUnits
from armwright.scalar import Array, Scalar
from armwright.spatial import Placement, rotation_to_axis, rotation_z

Regrouped = tuple[tuple[Scalar, Array, Array], dict[str, Any]]


@dataclass(frozen=True)
class JointKind:
    """Motion of a joint about and along the z axis of its frame, with the coordinate q.  [Featherstone2008] chapter 4

    The motion subspace of a kind is S = [s z; t z]: it slides by s q and turns by t q, t being 0 or 1. Everything that the
    dynamics ask for follows from it; a kind writes it out, so that a 0 or a 1 in S costs no operation.

    Attributes:
        name: its `type` in robot files.   about: one line for the reference.   units: of q and of its torque.
        moves: whether it has a coordinate.   turns: whether t is not 0.   slides: whether s is not 0.
        numbers: keys that the kind has beside those of all joints, other than 0, with their descriptions.
    """

    name: ClassVar[str]
    about: ClassVar[str]
    units: ClassVar[JointUnits]
    moves: ClassVar[bool] = True
    turns: ClassVar[bool]
    slides: ClassVar[bool]
    numbers: ClassVar[dict[str, str]] = {}

    @classmethod
    def of(cls, record: Any) -> JointKind:
        """The kind of a joint, with the joint's own `numbers`."""
        return cls(*(getattr(record, key).number for key in cls.numbers))

    def motion(self, q: Scalar) -> tuple[Scalar, Scalar]:
        """(t q, s q): angle about z [rad] and way along z [m]; of a speed or acceleration likewise."""
        raise NotImplementedError

    def placement(self, axis: Array, q: Scalar) -> Placement:
        """The motion by q about and along an axis (3,) of any length, in the frame that the axis is given in."""
        turn, (angle, way) = rotation_to_axis(axis), self.motion(q)
        rotation = turn @ rotation_z(angle) @ turn.T if self.turns else np.eye(3)
        return Placement(rotation, turn[:, 2] * way if self.slides else np.zeros(3))

    def project(self, turning: Array, sliding: Array) -> Array:
        """t a + s b, of a what belongs to a turn about z and of b what belongs to a slide: of moment and force  Sᵀ f."""
        raise NotImplementedError

    def regrouped(self, mass: Scalar, first_moment: Array, inertia: Array) -> Regrouped:
        """Inertial parameters that could as well be its parent's. [GautierKhalil1990]

        Args:
            mass, first_moment, inertia: of the body that it moves, about the body's origin, in the body's axes.
        Returns:
            moved: mass, first moment and tensor that its parent may have.   left: fields of the body without them.
        """
        raise NotImplementedError

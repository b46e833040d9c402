"""Placement of one frame in another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.scalar import Array
from armwright.spatial.frozen import Frozen
from armwright.spatial.rotation import rotated


@dataclass(frozen=True, eq=False)
class Placement(Frozen):
    """Frame b in frame a: a point is  p_a = rotation @ p_b + position.

    Args:
        rotation: (3, 3), takes coordinates in b to coordinates in a.   position: (3,) [m], the origin of b in a.
    """

    rotation: Array
    position: Array

    @classmethod
    def identity(cls) -> Placement:
        """The frame itself."""
        return cls(np.eye(3), scalar.array([0.0, 0.0, 0.0]))

    def __matmul__(self, inner: Placement) -> Placement:
        """Frame c in a, from b in a and c in b."""
        return Placement(self.rotation @ inner.rotation, self.point(inner.position))

    def inverse(self) -> Placement:
        """Frame a in frame b."""
        return Placement(self.rotation.T, -rotated(self.rotation.T, self.position))

    def point(self, p_b: Array) -> Array:
        """Coordinates in a of a point given in b [m]."""
        return self.rotation @ p_b + self.position

    def matrix(self) -> np.ndarray:
        """(4, 4) homogeneous transform."""
        top = np.concatenate([self.rotation, np.reshape(self.position, (3, 1))], axis=1)
        return scalar.array(np.concatenate([top, np.array([[0.0, 0.0, 0.0, 1.0]])]))

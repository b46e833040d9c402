"""Chain of an arm's frames with small corrections at every place where its record has a number. [RothMooringRavani1987]

    T(q) = Π Fᵢ,    Fᵢ a constant placement, the motion of a joint, or a correction exp([ξ] Σ c(q) δ)

A correction is a turn about, or a shift along, x, y or z of the frame where it stands; its weight c(q) is 1, cos q, sin q, or the
moment that gravity applies there. All poses go through the chain at once, and derivatives by δ are the twists of the corrections.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.spatial import Placement

Weight = Callable[[np.ndarray], np.ndarray]  # (poses, joints) positions → (poses,)


@dataclass(frozen=True, eq=False)
class Constant:
    """A placement that does not change: (4, 4)."""

    matrix: np.ndarray


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of a joint about and along z.

    Attributes:
        kind: of the joint.   column: of the joint (or its master) in the positions; None: it stands at 0.
        multiplier, offset: of a joint that follows.
    """

    kind: Any
    column: int | None
    multiplier: float = 1.0
    offset: float = 0.0

    def matrices(self, q: np.ndarray) -> np.ndarray:
        """(poses, 4, 4) at positions q (poses, joints)."""
        value = np.zeros(len(q)) if self.column is None else q[:, self.column]
        angle, way = self.kind.motion(self.multiplier * value + self.offset)
        return screws(2, np.broadcast_to(angle, len(q)), np.broadcast_to(way, len(q)))


@dataclass(frozen=True, eq=False)
class Correction:
    """A small turn about, or shift along, an axis of the frame where it stands.

    Attributes:
        parameter: its number.   axis: 0, 1 or 2 for x, y or z.   turns: a turn [rad], else a shift [m].
        weight: of the parameter by the pose; None: 1 in all.
    """

    parameter: int
    axis: int
    turns: bool
    weight: Weight | None = None

    def weights(self, q: np.ndarray) -> np.ndarray:
        """(poses,) c(q)."""
        return np.ones(len(q)) if self.weight is None else self.weight(q)


Factor = Constant | Motion | Correction


@dataclass(frozen=True, eq=False)
class ChainMotion:
    """Pose of the end of a chain in all poses of the arm, with derivatives by p parameters.

    Attributes:
        placement: (poses, 4, 4).   turning: (poses, 3, p) turn of the end [rad/unit].
        at: (poses, 3, p) velocity [m/unit] of the end's point that is at the chain's beginning. Both in the beginning's axes.
    """

    placement: np.ndarray
    turning: np.ndarray
    at: np.ndarray

    @classmethod
    def begin(cls, poses: int, count: int) -> ChainMotion:
        """A chain without factors."""
        return cls(np.tile(np.eye(4), (poses, 1, 1)), np.zeros((poses, 3, count)), np.zeros((poses, 3, count)))

    @property
    def shifting(self) -> np.ndarray:
        """(poses, 3, p) velocity of the end's origin [m/unit]."""
        x, y, z = (self.placement[:, axis, 3, None] for axis in range(3))
        wx, wy, wz = self.turning[:, 0], self.turning[:, 1], self.turning[:, 2]
        return self.at + np.stack([wy * z - wz * y, wz * x - wx * z, wx * y - wy * x], axis=1)

    def only(self, poses: np.ndarray) -> ChainMotion:
        """Some of the poses."""
        return ChainMotion(self.placement[poses], self.turning[poses], self.at[poses])


def screws(axis: int, angle: np.ndarray, way: np.ndarray) -> np.ndarray:
    """(poses, 4, 4) turns about an axis by angles [rad], and shifts along it [m]."""
    matrices = np.tile(np.eye(4), (len(angle), 1, 1))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    matrices[:, i, i], matrices[:, i, j], matrices[:, j, i], matrices[:, j, j] = c, -s, s, c
    matrices[:, axis, 3] = way
    return matrices


def moved(
    factors: Sequence[Factor], q: np.ndarray, values: np.ndarray, begun: ChainMotion | None = None
) -> ChainMotion:
    """The end of a chain and its derivatives.

    Args:
        factors: of the chain, from its beginning.   q: (poses, joints) [rad | m].   values: (p,) of all parameters.
        begun: the chain up to the first factor; absent: nothing.
    """
    begun = begun or ChainMotion.begin(len(q), len(values))
    placed, turning, at = begun.placement, begun.turning.copy(), begun.at.copy()
    zero = np.zeros(len(q))
    for factor in factors:
        if isinstance(factor, Constant):
            placed = placed @ factor.matrix
        elif isinstance(factor, Motion):
            placed = placed @ factor.matrices(q)
        else:
            c, k = factor.weights(q), factor.parameter
            way, amount = placed[:, :3, factor.axis] * c[:, None], c * values[k]
            if factor.turns:  # several corrections may share a parameter, so they add
                turning[:, :, k] += way
                at[:, :, k] -= np.cross(way, placed[:, :3, 3])
            else:
                at[:, :, k] += way
            if amount.any():
                turn, shift = (amount, zero) if factor.turns else (zero, amount)
                placed = placed @ screws(factor.axis, turn, shift)
    return ChainMotion(placed, turning, at)


def matrix_of(placement: Placement) -> np.ndarray:
    """(4, 4) of a placement of numbers."""
    return np.asarray(placement.matrix(), dtype=float)

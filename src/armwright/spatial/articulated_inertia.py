"""Inertia of an articulated body: symmetric (6, 6), as three blocks, carried by axial steps. [McMillanOrin1995]

A turn or a shift along one axis at a time takes far fewer operations than a general one. A symmetric matrix of three rows
turns about z in 8 products, any other in 12.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armwright import scalar
from armwright.scalar import Array, Scalar
from armwright.spatial.rotation import cross, skew

if TYPE_CHECKING:
    from armwright.joint_kinds import JointKind


@dataclass(frozen=True, eq=False)
class ArticulatedInertia:
    """Force f and moment n of an acceleration, about the frame's origin, in its axes:  f = M a + Hᵀ α,  n = H a + J α.

    Args:
        linear: M (3, 3) symmetric [kg].   coupling: H (3, 3) [kg m].   angular: J (3, 3) symmetric [kg m²].
    """

    linear: Array
    coupling: Array
    angular: Array

    @classmethod
    def rigid(cls, mass: Scalar, first_moment: Array, inertia: Array) -> ArticulatedInertia:
        """A single rigid body:  M = m 1,  H = h×,  J its tensor about the origin."""
        return cls(scalar.array(mass * np.eye(3)), skew(first_moment), inertia)

    def __add__(self, other: ArticulatedInertia) -> ArticulatedInertia:
        """Two bodies that move as one."""
        return ArticulatedInertia(
            self.linear + other.linear, self.coupling + other.coupling, self.angular + other.angular
        )

    def column(self, kind: JointKind) -> tuple[Array, Array]:
        """Force and moment (3,) that a unit acceleration of a joint asks for, I S."""
        return kind.project(self.coupling[2], self.linear[:, 2]), kind.project(self.angular[:, 2], self.coupling[:, 2])

    def without(self, kind: JointKind, share: tuple[Array, Array], rotor: Scalar) -> ArticulatedInertia:
        """Inertia seen through a joint that moves freely:  I - u uᵀ/D,  D = u_z + rotor;  `share` is u/D.

        In the own row of a joint that only turns or slides  u_z - u_z u_z/D = rotor u_z/D,  and so on: rotor times `share`,
        exactly 0 without a rotor.
        """
        (u, un), (k, kn) = self.column(kind), share
        linear, coupling, angular = scalar.zeros(3, 3), scalar.zeros(3, 3), scalar.zeros(3, 3)
        for i in range(3):
            for j in range(3):
                coupling[i, j] = self.coupling[i, j] - un[i] * k[j]
            for j in range(i, 3):
                linear[i, j] = linear[j, i] = self.linear[i, j] - u[i] * k[j]
                angular[i, j] = angular[j, i] = self.angular[i, j] - un[i] * kn[j]
        if not kind.slides:
            coupling[2] = rotor * k
            angular[2] = angular[:, 2] = rotor * kn
        elif not kind.turns:
            linear[2] = linear[:, 2] = rotor * k
            coupling[:, 2] = rotor * kn
        return ArticulatedInertia(scalar.array(linear), scalar.array(coupling), scalar.array(angular))

    def turned(self, axis: int, c: Scalar, s: Scalar) -> ArticulatedInertia:
        """The inertia in axes turned back about one of them by the angle of cosine c and sine s."""
        return ArticulatedInertia(*(turned_matrix(x, axis, c, s) for x in (self.linear, self.coupling, self.angular)))

    def shifted(self, p: Array) -> ArticulatedInertia:
        """The inertia about an origin from which this one is at p (3,) [m]:  H' = H + p× M,  J' = J + p× Hᵀ - H' p×."""
        before = self.coupling
        after = before + scalar.array([cross(p, row) for row in self.linear]).T
        angular = scalar.zeros(3, 3)
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            turn = p[j] * (before[i, k] + after[i, k]) - p[k] * (before[i, j] + after[i, j])
            mixed = p[k] * (after[i, i] - before[j, j]) + p[j] * before[j, k] - p[i] * after[i, k]
            angular[i, i] = self.angular[i, i] + turn
            angular[i, j] = angular[j, i] = self.angular[i, j] + mixed
        return ArticulatedInertia(self.linear, after, scalar.array(angular))


def turned_matrix(x: Array, axis: int, c: Scalar, s: Scalar) -> np.ndarray:
    """R X Rᵀ (3, 3) for a turn R about one axis, by the angle of cosine c and sine s.

    About z, with t = s (Xxx - Xyy) + c (Xxy + Xyx):  Xxx' = Xxx - s t,  Xyy' = Xyy + s t,  Xxy' = c t - Xyx,
    Xyx' = c t - Xxy.
    """
    i, j, k = (axis + 1) % 3, (axis + 2) % 3, axis
    if not scalar.is_symbolic(c, s) and 0.0 in (c, s):  # right angles exchange entries, nothing is computed
        r = scalar.eye(3)
        r[i, i], r[i, j], r[j, i], r[j, j] = c, -s, s, c
        return scalar.array(r @ x @ r.T)
    t = s * (x[i, i] - x[j, j]) + c * (x[i, j] + x[j, i])
    full = scalar.zeros(3, 3)
    full[i, i], full[j, j], full[k, k] = x[i, i] - s * t, x[j, j] + s * t, x[k, k]
    full[i, j], full[j, i] = c * t - x[j, i], c * t - x[i, j]
    full[i, k], full[j, k] = c * x[i, k] - s * x[j, k], s * x[i, k] + c * x[j, k]
    full[k, i], full[k, j] = c * x[k, i] - s * x[k, j], s * x[k, i] + c * x[k, j]
    return scalar.array(full)


def turned_vector(v: Array, axis: int, c: Scalar, s: Scalar) -> np.ndarray:
    """R v (3,) for a turn R about one axis, by the angle of cosine c and sine s."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned = list(v)
    turned[i], turned[j] = c * v[i] - s * v[j], s * v[i] + c * v[j]
    return scalar.array(turned)

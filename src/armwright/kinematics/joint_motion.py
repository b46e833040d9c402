"""How one joint carries its body: a constant placement, then a turn about or a slide along the body's z axis."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.model import Body, Model
from armwright.scalar import Array, Scalar
from armwright.spatial import Placement


class JointMotion:
    """The body's frame in its parent's, at one q. Vectors are turned in two cheap steps: about z, then by the constant.

    The product of the two rotations is never formed, so a constant of zeros and ones (any Denavit-Hartenberg row with
    a right angle) costs nothing. In the report's notation `to_parent` is A_i^{i+1} and `to_body` is A_{i+1}^i.
    """

    def __init__(self, body: Body, q: Scalar):
        self.fixed = body.placement.rotation
        if body.kind == "revolute":
            angle = q if not scalar.is_symbolic(body.offset) and body.offset == 0.0 else q + body.offset
            self.cos, self.sin = scalar.cos(angle), scalar.sin(angle)
            self.position = body.placement.position
        else:
            self.cos, self.sin = 1.0, 0.0
            self.position = body.placement.position + self.fixed[:, 2] * q

    def to_body(self, v: Array) -> np.ndarray:
        """A vector in the parent's axes, in the body's axes."""
        x, y, z = self.fixed.T @ v
        return scalar.array([self.cos * x + self.sin * y, self.cos * y - self.sin * x, z])

    def to_parent(self, v: Array) -> np.ndarray:
        """A vector in the body's axes, in the parent's axes."""
        x, y, z = v
        return self.fixed @ scalar.array([self.cos * x - self.sin * y, self.sin * x + self.cos * y, z])

    def tensor_to_parent(self, tensor: Array) -> np.ndarray:
        """A symmetric (3, 3) tensor in the body's axes, in the parent's: R T Rᵀ, 8 products for the turn about z.

        With t = s (Txx - Tyy) + 2 c Txy:  Txx' = Txx - s t,  Tyy' = Tyy + s t,  Txy' = c t - Txy.
        """
        xx, xy, xz, yy, yz, zz = tensor[0, 0], tensor[0, 1], tensor[0, 2], tensor[1, 1], tensor[1, 2], tensor[2, 2]
        c, s = self.cos, self.sin
        t = s * (xx - yy) + c * (xy + xy)
        xy_, xz_, yz_ = c * t - xy, c * xz - s * yz, s * xz + c * yz
        turned = scalar.array([[xx - s * t, xy_, xz_], [xy_, yy + s * t, yz_], [xz_, yz_, zz]])
        return _congruent(self.fixed, turned)

    def placement(self) -> Placement:
        """The body's frame in its parent's."""
        turn = scalar.array([[self.cos, -self.sin, 0.0], [self.sin, self.cos, 0.0], [0.0, 0.0, 1.0]])
        return Placement(self.fixed @ turn, self.position)


def _congruent(r: Array, t: Array) -> np.ndarray:
    """R T Rᵀ of a symmetric T, each pair of mirrored entries computed once."""
    rt = r @ t
    full = scalar.zeros(3, 3)
    for i in range(3):
        for j in range(i, 3):
            full[i, j] = full[j, i] = rt[i, 0] * r[j, 0] + rt[i, 1] * r[j, 1] + rt[i, 2] * r[j, 2]
    return scalar.array(full)


def joint_motions(model: Model, q: Array) -> list[JointMotion]:
    """All joints' motions at q (n,) [rad | m]."""
    return [JointMotion(body, q[i]) for i, body in model.outward()]

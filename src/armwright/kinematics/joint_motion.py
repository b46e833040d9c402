"""Motion of a body by its joint: a constant placement, then a turn about and a slide along the body's z axis."""

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

    `nudge` moves the joint on by a first-order amount [rad | m], for derivatives by q: a turn by q + δ is the turn by q,
    and then x + δ y, y - δ x. So they need no derivatives of sine and cosine, and what was turned is used again.
    """

    def __init__(self, body: Body, q: Scalar, nudge: Scalar | None = None):
        self.fixed = body.placement.rotation
        self.cos, self.sin, self.position = 1.0, 0.0, body.placement.position
        if body.kind.turns:
            angle = q if not scalar.is_symbolic(body.offset) and body.offset == 0.0 else q + body.offset
            self.cos, self.sin = scalar.cos(angle), scalar.sin(angle)
        if body.kind.slides:
            _, way = body.kind.motion(q if nudge is None else q + nudge)
            self.position = body.placement.position + self.fixed[:, 2] * way
        self.nudge = nudge if body.kind.turns else None

    def to_body(self, v: Array) -> np.ndarray:
        """A vector in the parent's axes, in the body's axes."""
        x, y, z = self.fixed.T @ v
        x, y = self.cos * x + self.sin * y, self.cos * y - self.sin * x
        return scalar.array([x, y, z] if self.nudge is None else [x + self.nudge * y, y - self.nudge * x, z])

    def to_parent(self, v: Array) -> np.ndarray:
        """A vector in the body's axes, in the parent's axes."""
        x, y, z = v
        if self.nudge is not None:
            x, y = x - self.nudge * y, y + self.nudge * x
        return self.fixed @ scalar.array([self.cos * x - self.sin * y, self.sin * x + self.cos * y, z])

    def tensor_to_parent(self, tensor: Array) -> np.ndarray:
        """A symmetric (3, 3) tensor in the body's axes, in the parent's: R T Rᵀ, 8 products for the turn about z.

        With t = s (Txx - Tyy) + 2 c Txy:  Txx' = Txx - s t,  Tyy' = Tyy + s t,  Txy' = c t - Txy.
        """
        xx, xy, xz, yy, yz, zz = tensor[0, 0], tensor[0, 1], tensor[0, 2], tensor[1, 1], tensor[1, 2], tensor[2, 2]
        c, s = self._turn()
        t = s * (xx - yy) + c * (xy + xy)
        xy_, xz_, yz_ = c * t - xy, c * xz - s * yz, s * xz + c * yz
        turned = scalar.array([[xx - s * t, xy_, xz_], [xy_, yy + s * t, yz_], [xz_, yz_, zz]])
        return _congruent(self.fixed, turned)

    def placement(self) -> Placement:
        """The body's frame in its parent's."""
        c, s = self._turn()
        turn = scalar.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return Placement(self.fixed @ turn, self.position)

    def _turn(self) -> tuple[Scalar, Scalar]:
        """Cosine and sine of the whole turn."""
        if self.nudge is None:
            return self.cos, self.sin
        return self.cos - self.nudge * self.sin, self.sin + self.nudge * self.cos


def _congruent(r: Array, t: Array) -> np.ndarray:
    """R T Rᵀ of a symmetric T, each pair of mirrored entries computed once."""
    rt = r @ t
    full = scalar.zeros(3, 3)
    for i in range(3):
        for j in range(i, 3):
            full[i, j] = full[j, i] = rt[i, 0] * r[j, 0] + rt[i, 1] * r[j, 1] + rt[i, 2] * r[j, 2]
    return scalar.array(full)


def joint_motions(arm: Model, q: Array, nudge: Array | None = None) -> list[JointMotion]:
    """All joints' motions at q (N,) [rad | m] of a tree, moved on to first order by `nudge` (N,) where that is given."""
    return [JointMotion(body, q[i], None if nudge is None else nudge[i]) for i, body in arm.outward()]


def turning(body: Body, motion: JointMotion, w: Array, wd: Array, qd: Scalar, qdd: Scalar) -> tuple[Array, Array]:
    """Angular velocity and acceleration behind a joint, in the body's axes: (1) and (2) of the CMU report.

    ω' = R ω + q̇ z,  ω̇' = R ω̇ + (R ω) × q̇ z + q̈ z, the product written out; a slide passes both on.
    """
    w, wd = motion.to_body(w), motion.to_body(wd)
    if not body.kind.turns:
        return w, wd
    turned = scalar.array([w[0], w[1], w[2] + qd])
    return turned, scalar.array([wd[0] + w[1] * qd, wd[1] - w[0] * qd, wd[2] + qdd])


def origin_acceleration(
    body: Body, motion: JointMotion, w: Array, vd: Array, u: Array, qd: Scalar, qdd: Scalar
) -> np.ndarray:
    """Acceleration of the body's origin, in its axes: (4) of the CMU report, v̇' = R (v̇ + U p).

    `vd` and the acceleration tensor `u` are the parent's, `w` is the body's own; sliding along z by s q adds
    s (2 ω × q̇ z + q̈ z), in which the joint's own turn about z does not count.
    """
    carried = motion.to_body(vd + u @ motion.position)
    if not body.kind.slides:
        return carried
    (_, qd), (_, qdd) = body.kind.motion(qd), body.kind.motion(qdd)
    twice = qd + qd
    return carried + scalar.array([w[1] * twice, -(w[0] * twice), qdd])

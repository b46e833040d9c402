"""A joint's motion as turns and shifts along single axes: what an articulated inertia is carried by. [McMillanOrin1995]"""

from __future__ import annotations

from armwright import scalar
from armwright.kinematics.joint_motion import JointMotion
from armwright.model import Body
from armwright.scalar import Array, Scalar
from armwright.spatial import ArticulatedInertia, cross, snap, turned_vector

DUST = 1e-13  # [m], what is rounding in a shift

Turn = tuple[int, Scalar, Scalar]  # axis, cosine, sine


class AxialMotion:
    """The body's frame in its parent's, step by step: `slide` along z, then each of `turns`, then `shift` (3,) [m].

    The turns are z-x-z: the joint's own with the constant's last one, the twist α, and one about the parent's z which is 0
    where frames are Denavit-Hartenberg's; then `shift` lies along x alone.
    """

    def __init__(self, body: Body, motion: JointMotion, q: Scalar):
        r, p = body.placement.rotation, body.placement.position
        outer, twist, inner = _z_x_z(r)
        (ci, si), c, s = inner, motion.cos, motion.sin
        turns: list[Turn] = [(2, ci * c - si * s, ci * s + si * c), (0, *twist), (2, *outer)]
        self.turns = [turn for turn in turns if scalar.is_symbolic(*turn[1:]) or turn[1:] != (1.0, 0.0)]
        along, self.shift = _split(p, r[:, 2])
        self.slide = scalar.array([0.0, 0.0, along + body.kind.motion(q)[1] if body.kind.slides else along])

    def inertia_to_parent(self, inertia: ArticulatedInertia) -> ArticulatedInertia:
        """An articulated inertia about the body's origin, in its axes: about the parent's, in the parent's."""
        inertia = inertia.shifted(self.slide)
        for axis, c, s in self.turns:
            inertia = inertia.turned(axis, c, s)
        return inertia.shifted(self.shift)

    def force_to_parent(self, f: Array, n: Array) -> tuple[Array, Array]:
        """Force, and moment about the body's origin, in its axes: about the parent's, in the parent's."""
        n = n + cross(self.slide, f)
        for axis, c, s in self.turns:
            f, n = turned_vector(f, axis, c, s), turned_vector(n, axis, c, s)
        return f, n + cross(self.shift, f)

    def acceleration_to_body(self, a: Array, wd: Array) -> tuple[Array, Array]:
        """Acceleration of the parent's origin and angular acceleration, in its axes: the body's, in the body's, joint at rest."""
        a = a + cross(wd, self.shift)
        for axis, c, s in reversed(self.turns):
            a, wd = turned_vector(a, axis, c, -s), turned_vector(wd, axis, c, -s)
        return a + cross(wd, self.slide), wd


def _z_x_z(r: Array) -> Array:
    """Cosine and sine (3, 2) of three angles:  R = Rz(φ) Rx(α) Rz(ψ),  |φ| ≤ π/2, φ = 0 where the axes are parallel."""
    sine = scalar.hypot(r[0, 2], r[1, 2]) * scalar.where(scalar.less(0.0, r[1, 2]), -1.0, 1.0)
    tilted = scalar.less(0.0, scalar.abs(sine))
    divisor = scalar.where(tilted, sine, 1.0)
    c = scalar.where(tilted, -r[1, 2] / divisor, 1.0)
    s = scalar.where(tilted, r[0, 2] / divisor, 0.0)
    left = [c * r[0, 0] + s * r[1, 0], r[2, 2] * (c * r[1, 0] - s * r[0, 0]) + sine * r[2, 0]]
    return snap(scalar.array([[c, s], [r[2, 2], sine], left]))


def _split(p: Array, z: Array) -> tuple[Scalar, Array]:
    """A shift p (3,) in two, along the body's z axis and the rest, where no more numbers are left that way."""
    if scalar.is_symbolic(p, z):
        return 0.0, p
    along = float(p @ z)
    rest = scalar.array([0.0 if abs(x) <= DUST else x for x in p - along * z])
    as_few = (rest != 0.0).sum() + 1 <= (p != 0.0).sum()
    return (along, rest) if as_few else (0.0, p)

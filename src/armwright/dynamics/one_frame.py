"""Long arms in one frame: every body, force and motion in base axes, about the base's origin. [SinghRussellWensing2022]

In the frames of their links, forces are turned and shifted from joint to joint for every pair of joints; in one frame a pair
takes a few products. The way into that frame costs every joint once, so that short arms are better off in the links' frames.
A joint's axis is S = (a, u): what it turns about, and how fast it moves the point at the base's origin. Rounding grows with
the distance from that origin: relative to √(M_ii M_jj) the mass matrix of 100 joints is good to some 1e-11, in links' frames to
1e-14.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armwright import scalar
from armwright.kinematics.forward_kinematics import body_placements
from armwright.model import BASE, Body, Model
from armwright.scalar import Array, Scalar
from armwright.spatial import Placement, acceleration_tensor, cross, second_moment, skew

Motion = tuple[Array, Array]  # angular (3,), and linear (3,) of the point at the base's origin
STILL = (scalar.zeros(3), scalar.zeros(3))

# Joints that carry a joint, itself included, on average: a chain of n has (n + 1) / 2. Beyond it `link_slopes` takes fewer
# operations than automatic differentiation, fused products counted as one: of chains whose joints point anywhere from 8 joints
# on, of chains with right angles, where more folds away, from 10 on.
DEEPEST_AUTOMATIC = 5.4
# Operations of a mass matrix, counted likewise, to within 15 % of random chains and chains with right angles of 10 to 40 joints:
# in one frame, of a pair of joints, of a joint, and of a number in its constant placement that is neither 0 nor 1 …
OF_PAIR, OF_JOINT, OF_NUMBER = 6, 96, 9
# … and in links' frames, of a pair of joints one of which turns: for its turn by q, and for such a number.
OF_TURN, OF_LINK_NUMBER = 8.8, 2.2
FEWER = 1.15  # times as many in links' frames take as long


def carried_by(arm: Model) -> list[int]:
    """Number of joints of the tree that each one carries, itself included."""
    carried = [1] * len(arm.bodies)
    for i, body in arm.inward():
        if body.parent != BASE:
            carried[body.parent] += carried[i]
    return carried


def slopes_pay(arm: Model) -> bool:
    """True if `link_slopes` takes fewer operations than automatic differentiation: of a chain from 10 joints on.

    Told by how deep the tree is, without tracing anything.
    """
    return sum(carried_by(arm)) > DEEPEST_AUTOMATIC * len(arm.bodies)


def mass_matrix_pays(arm: Model) -> bool:
    """True if `link_mass_matrix` takes a seventh fewer operations than composite bodies in the frames of the links, or less.

    With as many it is slower: more of its operands come from memory. Counted from the arm's placements, without tracing
    anything: of chains whose joints point anywhere from 24 joints on, of chains with right angles from some 60 on.
    """
    in_links = in_base = 0.0
    for body, carried in zip(arm.bodies, carried_by(arm), strict=True):
        numbers = _numbers(body.placement)
        in_links += (carried - 1) * (OF_TURN * body.kind.turns + OF_LINK_NUMBER * numbers)
        in_base += OF_PAIR * carried + OF_JOINT + OF_NUMBER * numbers
    return FEWER * in_base < in_links


def _numbers(placement: Placement) -> int:
    """Entries of a placement that cost operations: of its rotation those that are neither 0 nor 1, of its position all but 0."""
    turned = [each for each in placement.rotation.flat if scalar.is_symbolic(each) or abs(each) not in (0.0, 1.0)]
    shifted = [each for each in placement.position if scalar.is_symbolic(each) or each != 0.0]
    return len(turned) + len(shifted)


def link_mass_matrix(arm: Model, q: Array) -> np.ndarray:
    """M of the links of a tree (n, n), without rotors:  M_ij = S_i · I_j S_j  for a joint i that carries j.

    I_j is the inertia of all bodies behind joint j.  [SinghRussellWensing2022]
    """
    placed = body_placements(arm, q)
    axes = [_axis(body, placed[i]) for i, body in arm.outward()]
    composite = [_inertia(body, placed[i]) for i, body in arm.outward()]
    columns = scalar.zeros(arm.n, arm.n)
    for j, body in arm.inward():
        inertia = _Inertia(*composite[j])
        wrench = inertia.times(axes[j])
        for i in _carriers(arm, j):
            columns[i, j] = columns[j, i] = _power(axes[i], wrench)
        _add(composite, body.parent, composite[j])
    return scalar.array(columns)


def link_slopes(arm: Model, q: Array, qd: Array, qdd: Array) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Torques of `link_torques` of a tree (n,), without a wrench, and their slopes (n, n) by q, q̇ and q̈.

    With V the velocity of the body that carries a joint and A its acceleration, gravity's taken off,  S' = V × S  and
    S'' = A × S + V × S'  are the joint's axis in motion. I is the inertia of all bodies behind joint j, F what they ask for, and
    B (a, u) = ∫ (r × (a × ṙ), a × ṙ) dm  half their Coriolis force in a frame that turns at a. For every joint i that carries j
    [CarpentierMansard2018] [SinghRussellWensing2022]

        ∂τ_i/∂q_j = S_i · (2 B S'_j + I S''_j + S_j ×* F)        ∂τ_j/∂q_i = 2 Bᵀ S_j · S'_i + I S_j · S''_i
        ∂τ_i/∂q̇_j = 2 S_i · (B S_j + I S'_j)                     ∂τ_j/∂q̇_i = 2 (Bᵀ S_j · S_i + I S_j · S'_i)
        ∂τ_i/∂q̈_j = S_i · I S_j

    Args:
        arm: a tree.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].   qdd: (n,) [rad/s² | m/s²].
    Returns:
        tau: (n,) [N m | N].   by_q, by_qd, by_qdd: (n, n) row torque, column coordinate; by_qdd is symmetric, M of the links.
    """
    placed = body_placements(arm, q)
    velocity, acceleration = {BASE: STILL}, {BASE: (STILL[0], -arm.gravity)}
    axes, axes_1, axes_2, composite = [], [], [], []
    for i, body in arm.outward():
        (w, v), (wd, vd) = velocity[body.parent], acceleration[body.parent]
        a, u = _axis(body, placed[i])
        a1, u1 = cross(w, a), cross(w, u) + cross(v, a)
        a2, u2 = cross(wd, a) + cross(w, a1), cross(wd, u) + cross(vd, a) + cross(w, u1) + cross(v, a1)
        velocity[i] = w + a * qd[i], v + u * qd[i]
        acceleration[i] = wd + a * qdd[i] + a1 * qd[i], vd + u * qdd[i] + u1 * qd[i]
        axes.append((a, u))
        axes_1.append((a1, u1))
        axes_2.append((a2, u2))
        composite.append(_moving(_inertia(body, placed[i]), velocity[i], acceleration[i]))
    n = arm.n
    tau, by_q, by_qd, by_qdd = scalar.zeros(n), scalar.zeros(n, n), scalar.zeros(n, n), scalar.zeros(n, n)
    for j, body in arm.inward():
        mass, first, second, momentum, rate, force, moment = composite[j]
        _add(composite, body.parent, composite[j])
        inertia, turning = _Inertia(mass, first, second), _complement(rate)
        a, u = axes[j]
        a1, _ = axes_1[j]
        here = inertia.times((a, u))
        pushed, pushed_1, pushed_2 = (
            (turning @ a, cross(a, momentum)),
            inertia.times(axes_1[j]),
            inertia.times(axes_2[j]),
        )
        at_speed = [2.0 * (x + y) for x, y in zip(pushed, pushed_1, strict=True)]
        at_place = (
            2.0 * (turning @ a1) + pushed_2[0] + cross(a, moment) + cross(u, force),
            2.0 * cross(a1, momentum) + pushed_2[1] + cross(a, force),
        )
        back, twice = 2.0 * (turning.T @ a + cross(momentum, u)), [2.0 * x for x in here]
        tau[j] = _power(axes[j], (moment, force))
        for i in _carriers(arm, j):
            by_qdd[i, j] = by_qdd[j, i] = _power(axes[i], here)
            by_q[i, j] = _power(axes[i], at_place)
            by_qd[i, j] = _power(axes[i], at_speed)
            if i != j:
                by_q[j, i] = back @ axes_1[i][0] + _power(axes_2[i], here)
                by_qd[j, i] = back @ axes[i][0] + _power(axes_1[i], twice)
    return scalar.array(tau), scalar.array(by_q), scalar.array(by_qd), scalar.array(by_qdd)


Bodies = tuple[Scalar, Array, Array]  # mass [kg], first moment (3,) [kg m], second moment ∫ r rᵀ dm (3, 3) [kg m²]
Moving = tuple[Scalar, Array, Array, Array, Array, Array, Array]  # and momentum, ∫ ṙ rᵀ dm, force and moment


class _Inertia:
    """The spatial inertia of bodies:  (a, u) ↦ (moment E a + h × u, force m u + a × h)."""

    def __init__(self, mass: Scalar, first: Array, second: Array):
        self.mass, self.first, self.tensor = mass, first, _complement(second)

    def times(self, motion: Motion) -> tuple[Array, Array]:
        """Moment and force."""
        a, u = motion
        return self.tensor @ a + cross(self.first, u), self.mass * u + cross(a, self.first)


def _axis(body: Body, placed: Placement) -> Motion:
    """S of a joint: (t z, s z + p × t z)."""
    turn, slide = body.kind.motion(1.0)
    z = placed.rotation[:, 2]
    return turn * z, slide * z + turn * cross(placed.position, z)


def _inertia(body: Body, placed: Placement) -> Bodies:
    """Mass, first and second moment of one body:  Σ = R Σ_body Rᵀ + k pᵀ + p kᵀ,  k = R h + ½ m p."""
    r, p = placed.rotation, placed.position
    half, h = r @ second_moment(body.inertia), r @ body.first_moment
    k = h + 0.5 * body.mass * p
    second = scalar.zeros(3, 3)
    for i in range(3):
        for j in range(i, 3):
            second[i, j] = second[j, i] = sum(half[i, l] * r[j, l] for l in range(3)) + k[i] * p[j] + p[i] * k[j]
    return body.mass, h + body.mass * p, scalar.array(second)


def _moving(bodies: Bodies, velocity: Motion, acceleration: Motion) -> Moving:
    """One body with its momentum, ∫ ṙ rᵀ dm, and the force and moment that it asks for about the base's origin."""
    (mass, first, second), (w, v), (wd, vd) = bodies, velocity, acceleration
    momentum = mass * v + cross(w, first)
    rate = skew(w) @ second + np.outer(v, first)
    at_origin, u = vd + cross(w, v), acceleration_tensor(w, wd)  # a point at r accelerates by  at_origin + U r
    g = u @ second
    moment = scalar.array([g[2, 1] - g[1, 2], g[0, 2] - g[2, 0], g[1, 0] - g[0, 1]]) + cross(first, at_origin)
    return mass, first, second, momentum, scalar.array(rate), mass * at_origin + u @ first, moment


def _complement(x: Array) -> np.ndarray:
    """tr(X) 1 - X: of the second moment the tensor of inertia."""
    return scalar.array((x[0, 0] + x[1, 1] + x[2, 2]) * scalar.eye(3) - x)


def _power(motion: Motion, wrench: tuple[Array, Array] | list[Array]) -> Scalar:
    return motion[0] @ wrench[0] + motion[1] @ wrench[1]


def _carriers(arm: Model, joint: int) -> Iterator[int]:
    """The joint, and those that carry it, down to the base."""
    while joint != BASE:
        yield joint
        joint = arm.bodies[joint].parent


def _add(composite: list, parent: int, bodies: tuple) -> None:
    """Adds what is behind a joint to the body that carries it."""
    if parent != BASE:
        composite[parent] = tuple(x + y for x, y in zip(composite[parent], bodies, strict=True))

"""The mass matrix by composite rigid bodies. [WalkerOrin1982] method 3, eqs (16)-(26) of the CMU report."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.actuators.coupling import coupled_inertia, shares_of
from armwright.dynamics.one_frame import link_mass_matrix, mass_matrix_pays
from armwright.joint_kinds import JointKind
from armwright.kinematics.joint_motion import joint_motions
from armwright.model import BASE, Mimics, Model, on_tree, one_state_with_masses
from armwright.scalar import Array
from armwright.spatial import cross, displaced_inertia


@one_state_with_masses
def mass_matrix(arm: Model, q: Array) -> np.ndarray:
    """M(q), rotors' inertia Nᵀ J_m N included, of coupled motors too:  kinetic energy = ½ q̇ᵀ M q̇.  [WalkerOrin1982]

    All bodies behind a joint are taken as one, turning with unit acceleration: its inertial force and moment, carried
    down to the base, are one column of M. The composite is kept as mass, first moment and tensor about the frame's
    origin, which need no division by a mass that may be 0. Long arms are computed in one frame where that takes
    fewer operations, from some 24 joints on (`one_frame.mass_matrix_pays`): entries are then good to 1e-13 of the largest one
    and, at 100 joints, to 1e-11 of √(M_ii M_jj), where composites in the links' frames lose no digits.

    Args:
        arm: the model.   q: (n,) [rad | m].
    Returns:
        M: (n, n) symmetric; [kg m²] for two revolute joints, [kg m] for mixed ones, [kg] for two prismatic ones.
    Example:
        >>> arm = aw.load("two-link")
        >>> aw.mass_matrix(arm, [0.3, 0.5]).round(3)
        array([[9.662, 2.257],
               [2.257, 0.853]])
    """
    inertia = _composite_bodies(arm, q)
    return scalar.array(inertia + coupled_inertia(arm)) if any(shares_of(arm)) else inertia


@on_tree(Mimics.inertia)
def _composite_bodies(arm: Model, q: Array) -> np.ndarray:
    """M of the links and of the rotors that one joint each turns."""
    if mass_matrix_pays(arm):
        return link_mass_matrix(arm, q) + np.diag(scalar.array([body.drive.joint_inertia for body in arm.bodies]))
    motion = joint_motions(arm, q)
    m = [body.mass for body in arm.bodies]
    h = [body.first_moment for body in arm.bodies]  # M_j c_j
    e = [body.inertia for body in arm.bodies]
    columns = scalar.zeros(arm.n, arm.n)
    for j, body in arm.inward():
        force, moment = _unit_acceleration(body.kind, m[j], h[j], e[j])  # (19)-(22)
        columns[j, j] = body.kind.project(moment, force)[2] + body.drive.joint_inertia  # (23)
        at = j
        while arm.bodies[at].parent != BASE:
            force, moment = motion[at].to_parent(force), motion[at].to_parent(moment)  # (24)
            moment = moment + cross(motion[at].position, force)  # (25)
            at = arm.bodies[at].parent
            columns[at, j] = columns[j, at] = arm.bodies[at].kind.project(moment, force)[2]  # (26)
        a = body.parent
        if a != BASE:
            p, shifted = motion[j].position, motion[j].to_parent(h[j])
            m[a] = m[a] + m[j]  # (16)
            h[a] = h[a] + shifted + m[j] * p  # (17)
            e[a] = e[a] + motion[j].tensor_to_parent(e[j]) + displaced_inertia(m[j], shifted, p)  # (18)
    return scalar.array(columns)


def _unit_acceleration(kind: JointKind, m: Array, h: Array, e: Array) -> tuple[Array, Array]:
    """Inertial force and moment about the origin of a body whose joint accelerates by 1."""
    force = kind.project(scalar.array([-h[1], h[0], 0.0]), scalar.array([0.0, 0.0, m]))  # z × h, m z
    return force, kind.project(e[:, 2], scalar.array([h[1], -h[0], 0.0]))  # E z, h × z

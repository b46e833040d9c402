"""Forward dynamics by articulated bodies, O(n). [Featherstone2008] chapter 7, [BrandlJohanniOtter1986]."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.actuators.coupling import shares_of
from armwright.actuators.friction import link_friction
from armwright.actuators.gear import loses_power
from armwright.dynamics.gears import motors
from armwright.dynamics.inverse import external_torques, inertial_forces
from armwright.dynamics.springs import sprung_torques
from armwright.errors import ModelError
from armwright.kinematics.axial_motion import AxialMotion
from armwright.kinematics.joint_motion import joint_motions
from armwright.model import BASE, Model, one_state_with_masses
from armwright.scalar import Array, Scalar
from armwright.spatial import ArticulatedInertia


@one_state_with_masses
def articulated_body(arm: Model, q: Array, qd: Array, tau: Array, wrench: Array | None = None) -> np.ndarray:
    """Accelerations that motor torques give, joint by joint: what `forward_dynamics` gives, in time linear in n.

    A joint feels all that hangs behind it as one articulated body of inertia I and bias force p, force and moment f at an
    acceleration a being  f = I a + p.  With S the joint's axis,  u = I S,  D = Sᵀ u + n² J_m,  r = tau - Sᵀ p:

        q̈ = (r - uᵀ a) / D
        I_parent += X (I - u uᵀ/D) Xᵀ,    p_parent += X (p + u r/D)

    Bias forces are those of the motion without q̈, gravity's included, so a is what q̈ adds to it.

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        tau: (n,) [N m | N] motor torque referred to the joints, before rotor, gear loss and friction.
        wrench: (6,) [N, N m] force and moment of the environment on the arm at the tip, in base axes.
    Returns:
        qdd: (n,) [rad/s² | m/s²]; not finite where the mass matrix is singular.
    Raises:
        ModelError: a wrench on an arm that branches and names no tip; joints that follow others, coupled motors and gears with
            loss, whose accelerations depend on each other all at once.
    Example:
        >>> arm = aw.load("two-link")
        >>> aw.articulated_body(arm, [0.3, 0.5], [1.0, -0.5], [20.0, 5.0]).round(3)
        array([-10.674,  20.384])
    """
    lossy = any(loses_power(body) for body in arm.coordinates)
    for met, what in (
        (arm.mimics is not None, "joints that follow others"),
        (any(shares_of(arm)), "coupled motors"),
        (lossy, "gears with loss"),
    ):
        if met:
            raise ModelError(
                f"not for arms with {what}",
                place="articulated_body",
                value=arm.name,
                expected="forward_dynamics or composite_body",
            )
    arm, driven, _ = motors(arm, qd, tau, external_torques(arm, q, qd, wrench))
    return articulated_accelerations(arm, q, qd, driven, link_friction(arm, qd), wrench)


def articulated_accelerations(
    arm: Model, q: Array, qd: Array, driven: Array, resisting: Array, wrench: Array | None = None
) -> np.ndarray:
    """`forward.accelerations` by the recursion over articulated bodies."""
    motion = joint_motions(arm, q)
    axial = [AxialMotion(body, motion[i], q[i]) for i, body in arm.outward()]
    share, d = articulated_shares(arm, axial)
    f, n = inertial_forces(arm, motion, qd, scalar.zeros(arm.n), wrench)
    net = driven - resisting
    if arm.is_sprung:
        net = net - sprung_torques(arm, q)
    freely = {}  # r/D, the acceleration of a joint whose parent has none beyond its bias
    for i, body in arm.inward():
        r = net[i] - body.kind.project(n[i], f[i])[2]
        freely[i] = r / d[i]
        if body.parent != BASE:
            k, kn = share[i]
            force, moment = axial[i].force_to_parent(f[i] + k * r, n[i] + kn * r)
            f[body.parent], n[body.parent] = f[body.parent] + force, n[body.parent] + moment
    a, wd, qdd = {BASE: scalar.zeros(3)}, {BASE: scalar.zeros(3)}, scalar.zeros(arm.n)
    for i, body in arm.outward():
        a[i], wd[i] = axial[i].acceleration_to_body(a[body.parent], wd[body.parent])
        k, kn = share[i]
        qdd[i] = freely[i] - (k @ a[i] + kn @ wd[i])
        about, along = body.kind.motion(qdd[i])
        if body.kind.turns:
            wd[i] = wd[i] + scalar.array([0.0, 0.0, about])
        if body.kind.slides:
            a[i] = a[i] + scalar.array([0.0, 0.0, along])
    return scalar.array(qdd)


def articulated_shares(
    arm: Model, axial: list[AxialMotion]
) -> tuple[dict[int, tuple[Array, Array]], dict[int, Scalar]]:
    """u/D as force and moment (3,), and D [kg m² | kg], of every joint: the recursion of articulated inertias.

    D are the pivots of the mass matrix taken from the tips, so they are positive where it is positive definite, and are those of
    an arm with regrouped parameters too: regrouping changes inertia only about axes that u does not contain.
    """
    inertia = [ArticulatedInertia.rigid(body.mass, body.first_moment, body.inertia) for body in arm.bodies]
    share, d = {}, {}
    for i, body in arm.inward():
        u, un = inertia[i].column(body.kind)
        d[i] = body.kind.project(un, u)[2] + body.drive.joint_inertia
        share[i] = u / d[i], un / d[i]
        if body.parent != BASE:
            left = inertia[i].without(body.kind, share[i], body.drive.joint_inertia)
            inertia[body.parent] = inertia[body.parent] + axial[i].inertia_to_parent(left)
    return share, d

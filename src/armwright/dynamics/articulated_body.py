"""Forward dynamics by articulated bodies, O(n). [Featherstone2008] chapter 7."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.actuators import friction_torques, transmission
from armwright.dynamics.inverse import newton_euler
from armwright.kinematics import JointMotion, joint_motions
from armwright.model import BASE, Body, Model, one_state
from armwright.scalar import Array
from armwright.spatial import skew


@one_state
def articulated_body(model: Model, q: Array, qd: Array, tau: Array, wrench: Array | None = None) -> np.ndarray:
    """Accelerations that motor torques give, joint by joint: what `forward_dynamics` gives, in time linear in n.

    A joint feels all that hangs behind it as one articulated body; with the bias torques already taken from tau the
    recursion needs inertias only:  D = Sᵀ I S + n² J_m,  U = I S,  q̈ = (r - Uᵀ a) / D.

    Args:
        model: the arm.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        tau: (n,) [N m | N] motor torque referred to the joints, before rotor, gear loss and friction.
        wrench: (6,) [N, N m] force and moment of the environment on the arm at the tip, in base axes.
    Returns:
        qdd: (n,) [rad/s² | m/s²].
    Raises:
        ModelError: a wrench on an arm that branches and names no tip.
    """
    left = newton_euler(model, q, qd, scalar.zeros(model.n), wrench) + friction_torques(model, qd)
    left = transmission(model, qd, tau) * tau - left
    motion = joint_motions(model, q)
    inertia = [_spatial_inertia(body) for body in model.bodies]
    pushed = [scalar.zeros(6)] * model.n  # force and moment behind each joint that its own joint does not take
    u, d, r = {}, {}, {}
    for i, body in model.inward():
        s = 5 if body.kind == "revolute" else 2  # S picks the moment or the force along z
        u[i] = inertia[i][:, s]
        d[i] = u[i][s] + body.drive.armature
        r[i] = left[i] - pushed[i][s]
        if body.parent != BASE:
            x = _force_transform(motion[i])
            behind = inertia[i] - np.outer(u[i], u[i] / d[i])
            inertia[body.parent] = inertia[body.parent] + x @ behind @ x.T
            pushed[body.parent] = pushed[body.parent] + x @ (pushed[i] + u[i] * (r[i] / d[i]))
    a, qdd = {BASE: scalar.zeros(6)}, scalar.zeros(model.n)
    for i, body in model.outward():
        carried = _force_transform(motion[i]).T @ a[body.parent]
        qdd[i] = (r[i] - u[i] @ carried) / d[i]
        own = scalar.zeros(6)
        own[5 if body.kind == "revolute" else 2] = qdd[i]
        a[i] = carried + own
    return scalar.array(qdd)


def _spatial_inertia(body: Body) -> np.ndarray:
    """(6, 6) about the body's origin: linear rows first, as everywhere in Armwright."""
    first = skew(body.first_moment)
    return scalar.array(np.block([[body.mass * np.eye(3), -first], [first, body.inertia]]))


def _force_transform(motion: JointMotion) -> np.ndarray:
    """(6, 6) that takes force and moment about the body's origin, body axes, to the parent's."""
    placed = motion.placement()
    r = placed.rotation
    return scalar.array(np.block([[r, scalar.zeros(3, 3)], [skew(placed.position) @ r, r]]))

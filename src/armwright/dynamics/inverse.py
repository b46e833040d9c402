"""Inverse dynamics by the recursive Newton-Euler algorithm, O(n). [LuhWalkerPaul1980], eqs (1)-(10) of the CMU report."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.actuators.friction import by_loads, friction_torques, link_friction
from armwright.dynamics.gears import motor_torques, without_rotors
from armwright.dynamics.springs import sprung_torques
from armwright.kinematics.joint_motion import JointMotion, joint_motions, origin_acceleration, turning
from armwright.model import BASE, Mimics, Model, on_tree, one_state_with_masses
from armwright.scalar import Array
from armwright.spatial import acceleration_tensor, cross, inertial_moment

STILL = scalar.zeros(3)


@one_state_with_masses
def inverse_dynamics(arm: Model, q: Array, qd: Array, qdd: Array, wrench: Array | None = None) -> np.ndarray:
    """Motor torques that give acceleration `qdd` in state (q, qd).  [LuhWalkerPaul1980]

    tau = G⁻¹(B⁻ᵀ r) + n² J_m B q̈ + f_m(B q̇),   r = M_links q̈ + C q̇ + g(q) + s(q) + f_links(q̇) - Jᵀ wrench:  what the joints
    need, s for springs, goes back through the gears G (`actuators.gear`), and the motors also accelerate their rotors and move
    against motor-side friction. B q̇ are the motors' speeds (B = 1 but for coupled motors). Without loss and coupling
    tau = M q̈ + C q̇ + g + s + f - Jᵀ wrench.  Friction by loads rises with tau itself: `friction_laws.load_dependent` solves
    for it, and says where it is NaN.

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].   qdd: (n,) [rad/s² | m/s²].
        wrench: (6,) [N, N m] force and moment of the environment on the arm at the tip, in base axes.
    Returns:
        tau: (n,) [N m | N] torques of the motors, each referred to its joint, before rotor, gear loss and friction.
    Raises:
        ModelError: a wrench on an arm that branches and names no tip.
    Example:
        >>> arm = aw.load("two-link")
        >>> q, qd, qdd = [0.3, 0.5], [1.0, -0.5], [0.0, 2.0]
        >>> aw.inverse_dynamics(arm, q, qd, qdd).round(3)
        array([81.629, 13.409])
    """
    return inverse_torques(arm, q, qd, qdd, wrench)


def inverse_torques(
    arm: Model, q: Array, qd: Array, qdd: Array, wrench: Array | None = None, nudge: Array | None = None
) -> np.ndarray:
    """`inverse_dynamics` at positions that `nudge` moves on, as in `newton_euler`."""
    of_links = torques_of_links(arm, q, qd, qdd, wrench, nudge)
    return motor_torques(arm, qd, qdd, of_links, external_torques(arm, q, qd, wrench, nudge))


def external_torques(
    arm: Model, q: Array, qd: Array, wrench: Array | None = None, nudge: Array | None = None
) -> np.ndarray | None:
    """τ_e of friction by loads, -(C q̇ + g + s) + Jᵀ wrench  (n,) [N m | N]; None where no joint has such friction."""
    if not any(map(by_loads, arm.coordinates)):
        return None
    return -newton_euler(arm, q, qd, scalar.zeros(arm.n), wrench, nudge)


@one_state_with_masses
def bias_torques(arm: Model, q: Array, qd: Array, wrench: Array | None = None) -> np.ndarray:
    """Torques that no acceleration asks for, the report's bias vector, eq. (14):  h = C q̇ + g(q) + s(q) + f(q̇) - Jᵀ wrench.

    Friction by loads is that at τ_m = h: tau = M q̈ + h does not hold with it.

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        wrench: (6,) [N, N m] force and moment of the environment on the arm at the tip, in base axes.
    Returns:
        h: (n,) [N m | N].
    Raises:
        ModelError: a wrench on an arm that branches and names no tip.
    Example:
        >>> arm = aw.load("two-link")
        >>> aw.bias_torques(arm, [0.3, 0.5], [1.0, -0.5]).round(3)
        array([77.114, 11.703])
    """
    needed = newton_euler(arm, q, qd, scalar.zeros(arm.n), wrench)
    return needed + friction_torques(arm, qd, -needed)


@one_state_with_masses
def gravity_torques(arm: Model, q: Array) -> np.ndarray:
    """Torques that hold the arm against gravity:  g(q) = ∂U/∂q, inverse dynamics at rest without friction and springs.

    Args:
        arm: the model.   q: (n,) [rad | m].
    Returns:
        g: (n,) [N m | N].
    Example:
        >>> arm = aw.load("two-link")
        >>> aw.gravity_torques(arm, [0.0, 0.0]).round(3)  # stretched out level
        array([84.366, 15.696])
    """
    return link_torques(arm, q, scalar.zeros(arm.n), scalar.zeros(arm.n))


def holding_torques(arm: Model, q: Array) -> np.ndarray:
    """Torques that hold the arm at rest against gravity and springs, g(q) + s(q)  (n,) [N m | N]; q (n,) [rad | m]."""
    return newton_euler(arm, q, scalar.zeros(arm.n), scalar.zeros(arm.n))


def torques_of_links(
    arm: Model, q: Array, qd: Array, qdd: Array, wrench: Array | None = None, nudge: Array | None = None
) -> np.ndarray:
    """Torques that the joints need behind the gears:  M_links q̈ + C q̇ + g + s + f_links - Jᵀ wrench  (n,) [N m | N].

    Friction by loads is not part of f_links (`motor_friction`).
    """
    torques = newton_euler(arm, q, qd, qdd, wrench, nudge) + link_friction(arm, qd)
    if arm.mimics is None:
        return torques
    followers = without_rotors(arm, arm.names)
    return torques + _rotor_torques(followers, qdd)


@on_tree(Mimics.torques)
def _rotor_torques(arm: Model, qdd: Array) -> np.ndarray:
    return scalar.array([body.drive.joint_inertia * qdd[i] for i, body in arm.outward()])


def newton_euler(
    arm: Model, q: Array, qd: Array, qdd: Array, wrench: Array | None = None, nudge: Array | None = None
) -> np.ndarray:
    """`link_torques`, and s(q) of springs where the arm has some  (n,) [N m | N]."""
    torques = link_torques(arm, q, qd, qdd, wrench, nudge)
    return torques + sprung_torques(arm, q, nudge) if arm.is_sprung else torques


@on_tree(Mimics.torques)
def link_torques(
    arm: Model, q: Array, qd: Array, qdd: Array, wrench: Array | None = None, nudge: Array | None = None
) -> np.ndarray:
    """The links' part alone:  M_links(q) q̈ + C(q, q̇) q̇ + g(q) - Jᵀ wrench  (n,) [N m | N].

    In Craig's form (each body's frame on its own joint's axis), so moments are about the body's own origin; the
    acceleration tensor U = ω̇× + ω×ω× carries equations (4), (5) and (7). `nudge` (n,) moves q on by a first-order
    amount, for derivatives; the wrench stays as it is in base axes.
    """
    motion = joint_motions(arm, q, nudge)
    f, n = inertial_forces(arm, motion, qd, qdd, wrench)
    tau = scalar.zeros(arm.n)
    for i, body in arm.inward():
        tau[i] = body.kind.project(n[i], f[i])[2]  # (10), the axis is z
        if body.parent != BASE:
            pushed = motion[i].to_parent(f[i])
            f[body.parent] = f[body.parent] + pushed  # (8)
            n[body.parent] = n[body.parent] + motion[i].to_parent(n[i]) + cross(motion[i].position, pushed)  # (9)
    return scalar.array(tau)


def inertial_forces(
    arm: Model, motion: list[JointMotion], qd: Array, qdd: Array, wrench: Array | None = None
) -> tuple[dict[int, Array], dict[int, Array]]:
    """Force and moment (3,) [N], [N m] that each body by itself asks for, about its origin, in its axes; less the wrench."""
    w, wd, vd, u = {BASE: STILL}, {BASE: STILL}, {BASE: -arm.gravity}, {BASE: scalar.zeros(3, 3)}
    f, n = {}, {}
    for i, body in arm.outward():
        a = body.parent
        w[i], wd[i] = turning(body, motion[i], w[a], wd[a], qd[i], qdd[i])  # (1) (2)
        vd[i] = origin_acceleration(body, motion[i], w[i], vd[a], u[a], qd[i], qdd[i])  # (4)
        u[i] = acceleration_tensor(w[i], wd[i])
        f[i] = body.mass * vd[i] + u[i] @ body.first_moment  # (5) (6)
        n[i] = inertial_moment(body.inertia, u[i]) + cross(body.first_moment, vd[i])  # (7), about the body's origin
    if wrench is not None:
        tip, force, moment = _wrench_on_body(arm, motion, wrench)
        if tip != BASE:
            f[tip], n[tip] = f[tip] - force, n[tip] - moment
    return f, n


def _wrench_on_body(arm: Model, motion: list[JointMotion], wrench: Array) -> tuple[int, Array, Array]:
    """The body that carries the tip, and the wrench as force and moment about its origin, in its axes."""
    tip = arm.frame()
    force, moment = wrench[:3], wrench[3:]
    for i in arm.path(tip.body):
        force, moment = motion[i].to_body(force), motion[i].to_body(moment)
    return tip.body, force, moment + cross(tip.placement.position, force)

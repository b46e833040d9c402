"""Kinetic and potential energy. [Featherstone2008]"""

from __future__ import annotations

from armwright import scalar
from armwright.actuators.coupling import shares_of, to_motors
from armwright.dynamics.springs import spring_potential
from armwright.kinematics.forward_kinematics import body_placements
from armwright.kinematics.joint_motion import joint_motions
from armwright.model import BASE, Model, on_tree, one_state_with_masses
from armwright.scalar import Array, Scalar
from armwright.spatial import cross


@one_state_with_masses
def energy(arm: Model, q: Array, qd: Array) -> tuple[Scalar, Scalar]:
    """Kinetic and potential energy, T and U: without friction, gear loss and drives their sum stays what it is.

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
    Returns:
        kinetic: () [J], links and rotors.   potential: () [J], zero where all mass lies at the base's origin.
    Example:
        >>> arm = aw.load("two-link")
        >>> np.round(aw.energy(arm, [0.3, 0.5], [1.0, -0.5]), 3)
        array([ 3.809, 31.553])
    """
    return kinetic_energy(arm, q, qd), potential_energy(arm, q)


@one_state_with_masses
def kinetic_energy(arm: Model, q: Array, qd: Array) -> Scalar:
    """T = ½ Σ ( m |v|² + 2 v·(ω × m c) + ω·I ω ) + ½ Σ n² J_m w²: from the velocities of bodies and motors.

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
    Returns:
        T: () [J], links and rotors.
    Example:
        >>> arm = aw.load("two-link")
        >>> round(float(aw.kinetic_energy(arm, [0.3, 0.5], [1.0, -0.5])), 3)
        3.809
    """
    total, shares = _kinetic_energy(arm, q, qd), shares_of(arm)
    for i, (body, w) in enumerate(zip(arm.coordinates, to_motors(shares, qd), strict=True)):
        if shares[i]:
            total = total + 0.5 * body.drive.reflected * w * w
    return total


@on_tree()
def _kinetic_energy(arm: Model, q: Array, qd: Array) -> Scalar:
    """T of the links and of the rotors that one joint each turns."""
    w, v, total = {BASE: scalar.zeros(3)}, {BASE: scalar.zeros(3)}, 0.0
    for (i, body), motion in zip(arm.outward(), joint_motions(arm, q), strict=True):
        w[i] = motion.to_body(w[body.parent])
        v[i] = motion.to_body(v[body.parent] + cross(w[body.parent], motion.position))
        about, along = body.kind.motion(qd[i])
        if body.kind.turns:
            w[i] = w[i] + scalar.array([0.0, 0.0, about])
        if body.kind.slides:
            v[i] = v[i] + scalar.array([0.0, 0.0, along])
        total = total + 0.5 * (
            v[i] @ (body.mass * v[i] + 2.0 * cross(w[i], body.first_moment))
            + w[i] @ (body.inertia @ w[i])
            + body.drive.joint_inertia * qd[i] * qd[i]
        )
    return total


@one_state_with_masses
def potential_energy(arm: Model, q: Array) -> Scalar:
    """U = - Σ m gᵀ p_c + U_springs, zero where all mass lies at the base's origin and springs are as `spring_potential` says.

    Args:
        arm: the model.   q: (n,) [rad | m].
    Returns:
        U: () [J].
    Example:
        >>> arm = aw.load("two-link")
        >>> low, high = (aw.potential_energy(arm, [angle, 0.0]) for angle in (0.0, 1.5708))
        >>> round(float(high - low), 2)
        84.37
    """
    placed = body_placements(arm, q)
    height = -sum(
        arm.gravity @ (placed[i].rotation @ body.first_moment + body.mass * placed[i].position)
        for i, body in arm.outward()
    )
    return height + spring_potential(arm, q) if arm.is_sprung else height

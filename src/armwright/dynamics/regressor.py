"""The dynamics as a linear function of masses, friction and rotors: what identification fits. [AtkesonAnHollerbach1986]

Newton and Euler's recursion is linear in every body's mass, first moment and tensor, so its slope by them is exact.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armwright import scalar
from armwright.actuators.friction import joint_friction
from armwright.dynamics.inverse import link_torques
from armwright.friction_laws import linear_parameters
from armwright.model import Body, Friction, Mimics, Model, on_tree, one_state
from armwright.scalar import Array, Scalar

LINEAR = linear_parameters()
COLUMNS = 6 + len(LINEAR)  # of one joint's `drive_parameters`


@one_state
@on_tree(Mimics.torques)
def regressor(arm: Model, q: Array, qd: Array, qdd: Array) -> np.ndarray:
    """Y of  M_links q̈ + C q̇ + g = Y(q, q̇, q̈) π,  π = `arm.inertial_parameters`.  [AtkesonAnHollerbach1986]

    Columns for each moving link, in the order of joints: [m, m c_x, m c_y, m c_z, Ixx, Ixy, Ixz, Iyy, Iyz, Izz], the
    tensor about the origin of the link's frame, in its axes, fixed links merged. Without gear loss, coupled motors and
    friction by loads tau = Y π + Y_d π_d + s, with `regressor_drive` and `spring_torques`: take s off measured torques before
    a fit.

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].   qdd: (n,) [rad/s² | m/s²].
    Returns:
        Y: (n, 10 N) [N m | N] per [kg, kg m, kg m²].
    Example:
        >>> arm = aw.load("two-link")
        >>> q, qd, qdd = [0.3, 0.5], [1.0, -0.5], [0.0, 2.0]
        >>> (aw.regressor(arm, q, qd, qdd) @ arm.inertial_parameters).round(3)
        array([81.629, 13.409])
    """

    def torques(parameters: np.ndarray) -> np.ndarray:
        bodies = (body.with_inertial_parameters(parameters[10 * i : 10 * i + 10]) for i, body in arm.outward())
        return link_torques(replace(arm, bodies=tuple(bodies)), q, qd, qdd)

    return scalar.jacobian(torques, scalar.zeros(10 * arm.n))


@one_state
@on_tree(Mimics.torques)
def regressor_drive(arm: Model, qd: Array, qdd: Array) -> np.ndarray:
    """Y_d of  Nᵀ J_m N q̈ + f(q̇) = Y_d(q̇, q̈) π_d,  π_d = `arm.drive_parameters`.  [OlssonEtAl1998]

    Friction by loads is that without load.

    Columns for each joint: [n² J_m, viscous, offset, Coulomb where q̇ > 0, Coulomb where q̇ < 0, Stribeck, sigmoid
    amplitude]. A column is 0 where the record has no such term: neither a Coulomb level nor a smoothing speed, no
    Stribeck level, no sigmoid.

    Args:
        arm: the model.   qd: (n,) [rad/s | m/s].   qdd: (n,) [rad/s² | m/s²].
    Returns:
        Y_d: (n, 7 N) [N m | N] per [kg m² | kg, N m s/rad | N s/m, then N m | N].
    Raises:
        ModelError: a motor that other joints turn as well, whose inertia is no number of one joint.
    Example:
        >>> arm = aw.load("cmu-dd")
        >>> aw.regressor_drive(arm, np.ones(6), np.ones(6)).shape
        (6, 42)
    """
    for body in arm.bodies:
        _ = body.drive.armature  # refuses coupled motors

    def torques(parameters: np.ndarray) -> np.ndarray:
        rows = parameters.reshape(arm.n, COLUMNS)
        return scalar.array([_drive(body, rows[i], qd[i], qdd[i]) for i, body in arm.outward()])

    return scalar.jacobian(torques, scalar.zeros(COLUMNS * arm.n))


def _drive(body: Body, parameters: Array, speed: Scalar, acceleration: Scalar) -> Scalar:
    """Rotor and friction of one joint, from its `drive_parameters`."""
    armature, viscous, offset, positive, negative, stribeck, *linear = parameters
    known = Friction() if body.friction is None else body.friction
    coefficients = list(known.parameters)
    for value, (law, place) in zip(linear, LINEAR, strict=True):
        if known.law == law:
            coefficients[place] = value
    if known.smoothing is None and not known.is_dry:
        positive = negative = 0.0
    friction = replace(
        known,
        viscous=viscous,
        offset=offset,
        coulomb_positive=positive,
        coulomb_negative=negative,
        stribeck=None if known.stribeck is None else stribeck,
        parameters=tuple(coefficients),
    )
    return armature * acceleration + joint_friction(friction, speed)

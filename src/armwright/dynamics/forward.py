"""Forward dynamics by whichever way takes fewer operations: composite bodies for short arms, articulated ones for long."""

from __future__ import annotations

import numpy as np

from armwright.actuators import drive_torque, friction_torques, transmission
from armwright.dynamics.articulated_body import articulated_accelerations
from armwright.dynamics.composite_body import composite_accelerations
from armwright.model import Model, one_state
from armwright.scalar import Array

SHORT = 5  # joints from the base to a body, itself included, on average: a chain of 9. Operations counted on 90 random trees
# and on chains: at 9 joints composite bodies take 1 % fewer, at 10 1 % more, at 14 a fifth, at 30 twice as many.


@one_state
def forward_dynamics(model: Model, q: Array, qd: Array, tau: Array, wrench: Array | None = None) -> np.ndarray:
    """Accelerations that motor torques give:  q̈ = M⁻¹ ( e tau - C q̇ - g - f + Jᵀ wrench ).  [WalkerOrin1982] [Featherstone2008]

    The exact inverse of `inverse_dynamics`, friction and gear loss included. By `composite_body` where bodies stand at most
    `SHORT` joints from the base on average, by `articulated_body` where they stand farther: they agree to rounding. Where
    joints follow others, by `composite_body`.

    Args:
        model: the arm.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        tau: (n,) [N m | N] motor torque referred to the joints, before rotor, gear loss and friction.
        wrench: (6,) [N, N m] force and moment of the environment on the arm at the tip, in base axes.
    Returns:
        qdd: (n,) [rad/s² | m/s²]; not finite where M is singular.
    Raises:
        ModelError: a wrench on an arm that branches and names no tip.
    """
    return accelerations(model, q, qd, transmission(model, qd, tau) * tau, friction_torques(model, qd), wrench)


def accelerations(
    model: Model, q: Array, qd: Array, driven: Array, resisting: Array, wrench: Array | None = None
) -> np.ndarray:
    """Accelerations for torques behind the gears and torques that resist, which replace the model's own gear loss and friction.

    q̈ = M⁻¹ ( driven - resisting - C q̇ - g + Jᵀ wrench ),  by the way that `forward_dynamics` chooses.

    Args:
        model: the arm.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].   driven, resisting: (n,) [N m | N].
        wrench: (6,) [N, N m] of the environment on the arm at the tip, in base axes.
    Returns:
        qdd: (n,) [rad/s² | m/s²]; not finite where M is singular.
    """
    far = model.mimics is None and sum(len(model.path(i)) for i in range(model.n)) > SHORT * model.n
    algorithm = articulated_accelerations if far else composite_accelerations
    return algorithm(model, q, qd, driven, resisting, wrench)


@one_state
def forward_arm(model: Model, q: Array, qd: Array, u: Array) -> np.ndarray:
    """The report's Forward Arm: drive commands in, accelerations out.  tau by eq. (12), then `forward_dynamics`.

    Args:
        model: the arm.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        u: (n,) [V | A | N m | N], each in the unit of its joint's drive command; no limit is applied.
    Returns:
        qdd: (n,) [rad/s² | m/s²].
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    return forward_dynamics(model, q, qd, drive_torque(model, qd, u))

"""Forward dynamics: composite bodies and a symmetric solve. [WalkerOrin1982] method 3, eqs (13)-(15) of the CMU report."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.actuators import drive_torque, transmission
from armwright.dynamics.inverse import bias_torques
from armwright.dynamics.mass_matrix import mass_matrix
from armwright.model import Model, one_state
from armwright.scalar import Array


@one_state
def forward_dynamics(model: Model, q: Array, qd: Array, tau: Array, wrench: Array | None = None) -> np.ndarray:
    """Accelerations that motor torques give:  q̈ = M⁻¹ ( e tau - C q̇ - g - f + Jᵀ wrench ).  [WalkerOrin1982]

    The exact inverse of `inverse_dynamics`, friction and gear loss included; M = L D Lᵀ is solved without pivots.

    Args:
        model: the arm.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        tau: (n,) [N m | N] motor torque referred to the joints, before rotor, gear loss and friction.
        wrench: (6,) [N, N m] force and moment of the environment on the arm at the tip, in base axes.
    Returns:
        qdd: (n,) [rad/s² | m/s²]; not finite where M is singular.
    Raises:
        ModelError: a wrench on an arm that branches and names no tip.
    """
    driven = transmission(model, qd, tau) * tau
    return scalar.solve_symmetric(mass_matrix(model, q), driven - bias_torques(model, q, qd, wrench))  # (15)


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

"""The arm about a state, as a linear system: what a control engineer designs for."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.actuators import drive_torque, transmission
from armwright.dynamics.derivatives import driven_derivatives
from armwright.model import Model, one_state
from armwright.scalar import Array


@one_state
def forward_arm_linearised(model: Model, q: Array, qd: Array, u: Array) -> tuple[np.ndarray, np.ndarray]:
    """A and B of  δẋ = A δx + B δu,  x = (q, q̇), about a state and its drive commands: the slopes of `forward_arm`.

    A = [[0, 1], [∂q̈/∂q, ∂q̈/∂q̇]],  B = [[0], [M⁻¹ ∂(e tau)/∂u]],  back EMF, friction and gear loss included.
    [CarpentierMansard2018] The state need not be an equilibrium.

    Args:
        model: the arm.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        u: (n,) [V | A | N m | N], each in the unit of its joint's drive command; no limit is applied.
    Returns:
        A: (2n, 2n) [1/s, 1/s², mixed joints as in `forward_dynamics_derivatives`].
        B: (2n, n) [rad/s² | m/s²] per unit of u.
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    n = model.n

    def driven(x: np.ndarray) -> np.ndarray:
        tau = drive_torque(model, x[:n], x[n:])
        return transmission(model, x[:n], tau) * tau

    slope = scalar.jacobian(driven, np.concatenate([qd, u]))
    by_q, by_qd, factors = driven_derivatives(model, q, qd, driven(np.concatenate([qd, u])), slope[:, :n])
    unit, none = np.eye(n), scalar.zeros(n, n)
    by_u = scalar.inverse_factored(factors) * slope[:, n:].diagonal()
    a = np.concatenate([np.concatenate([none, unit], axis=1), np.concatenate([by_q, by_qd], axis=1)])
    return scalar.array(a), scalar.array(np.concatenate([none, by_u]))

"""The Coriolis matrix of Christoffel symbols."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.dynamics.inverse import link_torques
from armwright.model import Model, one_state_with_masses
from armwright.scalar import Array


@one_state_with_masses
def coriolis_matrix(arm: Model, q: Array, qd: Array) -> np.ndarray:
    """C(q, q̇) of Christoffel symbols:  C_ij = ½ Σ_k (∂M_ij/∂q_k + ∂M_ik/∂q_j - ∂M_jk/∂q_i) q̇_k.  [SicilianoEtAl2009]

    C q̇ is `bias_torques` without gravity and friction, and Ṁ - 2C is skew. Newton and Euler's velocity torques are
    c_i = Σ_jk Γ_ijk q̇_j q̇_k with Γ symmetric in j and k, so C = ½ ∂c/∂q̇: their slope at half the speed.

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
    Returns:
        C: (n, n) [N m s/rad | N s/m] and, for mixed joints, [N m s/m, N s/rad].
    Example:
        >>> arm = aw.load("two-link")
        >>> qd = np.array([1.0, -0.5])
        >>> (aw.coriolis_matrix(arm, [0.3, 0.5], qd) @ qd).round(3)
        array([0.575, 0.767])
    """
    weightless = arm.replace(gravity=scalar.zeros(3))
    return scalar.jacobian(lambda x: link_torques(weightless, q, x, scalar.zeros(arm.n)), 0.5 * qd)

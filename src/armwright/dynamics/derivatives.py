"""Derivatives of inverse and forward dynamics by the state, exact to rounding. [GriewankWalther2008] [CarpentierMansard2018]

Newton and Euler's recursion is differentiated as it stands. A joint is moved by a first-order turn behind its own
(`JointMotion`), so that derivatives by q need no derivatives of sine and cosine.
"""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.actuators import transmission
from armwright.dynamics.inverse import behind_gear, bias_torques
from armwright.dynamics.mass_matrix import mass_matrix
from armwright.model import Model, one_state
from armwright.scalar import Array, Factored


@one_state
def inverse_dynamics_derivatives(
    model: Model, q: Array, qd: Array, qdd: Array, wrench: Array | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives of `inverse_dynamics`:  ∂tau/∂q, ∂tau/∂q̇ and M, with ∂tau/∂q̈ = diag(1/e) M.  [GriewankWalther2008]

    Friction and gear loss are in them. With B = e tau the torques behind the gears, ∂tau = (∂B - tau ∂e) / e;
    e = 1 without loss.

    Args:
        model: the arm.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].   qdd: (n,) [rad/s² | m/s²].
        wrench: (6,) [N, N m] force and moment of the environment on the arm at the tip, in base axes; it is held.
    Returns:
        dtau_dq: (n, n) row torque, column q; [N m/rad | N m/m, N/rad | N/m].
        dtau_dqd: (n, n) [N m s/rad | N m s/m, N s/rad | N s/m].
        M: (n, n) what `mass_matrix` gives, [kg m² | kg m | kg].
    Raises:
        ModelError: a wrench on an arm that branches and names no tip.
    """
    by_q, by_qd, mass = _behind_gear_derivatives(model, q, qd, qdd, wrench)
    if all(body.drive.efficiency is None for body in model.coordinates):
        return by_q, by_qd, mass
    torques = behind_gear(model, q, qd, qdd, wrench)
    e = transmission(model, qd, torques).reshape(model.n, 1)
    slope = scalar.jacobian(lambda x: transmission(model, x, torques), qd)
    tau = torques.reshape(model.n, 1) / e
    return scalar.array(by_q / e), scalar.array((by_qd - tau * slope) / e), mass


@one_state
def forward_dynamics_derivatives(
    model: Model, q: Array, qd: Array, tau: Array, wrench: Array | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives of `forward_dynamics`:  ∂q̈/∂q, ∂q̈/∂q̇ and M⁻¹, with ∂q̈/∂tau = M⁻¹ diag(e).  [CarpentierMansard2018]

    ∂q̈ = M⁻¹ (tau ∂e - ∂B) at the acceleration that tau gives, B the torques behind the gears; one factorisation serves all.
    Friction and gear loss are in them; e = 1 without loss.

    Args:
        model: the arm.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        tau: (n,) [N m | N] motor torque referred to the joints, before rotor, gear loss and friction.
        wrench: (6,) [N, N m] force and moment of the environment on the arm at the tip, in base axes; it is held.
    Returns:
        dqdd_dq: (n, n) row acceleration, column q; [1/s² | rad/(m s²), m/(rad s²) | 1/s²].
        dqdd_dqd: (n, n) [1/s | rad/(m s), m/(rad s) | 1/s].
        M_inverse: (n, n) [1/(kg m²) | 1/(kg m) | 1/kg]. None is finite where M is singular.
    Raises:
        ModelError: a wrench on an arm that branches and names no tip.
    """
    driven = transmission(model, qd, tau) * tau
    slope = scalar.jacobian(lambda x: transmission(model, x, tau) * tau, qd)
    by_q, by_qd, factors = driven_derivatives(model, q, qd, driven, slope, wrench)
    return by_q, by_qd, scalar.inverse_factored(factors)


def driven_derivatives(
    model: Model, q: Array, qd: Array, driven: Array, driven_by_qd: Array, wrench: Array | None = None
) -> tuple[np.ndarray, np.ndarray, Factored]:
    """∂q̈/∂q, ∂q̈/∂q̇ (n, n) and M's factors, for torques behind the gears (n,) that have the slope `driven_by_qd` (n, n)."""
    factors = scalar.factor_symmetric(mass_matrix(model, q))
    qdd = scalar.solve_factored(factors, driven - bias_torques(model, q, qd, wrench))
    by_q, by_qd, _ = _behind_gear_derivatives(model, q, qd, qdd, wrench, sign=-1.0)
    both = scalar.solve_factored(factors, np.concatenate([by_q, driven_by_qd + by_qd], axis=1))
    return both[:, : model.n], both[:, model.n :], factors


def _behind_gear_derivatives(
    model: Model, q: Array, qd: Array, qdd: Array, wrench: Array | None = None, sign: float = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """± ∂B/∂q, ∂B/∂q̇ and ∂B/∂q̈ = M (n, n) of the torques behind the gears, by one differentiation."""
    n = model.n

    def torques(x: np.ndarray) -> np.ndarray:
        return sign * behind_gear(model, q, x[n : 2 * n], x[2 * n :], wrench, nudge=x[:n])

    slope = scalar.jacobian(torques, np.concatenate([scalar.zeros(n), qd, qdd]))
    mass = slope[:, 2 * n :]
    mirrored = [[mass[min(i, j), max(i, j)] for j in range(n)] for i in range(n)]
    return slope[:, :n], slope[:, n : 2 * n], scalar.array(mirrored)

"""Coupled motors, as in wrists: several joints turn one motor.  θ_motor = N q with N off-diagonal.

Referred to each motor's own joint,  θ = B q,  B = diag(1/n) N with ones on its diagonal; torques come back by Bᵀ.
"""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.model import Model
from armwright.scalar import Array, Scalar

# For every motor, which other joints turn it and by how much: the rows of B - 1.
Shares = list[list[tuple[int, Scalar]]]


def shares_of(arm: Model) -> Shares:
    """B - 1 of an arm; all rows are empty where no motor is coupled."""
    index = {name: k for k, name in enumerate(arm.names)}
    return [
        [(index[name], ratio / body.drive.gear_ratio) for name, ratio in body.drive.coupling]
        for body in arm.coordinates
    ]


def motor_shares(arm: Model) -> np.ndarray:
    """B (n, n) of an arm, 1 without coupled motors; of rows of torques,  tau_joints = tau_motors B."""
    return np.asarray(_matrix(shares_of(arm)), dtype=float)


def to_motors(shares: Shares, q: Array) -> Array:
    """B q (n, …): positions or speeds of joints as those of the motors, referred to the motors' joints."""
    if not any(shares):
        return q
    return scalar.array([q[i] + sum(share * q[j] for j, share in row) for i, row in enumerate(shares)])


def to_joints(shares: Shares, torque: Array) -> np.ndarray:
    """Bᵀ tau (n,): torques of the motors as torques on the joints [N m | N]."""
    total = list(torque)
    for i, row in enumerate(shares):
        for j, share in row:
            total[j] = total[j] + share * torque[i]
    return scalar.array(total)


def from_motors(shares: Shares, motor: Array) -> Array:
    """B⁻¹ θ (n, …): positions or speeds of joints from those of the motors, referred to the motors' joints."""
    if not any(shares):
        return motor
    return _solved(_matrix(shares), motor)


def from_joints(shares: Shares, torque: Array) -> Array:
    """B⁻ᵀ tau (n, …): torques of the motors that act as these do on the joints [N m | N]."""
    if not any(shares):
        return torque
    return _solved(_matrix(shares).T, torque)


def _solved(matrix: np.ndarray, right: Array) -> np.ndarray:
    """x with  matrix x = right,  right (n, …), by elimination; numbers choose the largest pivot, symbols take the diagonal's."""
    a, x = np.array(matrix, dtype=object), np.array(right, dtype=object)
    n = len(a)
    for k in range(n):
        if not scalar.is_symbolic(a[k:, k]):
            row = k + int(np.abs(a[k:, k].astype(float)).argmax())
            a[[k, row]], x[[k, row]] = a[[row, k]], x[[row, k]]
        for i in range(k + 1, n):
            if scalar.is_symbolic(a[i, k]) or a[i, k] != 0.0:
                factor = a[i, k] / a[k, k]
                a[i, k:], x[i] = a[i, k:] - factor * a[k, k:], x[i] - factor * x[k]
    for k in reversed(range(n)):
        x[k] = (
            x[k] - sum(a[k, j] * x[j] for j in range(k + 1, n) if scalar.is_symbolic(a[k, j]) or a[k, j] != 0.0)
        ) / a[k, k]
    return scalar.array(x)


def _matrix(shares: Shares) -> np.ndarray:
    """B (n, n)."""
    b = scalar.eye(len(shares))
    for i, row in enumerate(shares):
        for j, share in row:
            b[i, j] = share
    return scalar.array(b)


def coupled_inertia(arm: Model) -> np.ndarray:
    """Σ Bᵢᵀ n² J_m Bᵢ (n, n) of the motors that several joints turn, in joint coordinates [kg m² | kg m | kg]."""
    inertia, shares = scalar.zeros(arm.n, arm.n), shares_of(arm)
    for i, body in enumerate(arm.coordinates):
        row = [(i, 1.0), *shares[i]] if shares[i] else []
        for a, share_a in row:
            for b, share_b in row:
                inertia[a, b] = inertia[a, b] + body.drive.reflected * share_a * share_b
    return scalar.array(inertia)

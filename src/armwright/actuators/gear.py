"""Gear loss: which share of the motor's torque reaches the arm, by the direction in which power flows."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.actuators.friction import smooth_sign
from armwright.model import Drive, Model
from armwright.scalar import Array, Scalar


def transmission(model: Model, qd: Array, torque: Array) -> np.ndarray:
    """e of design section 3: the arm receives e·tau, tau the motor's torque referred to the joint.

    With s = |q̇| / √(q̇² + smoothing²):  e = 1 - (1-η) s where the motor drives (torque·q̇ ≥ 0),
    e = 1 + (1/η - 1) s where it is driven back. e > 0, so `torque` may be either side's: the sign is the same.
    Continuous, dissipative and exactly invertible.

    Args:
        model: the arm.   qd: (n,) [rad/s | m/s].   torque: (n,) [N m | N] before or behind the gear.
    Returns:
        e: (n,) [-]; 1.0 where the gear has no loss.
    """
    return scalar.array([joint_transmission(body.drive, qd[i], torque[i]) for i, body in enumerate(model.coordinates)])


def joint_transmission(drive: Drive, speed: Scalar, torque: Scalar) -> Scalar:
    """e of one joint [-], at a speed [rad/s | m/s] and a torque [N m | N] on either side of the gear."""
    if drive.efficiency is None:
        return 1.0
    s = scalar.abs(smooth_sign(speed, drive.smoothing))
    lost, gained = 1.0 - drive.efficiency, 1.0 / drive.efficiency - 1.0
    return scalar.where(scalar.less(torque * speed, 0.0), 1.0 + gained * s, 1.0 - lost * s)

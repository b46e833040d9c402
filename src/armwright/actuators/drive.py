"""What a drive makes of its command, within its limits: design section 4, step 6."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.actuators.motor import check_command, joint_constant
from armwright.model import Body, Model
from armwright.scalar import Array, Scalar

UNITS = {"voltage": "V", "current": "A", "torque": "N m"}


@dataclass(frozen=True, eq=False)
class DriveOutput:
    """What the drives really do: torques referred to the joints, and voltages and currents of the motors.

    Voltage and current are NaN where the record has not the constants to know them.
    """

    tau: Array  # (n,) [N m | N]
    voltage: Array  # (n,) [V]
    current: Array  # (n,) [A]


def limited_drive(model: Model, qd: Array, u: Array) -> DriveOutput:
    """Torques that drives with limits give for their commands.

    A current limit (or the torque limit it amounts to, over |n| Kt) is realised through the voltage, so that power
    balances; then the voltage limit holds, even where that lets the current pass its own: a motor that is driven back
    faster than the supply can answer.

    Args:
        model: the arm.   qd: (n,) [rad/s | m/s].   u: (n,) [V | A | N m | N], by the joint's `command`.
    Returns:
        output: torque, voltage and current of every joint.
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    rows = [_limited(model, body, qd[i], u[i]) for i, body in model.outward()]
    return DriveOutput(*(scalar.array(column) for column in zip(*rows, strict=True)))


def _limited(model: Model, body: Body, speed: Scalar, u: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    check_command(model, body)
    drive, limits = body.drive, body.limits
    if drive.torque_constant is None:
        return _clipped(u, limits.torque), np.nan, np.nan
    constant = joint_constant(drive)
    size = scalar.abs(constant)
    most = min(limits.current, limits.torque / size) if not scalar.is_symbolic(size) else limits.current
    if drive.resistance is None:
        current = _clipped(u if drive.command == "current" else u / constant, most)
        return constant * current, np.nan, current
    r, back_emf = drive.resistance, drive.gear_ratio * drive.back_emf_constant * speed
    if drive.command == "voltage":
        voltage = u
        if most < np.inf:
            voltage = scalar.clip(u, back_emf - r * most, back_emf + r * most)
    else:
        voltage = r * _clipped(u if drive.command == "current" else u / constant, most) + back_emf
    voltage = _clipped(voltage, limits.voltage)
    current = (voltage - back_emf) * (1.0 / r)
    return constant * current, voltage, current


def _clipped(value: Scalar, most: float) -> Scalar:
    return scalar.clip(value, -most, most) if most < np.inf else value

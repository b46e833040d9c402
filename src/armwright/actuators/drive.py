"""What a drive makes of its command, within its limits: design section 4, step 6."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.actuators.coupling import from_joints, shares_of, to_motors
from armwright.actuators.motor import check_command, joint_constant, joint_current, joint_torque, joint_voltage
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
    rows = [limited_joint(model, body, qd[i], u[i]) for i, body in enumerate(model.coordinates)]
    return DriveOutput(*(scalar.array(column) for column in zip(*rows, strict=True)))


def demanded_drive(model: Model, qd: Array, tau: Array) -> DriveOutput:
    """Voltages and currents that torques ask of the motors, eq. (11) and i = tau / (n Kt), whatever the limits.

    Args:
        model: the arm.   qd: (n, …) [rad/s | m/s].   tau: (n, …) [N m | N].
    Returns:
        output: torque of every motor (tau itself, but for coupled ones), voltage and current, (n, …).
    """
    shares = shares_of(model)
    qd, tau = to_motors(shares, qd), from_joints(shares, tau)
    voltage, current = [], []
    for i, body in enumerate(model.coordinates):
        drive, unknown = body.drive, np.nan * tau[i]
        known = drive.torque_constant is not None
        current.append(joint_current(drive, tau[i]) if known else unknown)
        has_resistance = known and drive.resistance is not None
        voltage.append(joint_voltage(drive, qd[i], tau[i]) if has_resistance else unknown)
    return DriveOutput(tau, scalar.stack(voltage), scalar.stack(current))


def limited_joint(model: Model, body: Body, speed: Scalar, u: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Torque [N m | N], voltage [V] and current [A] of one drive, as `limited_drive`."""
    check_command(model, body)
    drive, supply = body.drive, body.limits.voltage
    if drive.torque_constant is None:
        return clipped(u, body.limits.torque), np.nan, np.nan
    constant, most = joint_constant(drive), most_current(body)
    if drive.command == "voltage":
        voltage = u
        if is_limit(most):
            lowest, highest = (joint_voltage(drive, speed, constant * i) for i in (-most, most))
            voltage = scalar.clip(u, lowest, highest)
        voltage = clipped(voltage, supply)
        torque = joint_torque(drive, speed, voltage)
        return torque, voltage, joint_current(drive, torque)
    if drive.command == "current":
        torque = constant * clipped(u, most)
    else:
        torque = clipped(u, scalar.abs(constant) * most) if is_limit(most) else u
    if drive.resistance is None:
        return torque, np.nan, joint_current(drive, torque)
    voltage = joint_voltage(drive, speed, torque)
    if is_limit(supply):
        voltage = clipped(voltage, supply)
        torque = joint_torque(drive, speed, voltage)
    return torque, voltage, joint_current(drive, torque)


def most_current(body: Body) -> Scalar:
    """The most current [A] that the limits of current and of torque allow; infinite without either."""
    current, torque = body.limits.current, body.limits.torque
    if not is_limit(torque):
        return current
    of_torque = joint_current(body.drive, torque)
    return scalar.minimum(current, scalar.abs(of_torque)) if is_limit(current) else scalar.abs(of_torque)


def clipped(value: Scalar, most: Scalar) -> Scalar:
    """The value within ±most, where that is a limit."""
    return scalar.clip(value, -most, most) if is_limit(most) else value


def is_limit(most: Scalar) -> bool:
    """Whether there is a limit at all: a symbol or a finite number."""
    return scalar.is_symbolic(most) or most < np.inf

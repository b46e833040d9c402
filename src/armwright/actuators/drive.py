"""All drives of an arm: torques for commands, commands for torques, and the command that holds the arm at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.actuators.coupling import from_joints, shares_of, to_motors
from armwright.actuators.dead_zone import command_for
from armwright.actuators.motor import check_command, joint_current, joint_voltage
from armwright.actuators.winding import driven_winding
from armwright.model import Model
from armwright.scalar import Array


@dataclass(frozen=True, eq=False)
class DriveOutput:
    """Torques of the motors referred to the joints, voltages and currents.

    Voltage and current are NaN where the record lacks the constants to know them.
    """

    tau: Array  # (n,) [N m | N]
    voltage: Array  # (n,) [V]
    current: Array  # (n,) [A]


def limited_drive(arm: Model, qd: Array, u: Array) -> DriveOutput:
    """Torques that drives with limits give for their commands in steady state, as `winding.driven_winding`.

    Args:
        arm: the model.   qd: (n,) [rad/s | m/s].   u: (n,) [V | A | N m | N], by the joint's `command`.
    Returns:
        output: torque, voltage and current of every joint.
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    rows, w = [], to_motors(shares_of(arm), qd)
    for i, body in enumerate(arm.coordinates):
        check_command(body)
        winding = driven_winding(body, body.drive, w[i], u[i], body.limits.voltage)
        rows.append((winding.torque, winding.voltage, winding.current))
    return DriveOutput(*(scalar.array(column) for column in zip(*rows, strict=True)))


def demanded_drive(arm: Model, qd: Array, tau: Array) -> DriveOutput:
    """Voltages and currents necessary for torques, eq. (11) and i = tau / (n Kt), without limits.

    Args:
        arm: the model.   qd: (n, …) of the joints [rad/s | m/s].
        tau: (n, …) of the motors, each referred to its joint, as `inverse_dynamics` gives them [N m | N].
    Returns:
        output: tau itself, voltage and current of every motor, (n, …).
    """
    qd = to_motors(shares_of(arm), qd)
    voltage, current = [], []
    for i, body in enumerate(arm.coordinates):
        drive, unknown = body.drive, np.nan * tau[i]
        has_constant = drive.torque_constant is not None
        current.append(joint_current(drive, tau[i]) if has_constant else unknown)
        has_resistance = has_constant and drive.resistance is not None
        voltage.append(joint_voltage(drive, qd[i], tau[i]) if has_resistance else unknown)
    return DriveOutput(tau, scalar.stack(voltage), scalar.stack(current))


def in_command_units(arm: Model, output: DriveOutput) -> np.ndarray:
    """Commands (n,) for given drive outputs, each in its joint's own unit [V | A | N m | N]."""
    parts = {"voltage": output.voltage, "current": output.current, "torque": output.tau}
    drives = [body.drive for body in arm.coordinates]
    return scalar.array([command_for(parts[drive.command][i], drive.dead_zone) for i, drive in enumerate(drives)])


def holding_command(arm: Model, torques: Array) -> np.ndarray:
    """Commands that balance the arm's weight and springs at rest, as far as the drives' limits allow.

    Args:
        arm: the model.   torques: (n,) [N m | N] that hold it at its pose.
    Returns:
        u: (n,) [V | A | N m | N], each in its joint's own unit.
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    still = scalar.array(0.0 * torques)
    torques = from_joints(shares_of(arm), torques)
    wanted = in_command_units(arm, demanded_drive(arm, still, torques))
    return in_command_units(arm, limited_drive(arm, still, wanted))

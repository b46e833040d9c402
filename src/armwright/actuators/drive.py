"""All drives of an arm: torques for commands, commands for torques, and the command that holds the arm at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.actuators.coupling import from_joints, shares_of, to_motors
from armwright.actuators.dead_zone import command_for
from armwright.actuators.firmware import bridged, error_for, with_goals, within_drive
from armwright.actuators.motor import check_command, joint_current, joint_voltage
from armwright.actuators.winding import driven_winding
from armwright.model import Body, Model
from armwright.scalar import Array, Scalar


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
        command, firmware, body = u[i], body.drive.firmware, bridged(body)
        if firmware is not None:
            command = within_drive(firmware, firmware.proportional * command, _supply_voltage(arm, body))
        winding = driven_winding(body, body.drive, w[i], command, body.limits.voltage)
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
    """Commands (n,) for given drive outputs, each in its joint's own unit [V | A | N m | N | rad]; a servo's is its error."""
    parts = {"voltage": output.voltage, "current": output.current, "torque": output.tau}
    commands = []
    for i, body in enumerate(arm.coordinates):
        drive, firmware = body.drive, body.drive.firmware
        if firmware is None:
            commands.append(command_for(parts[drive.command][i], drive.dead_zone))
        elif firmware.output == "duty":
            commands.append(error_for(firmware, output.voltage[i] / _supply_voltage(arm, body)))
        else:
            commands.append(error_for(firmware, output.current[i]))
    return scalar.array(commands)


def _supply_voltage(arm: Model, body: Body) -> Scalar:
    """Of which a servo's duty is a share [V]."""
    return body.limits.voltage if arm.supply is None else arm.supply.voltage


def holding_command(arm: Model, torques: Array, q: Array | None = None) -> np.ndarray:
    """Commands that balance the arm's weight and springs at rest, as far as the drives' limits allow.

    Args:
        arm: the model.   torques: (n,) [N m | N] that hold it at its pose.   q: (n,) [rad | m], that pose; servos count from it.
    Returns:
        u: (n,) [V | A | N m | N | rad], each in its joint's own unit.
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    still = scalar.array(0.0 * torques)
    torques = from_joints(shares_of(arm), torques)
    wanted = in_command_units(arm, demanded_drive(arm, still, torques))
    u = in_command_units(arm, limited_drive(arm, still, wanted))
    return scalar.array(u if q is None else with_goals(arm, u, q))

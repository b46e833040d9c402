"""Motor, gear and friction: equations over any scalar."""

from armwright.actuators.drive import DriveOutput, demanded_drive, holding_command, in_command_units, limited_drive
from armwright.actuators.firmware import with_goals
from armwright.actuators.friction import friction_torques
from armwright.actuators.motor import drive_torque, motor_current, motor_torque, motor_voltage

__all__ = [
    "DriveOutput",
    "demanded_drive",
    "drive_torque",
    "friction_torques",
    "holding_command",
    "in_command_units",
    "limited_drive",
    "motor_current",
    "motor_torque",
    "motor_voltage",
    "with_goals",
]

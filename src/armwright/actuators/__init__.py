"""Motor, gear and friction: equations over any scalar."""

from armwright.actuators.friction import friction_torques
from armwright.actuators.gear import transmission
from armwright.actuators.motor import drive_torque, motor_current, motor_torque, motor_voltage

__all__ = ["drive_torque", "friction_torques", "motor_current", "motor_torque", "motor_voltage", "transmission"]

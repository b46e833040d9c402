"""The motor with back EMF, inductance neglected: equations (11) and (12) of the CMU report, referred to the joints.

With n the gear ratio:   tau = n Kt i,   V = R i + Ke n q̇.  Where a motor is turned by several joints, q̇ is its own speed referred
to its joint, row i of B q̇ (`coupling`), and tau its own torque, referred likewise.
"""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.actuators.coupling import shares_of, to_motors
from armwright.description.drive import COMMAND_NEEDS
from armwright.errors import ModelError
from armwright.model import Body, Drive, Model, one_state
from armwright.scalar import Array, Scalar

ATTRIBUTES = {"resistance_ohm": "resistance", "torque_constant_n_m_per_a": "torque_constant"}  # by key of the record


@one_state
def motor_current(arm: Model, tau: Array) -> np.ndarray:
    """Armature currents for motor torques:  i = tau / (n Kt).

    Args:
        arm: the model.   tau: (n,) [N m | N], referred to the joints.
    Returns:
        i: (n,) [A].
    Raises:
        ModelError: a drive without a torque constant.
    Example:
        >>> arm = aw.load("cmu-dd")
        >>> aw.motor_current(arm, [15.0, 50.0, 7.0, 10.0, 1.0, 0.5]).round(2)
        array([1.79, 2.38, 1.75, 1.04, 0.72, 0.45])
    """
    _check_motors(arm, "motor_current", "torque_constant_n_m_per_a")
    return scalar.array([joint_current(body.drive, tau[i]) for i, body in enumerate(arm.coordinates)])


@one_state
def motor_voltage(arm: Model, qd: Array, tau: Array) -> np.ndarray:
    """Motor voltages for joint torques, eq. (11):  V = R tau / (n Kt) + n Ke q̇.

    Args:
        arm: the model.   qd: (n,) [rad/s | m/s].   tau: (n,) [N m | N], motor torque referred to the joints.
    Returns:
        V: (n,) [V].
    Raises:
        ModelError: a drive without resistance or torque constant.
    Example:
        >>> arm = aw.load("cmu-dd")
        >>> tau = aw.gravity_torques(arm, [0.0, 0.35, 0.0, 0.6, 0.0, 0.4])
        >>> aw.motor_voltage(arm, np.zeros(6), tau).round(2)  # what holds the arm still
        array([ 0.  , 22.52, -2.31, 11.91, -1.92,  0.93])
    """
    for body in arm.coordinates:
        _check_stateless(body, "a voltage of the motor")
    _check_motors(arm, "motor_voltage", *COMMAND_NEEDS["voltage"])
    w = to_motors(shares_of(arm), qd)
    return scalar.array([joint_voltage(body.drive, w[i], tau[i]) for i, body in enumerate(arm.coordinates)])


@one_state
def motor_torque(arm: Model, qd: Array, voltage: Array) -> np.ndarray:
    """Motor torques for voltages, eq. (12):  tau = n Kt (V - n Ke q̇) / R.

    Args:
        arm: the model.   qd: (n,) [rad/s | m/s].   voltage: (n,) [V].
    Returns:
        tau: (n,) [N m | N], referred to the joints, before rotor, gear loss and friction.
    Raises:
        ModelError: a drive without resistance or torque constant.
    Example:
        >>> arm = aw.load("cmu-dd")
        >>> aw.motor_torque(arm, np.zeros(6), [8, 12, 8, 4, 2, 1]).round(2)
        array([15.27, 52.5 ,  7.27,  9.85,  0.81,  0.33])
    """
    _check_motors(arm, "motor_torque", *COMMAND_NEEDS["voltage"])
    w = to_motors(shares_of(arm), qd)
    return scalar.array([joint_torque(body.drive, w[i], voltage[i]) for i, body in enumerate(arm.coordinates)])


def drive_torque(arm: Model, qd: Array, u: Array) -> np.ndarray:
    """Motor torques for commands, each in its joint's own unit: volts by eq. (12), amperes as n Kt i, torque as it is.

    Args:
        arm: the model.   qd: (n,) [rad/s | m/s].   u: (n,) [V | A | N m | N], by the joint's `command`.
    Returns:
        tau: (n,) [N m | N], referred to the joints, before rotor, gear loss and friction.
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    w = to_motors(shares_of(arm), qd)
    return scalar.array([_torque_of_command(body, w[i], u[i]) for i, body in enumerate(arm.coordinates)])


def _torque_of_command(body: Body, speed: Scalar, u: Scalar) -> Scalar:
    check_command(body)
    if body.drive.command == "torque":
        return u
    _check_stateless(body, "a command of position")
    if body.drive.command == "current":
        return joint_constant(body.drive) * u
    return joint_torque(body.drive, speed, u)


def _check_stateless(body: Body, what: str) -> None:
    """Refuses a servo, whose torque depends on what its loop remembers."""
    if body.drive.command == "position":
        expected = "forward_dynamics with its torque, or `simulate`, which turns its loop"
        raise ModelError(
            f"{what} goes through a servo's loop", place=f"{body.joint}.command", value="position", expected=expected
        )


def check_command(body: Body) -> None:
    """Refuses a drive that lacks the constants its command needs.

    Raises:
        ModelError: names the joint and the key.
    """
    command = body.drive.command
    check_constants(body, f"a command of {command}", *COMMAND_NEEDS[command])


def check_constants(body: Body, what: str, *keys: str) -> None:
    """Refuses a motor whose record lacks one of these constants, which `what` needs.

    Raises:
        ModelError: names the joint and the key.
    """
    for key in keys:
        if getattr(body.drive, ATTRIBUTES[key]) is None:
            raise ModelError(f"{what} needs it, and the record does not have it", place=f"{body.joint}.motor.{key}")


def _check_motors(arm: Model, what: str, *keys: str) -> None:
    """Refuses an arm whose motors lack constants."""
    for body in arm.coordinates:
        check_constants(body, what, *keys)


def joint_constant(drive: Drive) -> Scalar:
    """n Kt: torque at the joint per ampere."""
    return drive.gear_ratio * drive.torque_constant


def joint_current(drive: Drive, torque: Scalar) -> Scalar:
    """i = tau / (n Kt) of one joint [A]."""
    return torque / joint_constant(drive)


def joint_voltage(drive: Drive, speed: Scalar, torque: Scalar) -> Scalar:
    """Eq. (11) of one joint [V]."""
    emf = drive.gear_ratio * drive.back_emf_constant * speed
    return drive.resistance / joint_constant(drive) * torque + emf  # (11)


def joint_torque(drive: Drive, speed: Scalar, voltage: Scalar) -> Scalar:
    """Eq. (12) of one joint [N m | N]."""
    stall = joint_constant(drive) / drive.resistance  # [N m/V]
    return stall * (voltage - drive.gear_ratio * drive.back_emf_constant * speed)  # (12)

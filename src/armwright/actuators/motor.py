"""The motor with back EMF, inductance neglected: equations (11) and (12) of the CMU report, referred to the joints.

With n the gear ratio:   tau = n Kt i,   V = R i + Ke n q̇.
"""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.errors import ModelError
from armwright.model import Body, Drive, Model, one_state
from armwright.scalar import Array, Scalar

ELECTRICAL = {"resistance": "resistance_ohm", "torque_constant": "torque_constant_n_m_per_a"}


def need_constants(model: Model, what: str, *constants: str) -> None:
    """Refuses to compute `what` for an arm whose drives lack one of the named constants.

    Raises:
        ModelError: names the joint and the key that its record would need.
    """
    for body in model.coordinates:
        check_uncoupled(model, body, what)
        for constant in constants:
            if getattr(body.drive, constant) is None:
                key = f"motor.{ELECTRICAL[constant]}"
                raise ModelError(
                    f"{model.name}: {what} needs {key} of joint {body.joint!r}, which its record does not give"
                )


@one_state
def motor_current(model: Model, tau: Array) -> np.ndarray:
    """Armature currents for motor torques:  i = tau / (n Kt).

    Args:
        model: the arm.   tau: (n,) [N m | N], referred to the joints.
    Returns:
        i: (n,) [A].
    Raises:
        ModelError: a drive without a torque constant.
    """
    need_constants(model, "motor_current", "torque_constant")
    return scalar.array([joint_current(body.drive, tau[i]) for i, body in enumerate(model.coordinates)])


@one_state
def motor_voltage(model: Model, qd: Array, tau: Array) -> np.ndarray:
    """Motor voltages for joint torques, eq. (11):  V = R tau / (n Kt) + n Ke q̇.

    Args:
        model: the arm.   qd: (n,) [rad/s | m/s].   tau: (n,) [N m | N], motor torque referred to the joints.
    Returns:
        V: (n,) [V].
    Raises:
        ModelError: a drive without resistance or torque constant.
    """
    need_constants(model, "motor_voltage", "resistance", "torque_constant")
    return scalar.array([joint_voltage(body.drive, qd[i], tau[i]) for i, body in enumerate(model.coordinates)])


@one_state
def motor_torque(model: Model, qd: Array, voltage: Array) -> np.ndarray:
    """Motor torques for voltages, eq. (12):  tau = n Kt (V - n Ke q̇) / R.

    Args:
        model: the arm.   qd: (n,) [rad/s | m/s].   voltage: (n,) [V].
    Returns:
        tau: (n,) [N m | N], referred to the joints, before rotor, gear loss and friction.
    Raises:
        ModelError: a drive without resistance or torque constant.
    """
    need_constants(model, "motor_torque", "resistance", "torque_constant")
    return scalar.array([joint_torque(body.drive, qd[i], voltage[i]) for i, body in enumerate(model.coordinates)])


def drive_torque(model: Model, qd: Array, u: Array) -> np.ndarray:
    """Motor torques for commands, each in its joint's own unit: volts by eq. (12), amperes as n Kt i, torque as it is.

    Args:
        model: the arm.   qd: (n,) [rad/s | m/s].   u: (n,) [V | A | N m | N], by the joint's `command`.
    Returns:
        tau: (n,) [N m | N], referred to the joints, before rotor, gear loss and friction.
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    return scalar.array([_torque_of_command(model, i, qd[i], u[i]) for i in range(model.n)])


def _torque_of_command(model: Model, joint: int, speed: Scalar, u: Scalar) -> Scalar:
    body = model.coordinates[joint]
    check_uncoupled(model, body, "drive_torque")
    check_command(model, body)
    if body.drive.command == "torque":
        return u
    if body.drive.command == "current":
        return joint_constant(body.drive) * u
    return joint_torque(body.drive, speed, u)


def check_command(model: Model, body: Body) -> None:
    """Refuses a drive that lacks the constants its command needs.

    Raises:
        ModelError: names the joint.
    """
    needed = {"voltage": ("resistance", "torque_constant"), "current": ("torque_constant",), "torque": ()}
    for constant in needed[body.drive.command]:
        if getattr(body.drive, constant) is None:
            raise ModelError(
                f"{model.name}: joint {body.joint!r} is driven by {body.drive.command}, "
                f"but its record has no motor.{ELECTRICAL[constant]}"
            )


def check_uncoupled(model: Model, body: Body, what: str) -> None:
    """Refuses a motor that several joints turn, whose speed is not that of its joint.

    Raises:
        ModelError: names the joint.
    """
    if body.drive.coupling:
        raise ModelError(
            f"{model.name}: {what} does not know the coupled motor of joint {body.joint!r}, "
            f"which {body.drive.coupling[0][0]!r} turns as well; only the simulator does"
        )


def joint_constant(drive: Drive) -> Scalar:
    """n Kt: torque at the joint per ampere."""
    return drive.gear_ratio * drive.torque_constant


def joint_current(drive: Drive, torque: Scalar) -> Scalar:
    """i = tau / (n Kt) of one joint [A]."""
    return torque / joint_constant(drive)


def joint_voltage(drive: Drive, speed: Scalar, torque: Scalar) -> Scalar:
    """Eq. (11) of one joint [V]."""
    return (
        drive.resistance / joint_constant(drive) * torque + drive.gear_ratio * drive.back_emf_constant * speed
    )  # (11)


def joint_torque(drive: Drive, speed: Scalar, voltage: Scalar) -> Scalar:
    """Eq. (12) of one joint [N m | N]."""
    stall = joint_constant(drive) / drive.resistance  # [N m/V]
    return stall * (voltage - drive.gear_ratio * drive.back_emf_constant * speed)  # (12)

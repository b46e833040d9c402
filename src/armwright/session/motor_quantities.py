"""Torque, voltage and current of the motors, tied: what the drive is told is stored, the others follow, eqs (11) and (12).

A voltage drive stores its voltage, so its torque changes with omega; a current drive its current, a torque drive its torque.
"""

from __future__ import annotations

import numpy as np

from armwright.actuators import demanded_drive, drive_torque
from armwright.actuators.motor import joint_constant, joint_torque, joint_voltage
from armwright.errors import SessionError
from armwright.model import Body
from armwright.session.state import State


def torque(state: State) -> np.ndarray:
    """(n,) [N m | N] motor torques at the present speed, eq. (12).

    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    return np.asarray(drive_torque(state.arm, state.qd, state.u), dtype=float)


def voltage(state: State) -> np.ndarray:
    """(n,) [V] motor voltages, eq. (11); NaN where the record has not the constants to know one."""
    told = np.array([body.drive.command == "voltage" for body in state.arm.coordinates])
    demanded = np.asarray(demanded_drive(state.arm, state.qd, torque(state)).voltage, dtype=float)
    return np.where(told, state.u, demanded)


def current(state: State) -> np.ndarray:
    """(n,) [A] motor currents, tau / (n Kt); NaN where the record has no torque constant."""
    told = np.array([body.drive.command == "current" for body in state.arm.coordinates])
    demanded = np.asarray(demanded_drive(state.arm, state.qd, torque(state)).current, dtype=float)
    return np.where(told, state.u, demanded)


def with_torque(state: State, values: np.ndarray) -> State:
    """The state whose drives are told what gives those torques (n,) [N m | N] at the present speed."""
    joints = zip(state.arm.coordinates, state.qd, values, strict=True)
    return state.replace(u=np.array([_command(state, body, speed, value) for body, speed, value in joints]))


def with_voltage(state: State, values: np.ndarray) -> State:
    """The state with those motor voltages (n,) [V]; NaN leaves a joint as it is.

    Raises:
        SessionError: a joint whose motor's constants are not known.
    """
    commands = []
    for k, body in enumerate(state.arm.coordinates):
        if np.isnan(values[k]):
            commands.append(state.u[k])
            continue
        _need(state, body, "voltage", "torque_constant", "resistance")
        if body.drive.command == "voltage":
            commands.append(values[k])
        else:
            commands.append(_command(state, body, state.qd[k], joint_torque(body.drive, state.qd[k], values[k])))
    return state.replace(u=np.array(commands))


def with_current(state: State, values: np.ndarray) -> State:
    """The state with those motor currents (n,) [A]; NaN leaves a joint as it is.

    Raises:
        SessionError: a joint whose motor's torque constant is not known.
    """
    commands = []
    for k, body in enumerate(state.arm.coordinates):
        if np.isnan(values[k]):
            commands.append(state.u[k])
            continue
        _need(state, body, "current", "torque_constant")
        if body.drive.command == "current":
            commands.append(values[k])
        else:
            commands.append(_command(state, body, state.qd[k], joint_constant(body.drive) * values[k]))
    return state.replace(u=np.array(commands))


def _command(state: State, body: Body, speed: float, value: float) -> float:
    """What a drive is told to give a torque, in its own unit."""
    if body.drive.command == "torque":
        return value
    _need(state, body, "torque", "torque_constant")
    if body.drive.command == "current":
        return float(value / joint_constant(body.drive))
    _need(state, body, "torque", "resistance")
    return float(joint_voltage(body.drive, speed, value))


def _need(state: State, body: Body, what: str, *constants: str) -> None:
    if body.drive.coupling:
        raise SessionError(
            f"{what}: the motor of joint {body.joint!r} is turned by {body.drive.coupling[0][0]!r} as well; "
            "its torque and voltage are not tied one to one"
        )
    names = {"torque_constant": "torque constant", "resistance": "resistance"}
    for constant in constants:
        if getattr(body.drive, constant) is None:
            raise SessionError(
                f"{what} is not available: the record of {state.arm.name} gives no motor {names[constant]} for joint "
                f"{body.joint!r}, which is driven by {body.drive.command}; expected {body.drive.command}"
            )

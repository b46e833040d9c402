"""Torque, voltage and current of the motors: the drive's command is stored, the others are computed, eqs (11) and (12).

A voltage drive stores its voltage, so its torque changes with omega; a current drive its current, a torque drive its torque.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armwright.actuators import demanded_drive, drive_torque
from armwright.actuators.coupling import shares_of, to_motors
from armwright.actuators.motor import joint_constant, joint_torque, joint_voltage
from armwright.errors import SessionError
from armwright.model import Body
from armwright.session.state import SessionState


def torque(state: SessionState) -> np.ndarray:
    """(n,) [N m | N] motor torques at the present speed, eq. (12).

    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    return np.asarray(drive_torque(state.arm, state.qd, state.u), dtype=float)


def voltage(state: SessionState) -> np.ndarray:
    """(n,) [V] motor voltages, eq. (11); NaN where the robot file lacks the constants for them."""
    return _command_or_demand(state, "voltage")


def current(state: SessionState) -> np.ndarray:
    """(n,) [A] motor currents, tau / (n Kt); NaN where the robot file has no torque constant."""
    return _command_or_demand(state, "current")


def _command_or_demand(state: SessionState, quantity: str) -> np.ndarray:
    """The command where the drives take this quantity, else what the torque demands."""
    is_command = np.array([body.drive.command == quantity for body in state.arm.coordinates])
    demand = demanded_drive(state.arm, state.qd, torque(state))
    return np.where(is_command, state.u, np.asarray(getattr(demand, quantity), dtype=float))


def with_torque(state: SessionState, values: np.ndarray) -> SessionState:
    """The state with the commands that give these torques (n,) [N m | N] at the present speed."""
    joints = zip(state.arm.coordinates, to_motors(shares_of(state.arm), state.qd), values, strict=True)
    return state.replace(u=np.array([_command(body, speed, value) for body, speed, value in joints]))


def with_voltage(state: SessionState, values: np.ndarray) -> SessionState:
    """The state with these motor voltages (n,) [V]; NaN leaves a joint as it is.

    Raises:
        SessionError: a joint whose motor's constants are not known.
    """
    constants = ("torque_constant", "resistance")
    return _with(state, values, "voltage", constants, lambda body, qd, volts: joint_torque(body.drive, qd, volts))


def with_current(state: SessionState, values: np.ndarray) -> SessionState:
    """The state with these motor currents (n,) [A]; NaN leaves a joint as it is.

    Raises:
        SessionError: a joint whose motor's torque constant is not known.
    """
    return _with(
        state, values, "current", ("torque_constant",), lambda body, qd, amperes: joint_constant(body.drive) * amperes
    )


def _with(
    state: SessionState, values: np.ndarray, quantity: str, constants: tuple[str, ...], torque_of: Callable[..., float]
) -> SessionState:
    """The state with these values of a quantity, which (body, speed, value) → torque [N m | N] turns into torques."""
    commands = []
    speeds = to_motors(shares_of(state.arm), state.qd)
    for body, speed, command, value in zip(state.arm.coordinates, speeds, state.u, values, strict=True):
        if np.isnan(value):
            commands.append(command)
            continue
        _need(body, quantity, *constants)
        is_command = body.drive.command == quantity
        commands.append(value if is_command else _command(body, speed, torque_of(body, speed, value)))
    return state.replace(u=np.array(commands))


def _command(body: Body, speed: float, value: float) -> float:
    """The command, in the drive's own unit, that gives a torque [N m | N]."""
    if body.drive.command == "torque":
        return value
    _need(body, "torque", "torque_constant")
    if body.drive.command == "current":
        return float(value / joint_constant(body.drive))
    _need(body, "torque", "resistance")
    return float(joint_voltage(body.drive, speed, value))


def _need(body: Body, quantity: str, *constants: str) -> None:
    """Refuses a quantity that does not follow from a joint's command."""
    place = f"{quantity}[{body.joint}]"
    for constant in constants:
        if getattr(body.drive, constant) is None:
            what = f"not available: the robot file gives no motor {constant.replace('_', ' ')} for this joint"
            raise SessionError(what, place=place, expected=f"{body.drive.command}, its command")

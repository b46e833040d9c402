"""The plant: x = (q, q̇), driven by commands through drives with limits."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.actuators import limited_drive
from armwright.dynamics import forward_dynamics
from armwright.model import Model
from armwright.scalar import Array


def plant_derivative(model: Model, x: Array, u: Array) -> np.ndarray:
    """dx/dt of the arm with its motors:  d(q, q̇)/dt = (q̇, F(q, q̇, tau)),  tau what the drives make of u.

    Args:
        model: the arm.   x: (2n,) positions, then speeds [rad | m, rad/s | m/s].
        u: (n,) commands [V | A | N m | N].
    Returns:
        xd: (2n,) [rad/s | m/s, rad/s² | m/s²].
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    q, qd = x[: model.n], x[model.n :]
    qdd = forward_dynamics(model, q, qd, limited_drive(model, qd, u).tau)
    return scalar.array(np.concatenate([qd, qdd]))


def plant_outputs(model: Model, x: Array, u: Array) -> tuple[np.ndarray, ...]:
    """What is recorded beside the state: q̈, motor torque, and voltage and current of the motors.

    Args:
        model: the arm.   x: (2n,) [rad | m, rad/s | m/s].   u: (n,) [V | A | N m | N].
    Returns:
        qdd: (n,) [rad/s² | m/s²].   tau: (n,) [N m | N].   voltage: (n,) [V].   current: (n,) [A].
    """
    q, qd = x[: model.n], x[model.n :]
    drive = limited_drive(model, qd, u)
    return forward_dynamics(model, q, qd, drive.tau), drive.tau, drive.voltage, drive.current

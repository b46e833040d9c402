"""Commands of motor torques: each in its joint's own unit, with the sense of its motor."""

from __future__ import annotations

import numpy as np

from armwright.actuators import demanded_drive, in_command_units
from armwright.model import Model
from armwright.scalar import Array


def torque_commands(model: Model, qd: Array, tau: Array) -> np.ndarray:
    """Commands (n,) that give motor torques: eq. (11) for voltages, tau / (n Kt) for currents, without limits.

    A servo's is the error for which its P gives that voltage or current; `with_goals` makes it its goal.

    Args:
        model: the arm.   qd: (n,) [rad/s | m/s].   tau: (n,) [N m | N].
    Returns:
        u: (n,) [V | A | N m | N | rad], each in its joint's own unit.
    """
    return in_command_units(model, demanded_drive(model, qd, tau))


def command_signs(model: Model) -> np.ndarray:
    """(n,) -1 for a joint that moves backward at a positive voltage or current (negative gear ratio), else 1."""
    return np.array(
        [
            -1.0 if body.drive.command in ("voltage", "current") and float(body.drive.gear_ratio) < 0.0 else 1.0
            for body in model.coordinates
        ]
    )

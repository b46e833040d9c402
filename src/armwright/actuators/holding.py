"""The command that holds an arm still."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.actuators.drive import demanded_drive, limited_drive
from armwright.model import Model
from armwright.scalar import Array


def told_command(model: Model, output) -> np.ndarray:
    """What the drives do (n,) in the unit of each joint's command [V | A | N m | N]."""
    parts = {"voltage": output.voltage, "current": output.current, "torque": output.tau}
    return scalar.array([parts[body.drive.command][i] for i, body in enumerate(model.coordinates)])


def holding_command(model: Model, gravity_torques: Array) -> np.ndarray:
    """Commands whose torques balance the arm's weight at rest, as far as the drives' limits allow.

    Args:
        model: the arm.   gravity_torques: (n,) [N m | N] at the pose to be held.
    Returns:
        u: (n,) [V | A | N m | N], each in its joint's own unit.
    Raises:
        ModelError: a drive without the constants that its command needs.
    """
    still = scalar.array(0.0 * gravity_torques)
    wanted = told_command(model, demanded_drive(model, still, gravity_torques))
    return told_command(model, limited_drive(model, still, wanted))

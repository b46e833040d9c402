"""Errors at rest of a controller without an integral: commands of dry friction and weight over the joint's stiffness."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.actuators.coupling import motor_shares
from armwright.control.commands import torque_commands
from armwright.control.computed_torque import ComputedTorque
from armwright.control.design.joint_plants import current_driven
from armwright.dynamics import holding_torques, mass_matrix
from armwright.model import Friction, Model


def rest_errors(arm: Model, control: Any, law: Any, stiffness: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """(2, n) [rad | m] errors that dry friction, and weight that the controller does not compensate, may leave at rest.

    Args:
        arm: the model.   control: the whole controller.   law: the one within it that is designed.
        stiffness: (n,) k_s k_p of it.   poses: (k, n) [rad | m] among which weights are largest.
    """
    n, shares = arm.n, motor_shares(arm)
    frictions = [body.friction or Friction() for body in arm.coordinates]
    levels = np.array([max(f.coulomb_positive, f.coulomb_negative, f.stribeck or 0.0) for f in frictions], dtype=float)
    of_motors = np.array([f.on_motor for f in frictions])
    if isinstance(law, ComputedTorque):  # its gains act through the mass matrix
        at_joints = np.where(of_motors, 0.0, levels) + np.abs(shares).T @ np.where(of_motors, levels, 0.0)
        mass = np.min([np.diagonal(mass_matrix(arm, q)) for q in poses], axis=0)
        return np.array([at_joints, np.zeros(n)]) / (stiffness * mass)
    to_motors = np.linalg.inv(shares).T  # of coupled motors one's torque reaches several joints
    friction = np.where(of_motors, levels, 0.0) + np.abs(to_motors) @ np.where(of_motors, 0.0, levels)
    weights = np.zeros(n)
    if not _compensates(control):
        weights = np.max([np.abs(to_motors @ holding_torques(arm, q)) for q in poses], axis=0)
    driven = arm if getattr(law, "current_kp", None) is None else current_driven(arm)
    commands = [np.abs(torque_commands(driven, np.zeros(n), each)) for each in (friction, weights)]
    return np.array(commands, dtype=float) / stiffness


def rest_sentences(arm: Model, friction: np.ndarray, weight: np.ndarray) -> list[str]:
    """The largest of the errors (n,) in words, and what would take them away; none where there are none."""
    found = []
    for cause, error in (("dry friction", friction), ("weight that nothing compensates", weight)):
        worst = int(np.argmax(error))
        if error[worst] > 0.0:
            body = arm.coordinates[worst]
            unit = body.kind.units.position
            found.append(f"{cause} up to {error[worst]:.2g} {unit} (joint {body.joint!r})")
    remedy = "an integral gain above 0 in the scenario takes that away"
    return [f"without an integral, {' and '.join(found)} may be left at rest; {remedy}"] if found else []


def _compensates(control: Any) -> bool:
    """True where a controller, or one within it, adds the commands that hold the arm."""
    return getattr(control, "gravity", False) is True or (hasattr(control, "inner") and _compensates(control.inner))

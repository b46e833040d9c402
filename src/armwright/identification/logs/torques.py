"""Torques of a log: the signal that they are known from, and the torques on the joints that follow from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from armwright.actuators import drive_torque
from armwright.actuators.coupling import shares_of, to_joints
from armwright.description.drive import Command
from armwright.kernels.compiled import CompiledArm
from armwright.model import Model
from armwright.signals import Layout

Source = Literal["tau", "current", "voltage", "tau_link"]
SOURCES: tuple[Source, ...] = ("tau", "current", "voltage", "tau_link")
LoggedCommand = Literal["voltage", "current", "torque"]
# by signal, in the order in which they drive an arm
COMMANDS: dict[str, LoggedCommand] = {"voltage": "voltage", "current": "current", "tau": "torque"}
BEHIND_GEARS = ("rotors", "viscous", "coulomb", "offset")  # what a torque sensor behind the gear does not feel


def torque_source(layout: Layout) -> Source | None:
    """The signal of a log that torques are known from: the first of `SOURCES`; None if it has none."""
    return next((signal for signal in SOURCES if signal in layout), None)


def missing_terms(lacks: Sequence[str], source: Source | None) -> tuple[str, ...]:
    """Terms that the torques of a source are without.

    Args:
        lacks: as the log's file has them, of torques.   source: as of `torque_source`.
    """
    return {"tau": tuple(lacks), "tau_link": tuple(dict.fromkeys([*lacks, *BEHIND_GEARS]))}.get(source or "", ())


def torques_on_joints(
    arm: Model, source: Source, values: np.ndarray, qd: np.ndarray, dyn: CompiledArm | None = None
) -> np.ndarray:
    """Torques on the joints (rows, n) [N m | N], Bᵀ times those of the motors, from torques, currents or voltages.

    Args:
        arm: the model.   source: the signal.   values: (rows, n) of it.   qd: (rows, n) [rad/s | m/s], needed of voltages.
        dyn: its kernels, for voltages; None: by NumPy.
    Raises:
        ModelError: a motor without the constants that the signal needs.
    """
    if source in ("tau", "tau_link"):
        return values
    if source == "voltage" and dyn is not None:
        of_motors = dyn.motor_torque(qd, values).T
    else:
        of_motors = drive_torque(with_command(arm, source), qd.T, values.T)
    shares = shares_of(arm)
    return np.asarray(to_joints(shares, of_motors), dtype=float).T if any(shares) else of_motors.T


def with_command(arm: Model, command: Command) -> Model:
    """The arm with drives that take another kind of command, servos without their loops."""
    bodies = (replace(body, drive=replace(body.drive, command=command, firmware=None)) for body in arm.bodies)
    return replace(arm, bodies=tuple(bodies))

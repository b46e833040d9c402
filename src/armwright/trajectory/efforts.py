"""Torques and voltages that a motion needs, with what the hand carries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from armwright.kernels.compiled import compile_arm
from armwright.model import Model
from armwright.model.changes import without_servos
from armwright.model.payload import Payload
from armwright.trajectory.rest import Torques, torques


def in_order(payload: Payload | Sequence[Payload] | None) -> list[Payload]:
    """Bodies in the order in which the hand takes them up."""
    return [payload] if isinstance(payload, Payload) else sorted(payload or (), key=lambda each: each.time)


def is_massless(arm: Model) -> bool:
    """True for an arm whose record does not know the masses of its links."""
    return bool(arm.without_masses) or not np.asarray(arm.inertial_parameters, dtype=float).any()


def without_constants(arm: Model) -> list[str]:
    """Names of the joints whose motors' voltages do not follow from their torques."""
    return [
        body.joint for body in arm.coordinates if body.drive.resistance is None or body.drive.torque_constant is None
    ]


def efforts(
    arm: Model,
    t: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    payload: Payload | Sequence[Payload] | None = None,
    wrench: Any = None,
    fastest: np.ndarray | None = None,
) -> dict[str, Torques]:
    """Torques and voltages of the motors by quantity, (k, n) [N m | N] and [V], with their bands, as far as the record allows.

    Those of a joint at rest are without dry friction, also where its speed is the rounding of 0.

    Args:
        arm: the model.   t: (k,) [s] increasing.   q, qd, qdd: (k, n) [rad | m, …/s, …/s²].
        payload: bodies in the hand, each from its time on.   wrench: (6,) [N, N m] on the tip, in base axes.
        fastest: (n,) largest speeds of the motion; None: of the rows.
    """
    if is_massless(arm):
        return {}
    bodies = in_order(payload)
    force = () if wrench is None else (np.asarray(wrench, dtype=float),)
    begins = [-np.inf, *(float(each.time) for each in bodies), np.inf]
    fastest = np.abs(qd).max(axis=0, initial=0.0) if fastest is None else fastest
    parts = []
    for begin, end, body in zip(begins[:-1], begins[1:], [None, *bodies], strict=True):
        rows = (t >= begin) & (t < end)
        loaded = arm
        if body is not None and float(body.mass) > 0.0:
            loaded = arm.with_payload(body.mass, body.com, body.inertia, body.frame)
        if rows.any():
            parts.append(torques(arm, compile_arm(loaded), q[rows], qd[rows], qdd[rows], *force, fastest=fastest))
    found = Torques(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Torques)))
    if without_constants(arm):
        return {"torque": found}
    dyn = compile_arm(without_servos(arm))
    volts = [dyn.motor_voltage(found.qd, each) for each in (found.tau, found.low, found.high)]
    low, high = np.minimum(*volts[1:]), np.maximum(*volts[1:])  # swapped where the gear turns the motor the other way
    return {"torque": found, "voltage": Torques(found.qd, volts[0], low, high, found.held)}

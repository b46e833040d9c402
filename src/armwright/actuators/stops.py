"""End stops: springs with dampers at a joint's position limits."""

from __future__ import annotations

from dataclasses import dataclass

from armwright import scalar
from armwright.model import Stops
from armwright.scalar import Scalar


@dataclass(frozen=True, eq=False)
class Stopped:
    """What the stops of a joint do."""

    torque: Scalar  # on the joint [N m | N]
    loss: Scalar  # [W]
    energy: Scalar  # [J] in their springs


def stopped(stops: Stops, low: Scalar, high: Scalar, q: Scalar, qd: Scalar) -> Stopped:
    """max(0, k p + d ṗ) against the joint where p > 0,  p = q - high or low - q: how far it is in the stop.

    Args:
        stops: k and d.   low, high: where they stand [rad | m].   q: [rad | m].   qd: [rad/s | m/s].
    """
    torque, loss, energy = 0.0, 0.0, 0.0
    for sign, depth in ((1.0, q - high), (-1.0, low - q)):
        inside, into = scalar.maximum(depth, 0.0), sign * qd
        spring = stops.stiffness * inside
        push = scalar.where(scalar.less(0.0, depth), scalar.maximum(spring + stops.damping * into, 0.0), 0.0)
        torque, loss = torque - sign * push, loss + (push - spring) * into
        energy = energy + 0.5 * stops.stiffness * inside * inside
    return Stopped(torque, loss, energy)

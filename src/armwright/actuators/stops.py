"""End stops: springs with dampers at a joint's position limits."""

from __future__ import annotations

from dataclasses import dataclass

from armwright import scalar
from armwright.model import Stops
from armwright.scalar import Scalar


@dataclass(frozen=True, eq=False)
class Stopped:
    """Torque of a joint's stops and its parts."""

    torque: Scalar  # on the joint [N m | N]
    loss: Scalar  # [W]
    energy: Scalar  # [J] in their springs
    pushes: tuple[Scalar, Scalar]  # k p + d ṗ of either stop [N m | N]: they let go where it is below 0


def stop_depths(low: Scalar, high: Scalar, q: Scalar) -> tuple[Scalar, Scalar]:
    """p = q - high and low - q [rad | m]: how far the joint is in either stop, below 0 outside."""
    return q - high, low - q


def stopped(
    stops: Stops, low: Scalar, high: Scalar, q: Scalar, qd: Scalar, touching: tuple[Scalar, Scalar] | None = None
) -> Stopped:
    """max(0, k p + d ṗ) against the joint where p ≥ 0,  p = q - high or low - q: how far it is in the stop.

    Args:
        stops: k and d.   low, high: where they stand [rad | m].   q: [rad | m].   qd: [rad/s | m/s].
        touching: 1 where the joint counts as in the upper and in the lower stop; None: where p ≥ 0.
    """
    torque, loss, energy, pushes = 0.0, 0.0, 0.0, []
    depths = stop_depths(low, high, q)
    touching = touching or (scalar.less_equal(0.0, depths[0]), scalar.less_equal(0.0, depths[1]))
    for sign, depth, touch in zip((1.0, -1.0), depths, touching, strict=True):
        inside, into = scalar.maximum(depth, 0.0), sign * qd
        spring = stops.stiffness * inside
        pushes.append(stops.stiffness * depth + stops.damping * into)
        push = scalar.where(touch, scalar.maximum(pushes[-1], 0.0), 0.0)
        torque, loss = torque - sign * push, loss + (push - spring) * into
        energy = energy + 0.5 * stops.stiffness * inside * inside
    return Stopped(torque, loss, energy, (pushes[0], pushes[1]))

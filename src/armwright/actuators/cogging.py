"""Cogging: the torque of a motor's magnets on its slots. [HendershotMiller2010]"""

from __future__ import annotations

from armwright import scalar
from armwright.model import Cogging
from armwright.scalar import Scalar


def cogging_torque(cogging: Cogging, angle: Scalar) -> Scalar:
    """amplitude · sin(periods θ + phase) [N m] at the motor, which stands at θ = angle [rad]."""
    return cogging.amplitude * scalar.sin(cogging.periods * angle + cogging.phase)


def cogging_energy(cogging: Cogging, angle: Scalar) -> Scalar:
    """amplitude / periods · cos(periods θ + phase) [J], whose slope is the torque's negative: a motor cogs without loss."""
    return cogging.amplitude / cogging.periods * scalar.cos(cogging.periods * angle + cogging.phase)

"""Backlash: a gap between flanks, in which nothing is transmitted. [NordinGutman2002]"""

from __future__ import annotations

from armwright import scalar
from armwright.scalar import Scalar


def flank_depths(deflection: Scalar, gap: Scalar) -> tuple[Scalar, Scalar]:
    """δ - gap/2 and -δ - gap/2 [rad | m]: how far either pair of flanks is pressed into each other, below 0 apart."""
    return deflection - 0.5 * gap, -deflection - 0.5 * gap


def beyond_gap(deflection: Scalar, gap: Scalar) -> Scalar:
    """δ' = δ - clip(δ, -gap/2, gap/2) [rad | m]: how far flanks are pressed into each other; 0 in the gap."""
    return deflection - scalar.clip(deflection, -0.5 * gap, 0.5 * gap)


def pushed(touching: tuple[Scalar, Scalar], torque: Scalar) -> Scalar:
    """The torque [N m | N] where it pushes on flanks that touch, else 0: they never pull.

    Args:
        touching: 1 where the flanks touch that push the link forward, and those that push it back.   torque: of the gear.
    """
    forward = scalar.where(touching[0], scalar.maximum(torque, 0.0), 0.0)
    return forward + scalar.where(touching[1], scalar.minimum(torque, 0.0), 0.0)

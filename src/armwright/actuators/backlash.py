"""Backlash: a gap between flanks, in which nothing is transmitted. [NordinGutman2002]"""

from __future__ import annotations

from armwright import scalar
from armwright.scalar import Scalar


def beyond_gap(deflection: Scalar, gap: Scalar) -> Scalar:
    """δ' = δ - clip(δ, -gap/2, gap/2) [rad | m]: how far flanks are pressed into each other; 0 in the gap."""
    return deflection - scalar.clip(deflection, -0.5 * gap, 0.5 * gap)


def pushed(pressed: Scalar, torque: Scalar) -> Scalar:
    """The torque [N m | N] where it pushes in the direction of δ', else 0: flanks touch, but never pull."""
    forward = scalar.where(scalar.less(0.0, pressed), scalar.maximum(torque, 0.0), 0.0)
    return scalar.where(scalar.less(pressed, 0.0), scalar.minimum(torque, 0.0), forward)

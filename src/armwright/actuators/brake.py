"""A holding brake: it gives way like a spring until it slips, and lets go over its release time. [Dahl1968]"""

from __future__ import annotations

from armwright import scalar
from armwright.actuators.lugre import Bristle
from armwright.model import Brake
from armwright.scalar import Scalar


def holding(brake: Brake, speed: Scalar, z: Scalar, applied: Scalar) -> Bristle:
    """torque = k z + d ż,  ż = q̇ - k |q̇| / holding z  while applied;  torque = k z,  ż = -z / release_time  while released.

    It holds without creeping: below its holding torque it is a spring.

    Args:
        brake: referred to the joint.   speed: q̇ [rad/s | m/s].   z: how far it gave way [rad | m].
        applied: 1 where it is applied, 0 where it is released.
    """
    assert brake.stiffness is not None, "a rigid brake has no state"
    slip = -brake.stiffness * scalar.abs(speed) / brake.holding
    bending = applied * (speed + slip * z)
    open_ = (1.0 - applied) / brake.release_time
    return Bristle(brake.stiffness * z + brake.damping * bending, bending - open_ * z, applied * slip - open_)

"""LuGre: friction as the bending of bristles, one more state a joint. [CanudasEtAl1995]"""

from __future__ import annotations

from dataclasses import dataclass

from armwright import scalar
from armwright.actuators.friction import viscous_torque
from armwright.friction_laws.levels import dry_level
from armwright.model import Friction
from armwright.scalar import Array, Scalar

LEAST = 1e-3  # of the dry level: bristles that slip at nothing would be infinitely fast


@dataclass(frozen=True, eq=False)
class Bristle:
    """Bristles of one joint."""

    torque: Scalar  # friction, against positive motion [N m | N]
    speed: Scalar  # ż [rad/s | m/s]
    rate: Scalar  # ∂ż/∂z [1/s], never above 0: z is linear in itself and is integrated exactly


def bristle_friction(
    friction: Friction, speed: Scalar, z: Scalar, load: Scalar | None = None, warming: Scalar | None = None
) -> Bristle:
    """f = offset + σ0 z + σ1 ż + viscous q̇,   ż = q̇ - σ0 |q̇| / g(q̇) z,  g the dry level of `friction.dry_level`.

    In steady sliding  z = g/σ0 sgn q̇  and f is the static map, without smoothing.

    Args:
        friction: referred to the joint.   speed: q̇ [rad/s | m/s].   z: mean bending [rad | m].
        load: torque through the gear [N m | N].   warming: [K], as in `joint_friction`, but at least a thousandth of g remains.
    """
    stiffness, damping = friction.parameters
    level = dry_level(friction, speed, load, warming)
    if friction.coulomb_temperature_coefficient is not None:
        level = scalar.maximum(level, LEAST * dry_level(friction, speed))
    rate = -stiffness * scalar.abs(speed) / level
    bending = speed + rate * z
    torque = friction.offset + stiffness * z + damping * bending + viscous_torque(friction, speed, warming)
    return Bristle(torque, bending, rate)


def sliding(friction: Friction, speed: Array) -> Array:
    """z in steady sliding, g/σ0 sgn q̇ [rad | m]; 0 at rest."""
    return scalar.sign(speed) * dry_level(friction, speed) / friction.parameters[0]

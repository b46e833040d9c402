"""Joint friction as a static map of speed: viscous friction, an offset, and one of `friction_laws.LAWS`.

Dry friction without a smoothing speed is any torque within its levels at rest, which the simulator solves for (`sticks` of the
record's friction). The map here has its value in motion, and 0 at rest: one number for every state, as kernels need it.
A law of its own state stands in a file of its own (`lugre`); here it has the map of its steady state.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armwright import scalar
from armwright.actuators.coupling import shares_of, to_joints, to_motors
from armwright.friction_laws import LAWS
from armwright.friction_laws.law import Loads
from armwright.friction_laws.levels import same, warmed
from armwright.joint_kinds import ROTARY
from armwright.model import Body, Friction, Mimics, Model, on_tree
from armwright.scalar import Array, Scalar


def joint_friction(
    friction: Friction | None, speed: Scalar, load: Loads | Scalar | None = None, warming: Scalar | None = None
) -> Scalar:
    """Friction torque of one joint [N m | N] at a speed [rad/s | m/s], positive against positive motion.

    f = offset + viscous q̇ + the law's torque. With a warming [K], which only the simulator knows, as `dry_level` and
    `viscous_torque`; with a load [N m | N], which it knows of elastic gears and bristles, as `dry_level`. The load-proportional
    friction of all others is part of the gear's loss (`gear.gear_loss`). A law `by_loads` takes `Loads`; without them they are 0.
    """
    if friction is None:
        return 0.0
    torque = friction.offset + viscous_torque(friction, speed, warming)
    return LAWS[friction.law].add(torque, friction, speed, load, warming)


def sliding_friction(
    friction: Friction,
    speed: Scalar,
    direction: Scalar,
    load: Loads | Scalar | None = None,
    warming: Scalar | None = None,
) -> Scalar:
    """Friction torque [N m | N] of a joint that slides in a stated direction, 1 or -1, which its speed's sign may not show yet.

    offset + viscous q̇ + direction · g: the Coulomb level is that of `direction`, the Stribeck fall that of |q̇|. Direction 0 is
    a joint at rest, whose dry friction does not follow from its speed and is left out.
    """
    level = LAWS[friction.law].level(friction, speed, load, warming, direction)
    return friction.offset + viscous_torque(friction, speed, warming) + direction * level


def viscous_torque(friction: Friction, speed: Scalar, warming: Scalar | None = None) -> Scalar:
    """viscous q̇ exp(-warming / fall), or viscous q̇ max(0, 1 + coefficient · warming).  [BittencourtGunnarsson2012]"""
    torque = friction.viscous * speed
    if warming is not None and friction.viscous_fall is not None:
        return torque * scalar.exp(-warming / friction.viscous_fall)
    return warmed(torque, friction.viscous_temperature_coefficient, warming)


def smoothing_key(body: Body) -> str:
    """Key of a joint's smoothing speed in its record."""
    on_motor = body.friction is not None and body.friction.on_motor
    return f"friction.{(ROTARY if on_motor else body.kind.units).key('smoothing', 'speed')}"


def has_corner(friction: Friction) -> bool:
    """True where the slope jumps as a joint turns back: |q̇| of bristles, another Coulomb level for either direction."""
    return LAWS[friction.law].bends or not same(friction.coulomb_positive, friction.coulomb_negative)


def by_loads(body: Body) -> bool:
    """True if the level of a joint's friction depends on the torques of its motor and of all else, `Loads`."""
    return body.friction is not None and LAWS[body.friction.law].by_loads


def friction_torques(arm: Model, qd: Array, external: Array | None = None) -> np.ndarray:
    """Friction of all joints and motors, f(q̇): what the joints need beside the links' dynamics. [OlssonEtAl1998]

    Motor-side friction acts on the motors' speeds, and on the joints by Bᵀ where motors are coupled. Friction by loads is that
    of motors that keep the speed,  τ_m = f(q̇, τ_m, τ_e) - τ_e;  without `external` its level is that without load.

    Args:
        arm: the model.   qd: (n,) [rad/s | m/s].
        external: (n,) τ_e [N m | N], torques on the joints that depend on the state alone, positive forward.
    Returns:
        f: (n,) [N m | N], joint side; 0 where the record has no friction.
    """
    shares = shares_of(arm)
    w = to_motors(shares, qd)
    loaded = [external is not None and by_loads(body) for body in arm.coordinates]
    motors = [0.0 if loaded[i] else motor_friction(body, w[i]) for i, body in enumerate(arm.coordinates)]
    f = scalar.array(link_friction(arm, qd) + to_joints(shares, motors))
    if external is None or not any(loaded):
        return f
    tau_e = zip(arm.coordinates, qd, f, external, loaded, strict=True)
    return scalar.array([driving_torque(body, v, f - e, e) + e if by_load else f for body, v, f, e, by_load in tau_e])


def motor_friction(body: Body, speed: Scalar, loads: Loads | None = None) -> Scalar:
    """Friction on the motor's side of a joint's gear [N m | N], by the motor's speed; both referred to the joint.

    Friction by loads counts there on either side: its gear has no other loss, and its motor turns one joint.
    """
    if body.friction is None or not _before_gear(body):
        return 0.0
    return joint_friction(body.friction, speed, loads if by_loads(body) else None)


def driving_torque(body: Body, speed: Scalar, needed: Scalar, external: Scalar) -> Scalar:
    """Torque of a motor [N m | N] that meets friction by loads at a speed and leaves the torque `needed`, by τ_e `external`."""
    friction = body.friction
    assert friction is not None
    needed = needed + friction.offset + viscous_torque(friction, speed)
    return LAWS[friction.law].motor_torque(friction, speed, needed, external)


def _before_gear(body: Body) -> bool:
    return body.friction is not None and (body.friction.on_motor or by_loads(body))


def link_friction(arm: Model, qd: Array) -> np.ndarray:
    """Friction behind the gears (n,) [N m | N] but that by loads, and all that of joints that follow others."""
    names = set(arm.names)
    bodies = (
        replace(body, friction=None) if body.joint in names and _before_gear(body) else body for body in arm.bodies
    )
    return _all_friction(replace(arm, bodies=tuple(bodies)), qd)


@on_tree(Mimics.torques)
def _all_friction(arm: Model, qd: Array) -> np.ndarray:
    return scalar.array([joint_friction(body.friction, qd[i]) for i, body in arm.outward()])

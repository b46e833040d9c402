"""A gear that gives way: spring and damper between motor and link, harmonic drives too. [Spong1987] [TuttleSeering1996]"""

from __future__ import annotations

from dataclasses import dataclass

from armwright import scalar
from armwright.actuators.backlash import beyond_gap, flank_depths, pushed
from armwright.model import Elasticity
from armwright.scalar import Scalar


@dataclass(frozen=True, eq=False)
class Transmitted:
    """Torques of the spring between motor and link, all on the joint side."""

    torque: Scalar  # on the link [N m | N]
    slope: Scalar  # ∂δ/∂θ, by which the torque acts back on the motor [-]
    loss: Scalar  # [W]
    energy: Scalar  # [J] in the spring
    pushes: tuple[Scalar, ...] = ()  # of either pair of flanks [N m | N]: they let go where it is below 0


def bent(elasticity: Elasticity, ratio: Scalar, motor: Scalar, link: Scalar) -> tuple[Scalar, Scalar]:
    """δ = θ + A sin(2 n θ + phase) - q  [rad | m],  and  ∂δ/∂θ."""
    deflection, slope = motor - link, 1.0
    if elasticity.error is not None:
        amplitude, phase = elasticity.error
        angle = 2.0 * ratio * motor + phase
        deflection = deflection + amplitude * scalar.sin(angle)
        slope = 1.0 + 2.0 * ratio * amplitude * scalar.cos(angle)
    return deflection, slope


def transmitted(
    elasticity: Elasticity,
    ratio: Scalar,
    motor: Scalar,
    motor_speed: Scalar,
    link: Scalar,
    link_speed: Scalar,
    touching: tuple[Scalar, Scalar] | None = None,
) -> Transmitted:
    """Torque of the gear's spring:  k δ' + κ δ'³ + d δ̇,  δ = θ + A sin(2 n θ + phase) - q,  θ = θ_motor / n.

    δ' is δ less the play (`backlash`). The error A acts back on the motor by ∂δ/∂θ, so that no power is lost in it.

    Args:
        elasticity: of the gear.   ratio: n.
        motor, motor_speed: θ, θ̇ referred to the joint [rad | m, rad/s | m/s].   link, link_speed: q, q̇.
        touching: 1 where flanks count as touching, forward and back, of a gear with play; None: where |δ| ≥ gap/2.
    """
    deflection, slope = bent(elasticity, ratio, motor, link)
    speed = slope * motor_speed - link_speed
    pressed = deflection if elasticity.backlash is None else beyond_gap(deflection, elasticity.backlash)
    spring, energy = elasticity.stiffness * pressed, 0.5 * elasticity.stiffness * pressed * pressed
    if elasticity.cubic is not None:
        square = pressed * pressed
        spring, energy = (
            spring + elasticity.cubic * square * pressed,
            energy + 0.25 * elasticity.cubic * square * square,
        )
    torque, pushes = spring + elasticity.damping * speed, ()
    if elasticity.backlash is not None:
        depths = flank_depths(deflection, elasticity.backlash)
        pushes = (torque, -torque)
        torque = pushed(touching or (scalar.less_equal(0.0, depths[0]), scalar.less_equal(0.0, depths[1])), torque)
    return Transmitted(torque, slope, (torque - spring) * speed, energy, pushes)

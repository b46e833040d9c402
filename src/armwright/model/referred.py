"""A joint's drive, friction and limits, from the record's sides and bases to the joint side and DC-equivalents."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.description.brushless import DC_EQUIVALENT
from armwright.description.drive import LinearFriction, RotaryFriction
from armwright.description.robot import MovingJoint, RevoluteJoint
from armwright.model.model import Drive, Friction, Limits


def drive_of(joint: MovingJoint, command: Any) -> Drive:
    """Motor and gear of a joint, electrical constants as DC-equivalents."""
    motor = joint.motor
    if motor is None:
        return Drive(command)
    factor = DC_EQUIVALENT[motor.basis]
    constant = _scaled(motor.torque_constant_n_m_per_a, factor.torque_constant)
    ke = _scaled(motor.back_emf_constant_v_s_per_rad, factor.back_emf_constant)
    return Drive(
        command,
        gear_ratio=float(motor.gear_ratio),
        rotor_inertia=float(motor.rotor_inertia_kg_m2),
        efficiency=_lossy(motor.gear_efficiency),
        smoothing=_smoothing(joint),
        torque_constant=constant,
        back_emf_constant=constant if ke is None else ke,
        resistance=_scaled(motor.resistance_ohm, factor.impedance),
        inductance=_scaled(motor.inductance_h, factor.impedance),
    )


def _scaled(quantity: Any, factor: float) -> float | None:
    return None if quantity is None else float(quantity) * factor


def _lossy(efficiency: Any) -> float | None:
    """η of a gear that loses power; None for η = 1, which has no loss to smooth."""
    return None if efficiency is None or float(efficiency) == 1.0 else float(efficiency)


def _smoothing(joint: MovingJoint) -> float | None:
    """Speed of the joint over which friction and gear loss are smoothed; one on the motor side is divided by |n|."""
    if isinstance(joint.friction, LinearFriction):
        given, ratio = joint.friction.smoothing_m_per_s, 1.0
    elif isinstance(joint.friction, RotaryFriction):
        given, ratio = joint.friction.smoothing_rad_per_s, _side_ratio(joint)
    else:
        return None
    return None if given is None else float(given) / ratio


def _side_ratio(joint: MovingJoint) -> float:
    """|n| where friction is given on the motor side, else 1."""
    on_motor = joint.friction is not None and joint.friction.side == "motor"
    return abs(float(joint.motor.gear_ratio)) if on_motor and joint.motor is not None else 1.0


def friction_of(joint: MovingJoint) -> Friction | None:
    """Referred to the joint: torques by |n|, viscous by n², speeds by 1/|n|. Signs are the joint's on either side."""
    given = joint.friction
    if given is None:
        return None
    n = _side_ratio(joint)
    if isinstance(given, LinearFriction):
        viscous, plus, minus, offset = (
            given.viscous_n_s_per_m,
            given.coulomb_positive_n,
            given.coulomb_negative_n,
            given.offset_n,
        )
        stribeck, speed = given.stribeck_force_n, given.stribeck_speed_m_per_s
        sigmoid = (given.sigmoid_amplitude_n, given.sigmoid_slope_s_per_m, given.sigmoid_shift_m_per_s)
    else:
        viscous, plus, minus = given.viscous_n_m_s_per_rad, given.coulomb_positive_n_m, given.coulomb_negative_n_m
        offset, stribeck, speed = given.offset_n_m, given.stribeck_torque_n_m, given.stribeck_speed_rad_per_s
        sigmoid = (given.sigmoid_amplitude_n_m, given.sigmoid_slope_s_per_rad, given.sigmoid_shift_rad_per_s)

    def referred(quantity: Any, by: float) -> float:
        return 0.0 if quantity is None else float(quantity) * by

    a, b, c = sigmoid
    return Friction(
        viscous=referred(viscous, n * n),
        coulomb_positive=referred(plus, n),
        coulomb_negative=referred(minus, n),
        offset=referred(offset, n),
        stribeck=None if stribeck is None else referred(stribeck, n),
        stribeck_speed=1.0 if speed is None else referred(speed, 1.0 / n),
        smoothing=_smoothing(joint),
        sigmoid=(referred(a, n), referred(b, n), referred(c, 1.0 / n)) if given.law == "sigmoid" else None,
    )


def limits_of(joint: MovingJoint) -> Limits:
    """Limits of a joint, infinite where the record gives none."""
    given = joint.limits
    if isinstance(joint, RevoluteJoint):
        position, velocity, torque = joint.limits.position_rad, joint.limits.velocity_rad_per_s, joint.limits.torque_n_m
    else:
        position, velocity, torque = joint.limits.position_m, joint.limits.velocity_m_per_s, joint.limits.force_n
    factor = DC_EQUIVALENT[joint.motor.basis if joint.motor is not None else "dc"]

    def bound(quantity: Any, by: float = 1.0) -> float:
        return np.inf if quantity is None else float(quantity) * by

    low, high = (-np.inf, np.inf) if position is None else np.array(position).tolist()
    return Limits(
        position=(low, high),
        velocity=bound(velocity),
        torque=bound(torque),
        voltage=bound(given.voltage_v, factor.voltage),
        current=bound(given.current_a, factor.current),
    )

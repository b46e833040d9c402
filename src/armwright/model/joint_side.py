"""A joint's drive, friction and limits, from the record's sides and bases to the joint side and DC-equivalents."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armwright import scalar
from armwright.description.drive import DC_EQUIVALENT
from armwright.description.robot import MovingJoint
from armwright.errors import ModelError
from armwright.friction_laws import LAWS
from armwright.joint_kinds import Dimension, JointUnits
from armwright.model.drive import (
    Brake,
    Cogging,
    Drive,
    DriveLimits,
    EfficiencyTable,
    Elasticity,
    Firmware,
    Friction,
    Stops,
    Supply,
    Thermal,
)
from armwright.model.springs import LinearSpring, Spring, TableSpring
from armwright.quantity import Quantity
from armwright.scalar import Scalar

if TYPE_CHECKING:
    from armwright.description.drive_effects import GearEfficiencyTable


def drive_of(joint: MovingJoint, command: Any, turn: float | None = None) -> Drive:
    """Motor and gear of a joint, electrical constants as DC-equivalents; `turn`: [s] of the arm's fastest servo loop."""
    motor = joint.motor
    if motor is None:
        loaded = joint.friction is not None and joint.friction.load_coefficient is not None
        return Drive(command, smoothing=_smoothing(joint) if loaded else None)
    factor = DC_EQUIVALENT[motor.basis]
    constant = _scaled(motor.torque_constant_n_m_per_a, factor.torque_constant)
    ke = _scaled(motor.back_emf_constant_v_s_per_rad, factor.back_emf_constant)
    return Drive(
        command,
        gear_ratio=motor.gear_ratio.number,
        rotor_inertia=motor.rotor_inertia_kg_m2.number,
        efficiency=_lossy(motor.gear_efficiency, 1.0)
        if motor.gear_efficiency_table is None
        else _efficiency_table(motor.gear_efficiency_table),
        smoothing=_smoothing(joint),
        torque_constant=constant,
        back_emf_constant=constant if ke is None else ke,
        resistance=_scaled(motor.resistance_ohm, factor.impedance),
        inductance=_scaled(motor.inductance_h, factor.impedance),
        current_loop=_number(motor.current_loop_hz),
        coasts=motor.pwm == "coast",
        dead_zone=None if _lossy(motor.dead_zone_v, 0.0) is None else _scaled(motor.dead_zone_v, factor.voltage),
        thermal=_thermal_of(motor.thermal),
        cogging=None
        if motor.cogging is None
        else Cogging(*_numbers(motor.cogging, "amplitude_n_m", "periods", "phase_rad")),
        coupling=tuple((coupling.joint, coupling.ratio.number) for coupling in motor.coupling),
        firmware=_firmware_of(joint.firmware, turn),
    )


def _firmware_of(record: Any, turn: float | None) -> Firmware | None:
    if record is None:
        return None
    count = None if record.counts_per_turn is None else 2.0 * np.pi / record.counts_per_turn.number

    def gain(name: str, unit: str) -> Scalar | None:
        setting, scale = (_number(getattr(record, key)) for key in (name, f"{name}_scale_{unit}"))
        return None if setting is None or scale is None else setting * scale

    band, latency, period = (
        _number(record.dead_band_counts),
        _fixed(record, "latency_periods"),
        _fixed(record, "period_s"),
    )
    assert period is not None
    return Firmware(
        period=period,
        every=1 if turn is None else round(period / turn),
        count=count,
        output=record.output,
        limit=record.output_limit.number,
        proportional=gain("p", "per_rad"),
        integral=gain("i", "per_rad_s"),
        derivative=gain("d", "s_per_rad"),
        dead_band=None if band is None or count is None else band * count,
        speed=_number(record.goal_speed_rad_per_s),
        acceleration=_number(record.goal_acceleration_rad_per_s2),
        goals=None if record.goal_range_rad is None else tuple(record.goal_range_rad.numbers),
        latency=0 if latency is None else round(latency),
    )


def _fixed(record: Any, key: str) -> float | None:
    """A number of a servo's loop that decides when things happen, which is the same in all lanes."""
    number = _number(getattr(record, key))
    if scalar.is_symbolic(number):
        raise ModelError(
            "is the same in all lanes", place=f"firmware.{key}", expected="an arm of its own, by `with_values`"
        )
    return None if number is None else float(number)


def _thermal_of(record: Any) -> Thermal | None:
    if record is None:
        return None
    bodies = {
        body: _numbers(record, f"{body}_capacity_j_per_k", f"{body}_resistance_k_per_w")
        for body in ("winding", "housing")
    }
    return Thermal(
        ambient=record.ambient_c.number,
        reference=record.reference_c.number,
        winding=bodies["winding"],
        housing=None if record.housing_capacity_j_per_k is None else bodies["housing"],
        resistance_temperature_coefficient=_number(record.resistance_temperature_coefficient_per_k),
        magnet_temperature_coefficient=_number(record.magnet_temperature_coefficient_per_k),
    )


def _number(quantity: Quantity | None) -> Scalar | None:
    return None if quantity is None else quantity.number


def _numbers(record: Any, *keys: str) -> tuple[Scalar, ...]:
    return tuple(_number(getattr(record, key)) for key in keys)


def _scaled(quantity: Quantity | None, factor: float) -> Scalar | None:
    return None if quantity is None else quantity.number * factor


def _lossy(quantity: Quantity | None, lossless: float) -> Scalar | None:
    """Number of an effect; None where its value is the one without the effect, so that there is nothing to compute."""
    if quantity is None or (not scalar.is_symbolic(quantity.number) and quantity.number == lossless):
        return None
    return quantity.number


def _efficiency_table(record: GearEfficiencyTable) -> EfficiencyTable:
    speeds = tuple(_number(getattr(row, record.speed_key)) for row in record.rows) if len(record.rows) > 1 else ()
    driving = tuple(row.driving.numbers for row in record.rows)
    driven_back = tuple((row.driving if row.driven_back is None else row.driven_back).numbers for row in record.rows)
    return EfficiencyTable(getattr(record, record.torque_key).numbers, speeds, driving, driven_back)


def _smoothing(joint: MovingJoint) -> Scalar | None:
    """Speed of the joint over which friction and gear loss are smoothed, None if absent; the motor's is divided by |n|."""
    record = joint.friction
    speed = None if record is None else getattr(record, record.units.key("smoothing", "speed"))
    return None if speed is None else speed.number / _side_ratio(joint, record)


def _side_ratio(joint: MovingJoint, record: Any) -> Scalar:
    """|n| where friction or a brake is given on the motor side, else 1."""
    on_motor = record is not None and record.side == "motor"
    return abs(joint.motor.gear_ratio.number) if on_motor and joint.motor is not None else 1.0


def friction_of(joint: MovingJoint) -> Friction | None:
    """Referred to the joint: torques by |n|, viscous by n², speeds by 1/|n|. Signs are the joint's on either side."""
    record, n = joint.friction, _side_ratio(joint, joint.friction)
    if record is None:
        return None
    factors = {"torque": n, "speed": 1.0 / n, "slope": n, "stiffness": n * n, "damping": n * n, "number": 1.0}
    factors["per torque"] = 1.0 / n

    def on_joint_side(stem: str, dimension: Dimension, absent: Any = 0.0) -> Scalar:
        quantity = getattr(record, record.units.key(stem, dimension))
        return absent if quantity is None else quantity.number * factors[dimension]

    return Friction(
        viscous=on_joint_side("viscous", "damping"),
        coulomb_positive=on_joint_side("coulomb_positive", "torque"),
        coulomb_negative=on_joint_side("coulomb_negative", "torque"),
        offset=on_joint_side("offset", "torque"),
        stribeck=on_joint_side("stribeck_torque", "torque", absent=None),
        stribeck_speed=on_joint_side("stribeck_speed", "speed", absent=1.0),
        smoothing=_smoothing(joint),
        law=record.law,
        parameters=tuple(on_joint_side(key.stem, key.dimension) for key in LAWS[record.law].own),
        on_motor=record.side == "motor",
        load_coefficient=_lossy(record.load_coefficient, 0.0),
        viscous_fall=_number(record.viscous_fall_k),
        viscous_temperature_coefficient=_number(record.viscous_temperature_coefficient_per_k),
        coulomb_temperature_coefficient=_number(record.coulomb_temperature_coefficient_per_k),
    )


def elasticity_of(joint: MovingJoint) -> Elasticity | None:
    """The gear's elasticity, which the record gives at the joint."""
    record, key = joint.elasticity, joint.kind.units.key
    if record is None:
        return None
    stiffness, damping = _numbers(record, *_spring_keys(joint.kind.units))
    cubic, gap, error, phase = _numbers(
        record, key("cubic", "cubic"), key("backlash", "position"), key("error", "position"), "error_phase_rad"
    )
    return Elasticity(stiffness, damping, cubic, gap, None if error is None else (error, phase))


def _spring_keys(units: JointUnits) -> tuple[str, str]:
    """Keys of a stiffness and of a damping."""
    return units.key("stiffness", "stiffness"), units.key("damping", "damping")


def stops_of(joint: MovingJoint) -> Stops | None:
    """End stops of a joint."""
    return None if joint.stops is None else Stops(*_numbers(joint.stops, *_spring_keys(joint.kind.units)))


def brake_of(joint: MovingJoint) -> Brake | None:
    """The holding brake referred to the joint: torques by |n|, stiffness and damping by n²."""
    record = joint.brake
    if record is None:
        return None
    on_motor, n = record.side == "motor", _side_ratio(joint, record)
    keys = (record.units.key("holding_torque", "torque"), *_spring_keys(record.units))
    if getattr(record, keys[1]) is None:
        return Brake(getattr(record, keys[0]).number * n, None, None, None, on_motor)
    holding, stiffness, damping, release_time = _numbers(record, *keys, "release_time_s")
    return Brake(holding * n, stiffness * n * n, damping * n * n, release_time, on_motor)


def spring_of(joint: MovingJoint) -> Spring | None:
    """The spring at a joint."""
    record, key = joint.spring, joint.kind.units.key
    if record is None:
        return None
    if record.outside is None:
        keys = (key("stiffness", "stiffness"), key("rest", "position"), key("preload", "torque"))
        stiffness, rest, preload = _numbers(record, *keys)
        return LinearSpring(stiffness, rest, 0.0 if preload is None else preload)
    positions, torques = getattr(record, key("positions", "position")), getattr(record, key("torques", "torque"))
    return TableSpring(positions.numbers, torques.numbers, record.outside)


def supply_of(record: Any) -> Supply | None:
    """The supply that all drives share."""
    if record is None:
        return None
    chopper = _numbers(record, "chopper_voltage_v", "chopper_band_v", "chopper_resistance_ohm")
    plain = _numbers(record, "voltage_v", "source_resistance_ohm", "capacitance_f")
    return Supply(plain[0], plain[1], plain[2], None if chopper[0] is None else (chopper[0], chopper[1], chopper[2]))


def limits_of(joint: MovingJoint) -> DriveLimits:
    """Limits of a joint, infinite where the record gives none."""
    factor = DC_EQUIVALENT[joint.motor.basis if joint.motor is not None else "dc"]

    def bound(quantity: Quantity | None, by: float = 1.0) -> Scalar:
        return np.inf if quantity is None else quantity.number * by

    position = joint.limit("position")
    low, high = (-np.inf, np.inf) if position is None else position.numbers
    return DriveLimits(
        position=(low, high),
        velocity=bound(joint.limit("velocity")),
        acceleration=bound(joint.limit("acceleration")),
        torque=bound(joint.limit("torque")),
        voltage=bound(joint.limits.voltage_v, factor.voltage),
        current=bound(joint.limits.current_a, factor.current),
    )

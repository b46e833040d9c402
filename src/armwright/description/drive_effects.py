"""Which effects of a joint's drive go together: what one record cannot see of another is checked for the whole robot."""

from __future__ import annotations

from typing import Any

from armwright.errors import nearest


def check_drive_effects(robot: Any) -> None:
    """Refuses effects that lack what they rest on.

    Args:
        robot: a RobotDescription.
    Raises:
        ValueError: names the joint, the key and what it needs.
    """
    moving = [joint for joint in robot.joints if joint.type != "fixed"]
    free = [joint.name for joint in moving if joint.mimic is None]
    for joint in moving:
        try:
            _check_joint(robot, joint)
            _check_coupling(joint, free)
        except ValueError as error:
            raise ValueError(f"joint {joint.name!r}: {error}") from None


def _check_joint(robot: Any, joint: Any) -> None:
    motor, friction, command = joint.motor, joint.friction, joint.command or robot.command
    limit = "position_rad" if joint.type == "revolute" else "position_m"
    if joint.stops is not None and getattr(joint.limits, limit) is None:
        raise ValueError(f"stops need limits.{limit}, where they stand")
    if joint.elasticity is not None and (motor is None or float(motor.rotor_inertia_kg_m2) == 0):
        raise ValueError("elasticity needs motor.rotor_inertia_kg_m2 above 0: the mass before the spring")
    if joint.brake is not None and joint.brake.side == "motor" and motor is None:
        raise ValueError('brake.side = "motor" needs a [joints.motor] with its gear_ratio')
    if joint.type == "prismatic" and joint.brake is not None:
        _check_side(joint.brake)
    if friction is not None and friction.viscous_fall_k is not None and (motor is None or motor.thermal is None):
        raise ValueError("friction.viscous_fall_k needs motor.thermal, which knows the temperature")
    if motor is None:
        return
    if robot.supply is not None and motor.basis != "dc":
        raise ValueError(
            f"[supply] goes with motor constants of basis = 'dc', not {motor.basis!r}: the bus clips DC-equivalent volts"
        )
    if motor.current_loop_hz is not None and command == "voltage":
        raise ValueError(
            'motor.current_loop_hz goes with command = "current" or "torque": a voltage needs no current loop'
        )
    if motor.pwm == "coast":
        if command != "voltage":
            raise ValueError(f'motor.pwm = "coast" goes with command = "voltage", not {command!r}')
        if robot.supply is None and joint.limits.voltage_v is None:
            raise ValueError('motor.pwm = "coast" needs limits.voltage_v or [supply], the voltage that is switched')


def _check_side(brake: Any) -> None:
    from armwright.description.compliance import RotaryBrake

    if isinstance(brake, RotaryBrake) and brake.side != "motor":
        raise ValueError('a brake of a prismatic joint in N m is its motor\'s: expected side = "motor", or keys in N')


def _check_coupling(joint: Any, names: list[str]) -> None:
    if joint.motor is None:
        return
    others = [coupling.joint for coupling in joint.motor.coupling]
    for other in others:
        if other not in names:
            raise ValueError(
                f"motor.coupling joint = {other!r} does not move by itself or is not there; {nearest(other, names)}"
            )
        if other == joint.name:
            raise ValueError("motor.coupling names the joint itself, whose share is gear_ratio")
        if others.count(other) > 1:
            raise ValueError(f"motor.coupling names {other!r} twice")

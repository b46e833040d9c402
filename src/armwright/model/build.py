"""RobotDescription → Model: every joint convention becomes a fixed placement and a motion along or about z.

Classic DH puts the link's frame behind the joint:   T = Rz(θ) Tz(r) Tx(a) Rx(α).
Modified DH puts it on the joint:                    T = Rx(α) Tx(a) Rz(θ) Tz(r).
Explicit frames (URDF) put it on the joint, about any axis.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.description.brushless import DC_EQUIVALENT
from armwright.description.drive import LinearFriction, Motor, RotaryFriction
from armwright.description.robot import FixedJoint, Link, MovingJoint, PrismaticJoint, RevoluteJoint, RobotDescription
from armwright.errors import DescriptionError
from armwright.model.model import BASE, Body, Drive, Frame, Friction, Limits, Model
from armwright.spatial import (
    Placement,
    parallel_axes,
    pseudo_inertia,
    rotation_rpy,
    rotation_to_axis,
    rotation_x,
    rotation_z,
)

STANDARD_GRAVITY = (0.0, 0.0, -9.80665)  # [m/s²], where a file says nothing about its place; CGPM 1901
IMPOSSIBLE = 1e-9  # an eigenvalue of the pseudo-inertia below minus this share of the largest is no rounding
SELF_LOCKING = 0.5  # a gear below this efficiency cannot be driven back


def build_model(robot: RobotDescription, *, on_impossible: str = "error") -> Model:
    """The numeric tree of a description.

    Args:
        robot: the description.
        on_impossible: what an impossible inertia does: "error" (default) or "warn".
    Returns:
        model: fixed links merged into the bodies that carry them, joints in the order of the file.
    Raises:
        DescriptionError: a link whose mass properties no real body can have.
    """
    if on_impossible not in ("error", "warn"):
        raise DescriptionError(f'on_impossible = {on_impossible!r}: expected "error" or "warn"')
    warnings = _check_bodies(robot, on_impossible) + _check_gears(robot)
    frames: dict[str, Frame] = {robot.base: Frame(BASE, Placement.identity())}
    moving: list[dict[str, Any]] = []
    for joint in _parents_first(robot):
        carrier = frames[joint.parent]
        before, after = _joint_placement(joint)
        if isinstance(joint, FixedJoint):
            frames[joint.child] = Frame(carrier.body, carrier.placement @ before @ after)
        else:
            moving.append(_body(robot, joint, carrier.body, carrier.placement @ before, after))
            frames[joint.child] = Frame(len(moving) - 1, after)
    for link in robot.links:
        _add_mass(moving, frames[link.name], link)
    for frame in robot.frames:
        placed = Placement(rotation_rpy(*frame.rpy_rad.value), np.array(frame.xyz_m))
        frames[frame.name] = Frame(frames[frame.link].body, frames[frame.link].placement @ placed)
    bodies = tuple(Body(**_merged(body)) for body in moving)
    if not bodies:
        raise DescriptionError(f"{robot.name}: expected at least one joint that moves")
    gravity = np.array(robot.gravity_m_s2.value if robot.gravity_m_s2 is not None else STANDARD_GRAVITY)
    tip = robot.tip if robot.tip is not None else _end_of_chain(robot)
    return Model(robot.name, bodies, gravity, frames, tip, robot, tuple(warnings))


def _parents_first(robot: RobotDescription) -> list[Any]:
    """Joints in the file's order, a child's that stands before its parent's moved behind it."""
    placed, waiting, order = {robot.base}, list(robot.joints), []
    while waiting:
        joint = next(joint for joint in waiting if joint.parent in placed)
        waiting.remove(joint)
        placed.add(joint.child)
        order.append(joint)
    return order


def _end_of_chain(robot: RobotDescription) -> str | None:
    """The last link, where there is just one."""
    parents = {joint.parent for joint in robot.joints}
    ends = [link.name for link in robot.links if link.name not in parents]
    return ends[0] if len(ends) == 1 else None


def _screw_x(alpha: Any, a: Any) -> Placement:
    return Placement(rotation_x(float(alpha)), np.array([float(a), 0.0, 0.0]))


def _screw_z(theta: Any, r: Any) -> Placement:
    return Placement(rotation_z(float(theta)), np.array([0.0, 0.0, float(r)]))


def _joint_placement(joint: Any) -> tuple[Placement, Placement]:
    """Where the joint's axis frame stands in the parent link, and where the child link's frame stands in that."""
    if joint.frame is not None:
        placed = Placement(rotation_rpy(*joint.frame.rpy_rad.value), np.array(joint.frame.xyz_m))
        if isinstance(joint, FixedJoint):
            return placed, Placement.identity()
        axis = np.array(joint.axis)
        turn = Placement(rotation_to_axis(axis / np.linalg.norm(axis)), np.zeros(3))
        return placed @ turn, turn.inverse()
    row = joint.dh if joint.dh is not None else joint.modified_dh
    along_x = _screw_x(row.alpha_rad, row.a_m)
    if isinstance(
        joint, RevoluteJoint
    ):  # what of the motion along z is constant: the offset before, r behind the motion
        before, behind = _screw_z(row.offset_rad, 0.0), _screw_z(0.0, row.r_m)
    elif isinstance(joint, PrismaticJoint):
        before, behind = _screw_z(row.theta_rad, row.offset_m), Placement.identity()
    else:
        before, behind = _screw_z(row.theta_rad, row.r_m), Placement.identity()
    if joint.dh is not None:
        return before, behind @ along_x
    return along_x @ before @ behind, Placement.identity()  # r and θ share the z axis and commute


def _body(
    robot: RobotDescription, joint: MovingJoint, parent: int, placement: Placement, after: Placement
) -> dict[str, Any]:
    return {
        "joint": joint.name,
        "link": joint.child,
        "kind": joint.type,
        "parent": parent,
        "placement": placement,
        "link_frame": after,
        "masses": [],
        "drive": _drive(joint, joint.command or robot.command),
        "friction": _friction(joint),
        "limits": _limits(joint),
    }


def _add_mass(moving: list[dict[str, Any]], frame: Frame, link: Link) -> None:
    if frame.body == BASE:
        return  # stands still
    rotation = frame.placement.rotation
    com = frame.placement.point(np.array(link.com_m))
    moving[frame.body]["masses"].append((float(link.mass_kg), com, rotation @ link.inertia_kg_m2.matrix() @ rotation.T))


def _merged(body: dict[str, Any]) -> dict[str, Any]:
    """The masses that move together as one body: parallel axes."""
    masses = body.pop("masses")
    mass = sum(m for m, _, _ in masses)
    com = sum((m * c for m, c, _ in masses), np.zeros(3)) / mass if mass > 0 else np.zeros(3)
    if len(masses) == 1:
        com = masses[0][1]
    inertia = sum((j + parallel_axes(m, c - com) for m, c, j in masses), np.zeros((3, 3)))
    return {**body, "mass": mass, "com": com, "inertia": 0.5 * (inertia + inertia.T)}


def _drive(joint: MovingJoint, command: Any) -> Drive:
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
        efficiency=None if motor.gear_efficiency is None else float(motor.gear_efficiency),
        smoothing=_smoothing(joint),
        torque_constant=constant,
        back_emf_constant=constant if ke is None else ke,
        resistance=_scaled(motor.resistance_ohm, factor.impedance),
        inductance=_scaled(motor.inductance_h, factor.impedance),
    )


def _scaled(quantity: Any, factor: float) -> float | None:
    return None if quantity is None else float(quantity) * factor


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


def _friction(joint: MovingJoint) -> Friction | None:
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


def _limits(joint: MovingJoint) -> Limits:
    given = joint.limits
    if isinstance(joint, RevoluteJoint):
        position, velocity, torque = joint.limits.position_rad, joint.limits.velocity_rad_per_s, joint.limits.torque_n_m
    else:
        position, velocity, torque = joint.limits.position_m, joint.limits.velocity_m_per_s, joint.limits.force_n
    factor = DC_EQUIVALENT[joint.motor.basis if joint.motor is not None else "dc"]

    def bound(quantity: Any, by: float = 1.0) -> float:
        return np.inf if quantity is None else float(quantity) * by

    low, high = (-np.inf, np.inf) if position is None else position.value
    return Limits(
        position=(low, high),
        velocity=bound(velocity),
        torque=bound(torque),
        voltage=bound(given.voltage_v, factor.voltage),
        current=bound(given.current_a, factor.current),
    )


def _check_bodies(robot: RobotDescription, on_impossible: str) -> list[str]:
    """Refuses links that no real body can be; what was accepted comes back as warnings."""
    warnings = []
    for link in robot.links:
        body = pseudo_inertia(float(link.mass_kg), np.array(link.com_m), link.inertia_kg_m2.matrix())
        eigenvalues = np.linalg.eigvalsh(body.astype(float))
        if eigenvalues[0] >= -IMPOSSIBLE * max(eigenvalues[-1], 0.0) and eigenvalues[-1] >= 0:
            continue
        fault = (
            f"link {link.name!r} has an impossible inertia: its pseudo-inertia has the eigenvalue {eigenvalues[0]:.4g}, "
            f"{-eigenvalues[0] / max(abs(eigenvalues[-1]), 1e-300):.2g} of the largest below 0"
        )
        if link.accept_impossible is not None:
            warnings.append(f"{fault}; accepted: {link.accept_impossible}")
        elif on_impossible == "warn":
            warnings.append(fault)
        else:
            raise DescriptionError(
                f'{robot.name}: {fault}; expected a real body, or accept_impossible = "reason" in the link, or on_impossible="warn"'
            )
    return warnings


def _check_gears(robot: RobotDescription) -> list[str]:
    warnings = []
    for joint in robot.joints:
        motor: Motor | None = getattr(joint, "motor", None)
        if motor is None:
            continue
        if motor.gear_efficiency is not None and float(motor.gear_efficiency) < SELF_LOCKING:
            warnings.append(
                f"joint {joint.name!r}: gear efficiency {float(motor.gear_efficiency):g} is below {SELF_LOCKING}, self-locking"
            )
        drive = _drive(joint, "torque")
        kt, ke = drive.torque_constant, drive.back_emf_constant
        if kt is not None and ke is not None and not 0.9 < kt / ke < 1.1:
            warnings.append(
                f"joint {joint.name!r}: torque constant {kt:.4g} N m/A and back-EMF constant {ke:.4g} V s/rad differ as "
                f"DC-equivalents, where they should be equal; check basis = {motor.basis!r}"
            )
    return warnings

"""Joints in the form of URDF and MJCF: every link's frame on its joint, plain limits, damping and dry friction.

Classic Denavit-Hartenberg parameters put a link's frame elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.description.robot import FixedJoint, Joint, Link, MovingJoint, RobotDescription
from armwright.errors import ModelError
from armwright.model.build import joint_placement
from armwright.model.joint_side import friction_of
from armwright.model.variants.edits import tip_of
from armwright.quantity import Quantity
from armwright.spatial import Frozen, Placement, roll_pitch_yaw, rotation_rpy, snap

Limit = Quantity | None
Z = (0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class ExportedJoint(Frozen):
    """A joint and the link it moves: the link's frame is the joint's, displaced by q about or along `axis`."""

    joint: Joint
    link: Link
    frame: Placement  # of the joint, in the parent link's frame here
    angles: tuple[float, ...]  # roll, pitch, yaw [rad] of the same, as the record has them where it does
    axis: tuple[float, ...]  # in that frame
    shift: Placement  # of the record's link frame, in the link's frame here
    com: np.ndarray  # (3,) [m], in the link's frame here
    tensor: np.ndarray  # (3, 3) [kg m²] about the centre of mass, in its axes


def joint_frames(robot: RobotDescription) -> list[ExportedJoint]:
    """All joints, parents first."""
    shifts = {robot.base: Placement.identity()}
    links = {link.name: link for link in robot.links}
    waiting, frames = list(robot.joints), []
    while waiting:
        joint = next(joint for joint in waiting if joint.parent in shifts)
        waiting.remove(joint)
        before, after = joint_placement(joint)
        axis = Z
        if isinstance(joint, FixedJoint):
            before, after = before @ after, Placement.identity()
        elif joint.frame is not None:  # the axis as the file has it, not the frame that was turned onto it
            before, after, axis = before @ after, Placement.identity(), _unit(np.array(joint.axis))
        link = links[joint.child]
        frame = shifts[joint.parent] @ before
        shifts[joint.child] = after
        angles: tuple[float, ...] = roll_pitch_yaw(frame.rotation)
        if joint.frame is not None and is_identity(shifts[joint.parent]):  # the file's own digits
            angles = tuple(np.array(joint.frame.rpy_rad).tolist())
            frame = Placement(frame.rotation, np.array(joint.frame.xyz_m))
        com, tensor = np.array(link.com_m), link.inertia_kg_m2.matrix()
        if not is_identity(after):
            com = after.point(com)
            tensor = after.rotation @ tensor @ after.rotation.T
        frames.append(ExportedJoint(joint, link, frame, angles, axis, after, com, 0.5 * (tensor + tensor.T)))
    return frames


def numbers_text(numbers: Any) -> str:
    """Numbers as attributes of XML have them, to the bit."""
    return " ".join(repr(float(number)) for number in numbers)


def named_in(types: Mapping[str, str], joint: Joint, file: str) -> str:
    """Name of the joint's kind in another format.

    Args:
        types: its word for every kind that it has.   file: the format, such as "a URDF".
    Raises:
        ModelError: it has no such joint.
    """
    if joint.type not in types:
        what = f"{file} has no {joint.type} joint"
        raise ModelError(what, place=f"joint {joint.name!r} type", value=joint.type, choices=types)
    return types[joint.type]


def moved_tip(robot: RobotDescription, frames: list[ExportedJoint]) -> str | None:
    """The name of the tip's frame if the tip is a link whose frame was moved onto its joint."""
    tip = tip_of(robot)
    shifts = {entry.link.name: entry.shift for entry in frames}
    if tip not in shifts or is_identity(shifts[tip]):
        return None
    names = {*shifts, robot.base, *(frame.name for frame in robot.frames)}
    name = f"{tip}_tip"
    while name in names:
        name += "_"
    return name


def place_of(robot: RobotDescription, frames: list[ExportedJoint], name: str) -> tuple[str, Placement]:
    """The link that carries a named frame or link, and the frame's pose in that link."""
    shifts = {entry.link.name: entry.shift for entry in frames} | {robot.base: Placement.identity()}
    for frame in robot.frames:
        if frame.name == name:
            place = Placement(rotation_rpy(*np.array(frame.rpy_rad)), np.array(frame.xyz_m))
            return frame.link, shifts[frame.link] @ place
    return name, shifts[name]


def is_identity(placement: Placement) -> bool:
    """True if two frames are equal, to the bit."""
    return bool((placement.rotation == np.eye(3)).all() and not placement.position.any())


def _unit(axis: np.ndarray) -> tuple[float, ...]:
    """The direction at length 1, in the digits it was given in where it has that length already."""
    scaled = axis / np.abs(axis).max()  # the squares of 1e300 overflow
    length = math.hypot(*axis)
    return tuple((axis if abs(length - 1.0) < 1e-15 else snap(scaled / np.linalg.norm(scaled))).tolist())


def plain_limits(joint: MovingJoint) -> tuple[Limit, Limit, Limit]:
    """(position [rad | m], velocity [rad/s | m/s], effort [N m | N]); None for an unknown limit."""
    return joint.limit("position"), joint.limit("velocity"), joint.limit("torque")


def plain_friction(joint: MovingJoint) -> tuple[float, float]:
    """(viscous, dry) friction of a joint, reduced to damping and one magnitude, with the motor's referred to the joint."""
    friction = friction_of(joint)
    if friction is None or is_of_coupled_motor(joint):
        return 0.0, 0.0
    return float(friction.viscous), float(0.5 * (friction.coulomb_positive + friction.coulomb_negative))


def is_of_coupled_motor(joint: MovingJoint) -> bool:
    """True if friction acts on a motor that turns several joints."""
    on_motor = joint.friction is not None and joint.friction.side == "motor"
    return on_motor and joint.motor is not None and bool(joint.motor.coupling)

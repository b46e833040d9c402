"""An arm with some joints locked."""

from __future__ import annotations

from collections.abc import Container, Mapping
from math import isfinite
from typing import Any

import numpy as np

from armwright.description.robot import FixedDH, FixedJoint, Joint, JointFrame, MovingJoint, RobotDescription
from armwright.errors import DescriptionError
from armwright.model.variants.edits import check_name, checked, chosen, moving_cylinders, replaced
from armwright.quantity import Quantity
from armwright.spatial import roll_pitch_yaw, rotation_rpy


def with_locked(robot: RobotDescription, positions: Mapping[str, Any]) -> RobotDescription:
    """The description with locked joints: fixed joints of the same names, so that q has the others only.

    The dynamics are those of the full arm with q_k constant: rows and columns of held joints leave M(q), C(q, q̇) q̇ and g(q).
    A held joint's motor, friction, limits, springs, stops and brake go with it, cylinders whose ends no longer move, and its
    share in the motors of others; joints that mimic it are held where it puts them.

    Args:
        robot: the description.   positions: by the names of joints, where each is held [rad | m].
    Raises:
        DescriptionError: no such joint, one that does not move or that mimics another, a position that is no finite number,
            all joints held, or a joint whose motor another joint turns as well.
    """
    moving = [joint.name for joint in robot.moving_joints]
    masters = {joint.name: joint.mimic for joint in robot.moving_joints if joint.mimic is not None}
    for name, position in positions.items():
        check_name(robot, "with_locked: joint", name, moving)
        place = f"with_locked: joint {name!r}"
        number = isinstance(position, (int, float, np.integer, np.floating)) and not isinstance(position, bool)
        if not number or not isfinite(position):
            raise DescriptionError(place=place, value=position, expected="a finite number [rad | m]", file=robot.name)
        if name in masters:
            expected = "that one locked, which locks both"
            what = f"the joint mimics {masters[name].joint!r}"
            raise DescriptionError(what, place=place, expected=expected, file=robot.name)
    all_positions = _with_followers(positions, masters)
    if moving and all(name in all_positions for name in moving):
        raise DescriptionError("all joints are locked", place="with_locked", expected="one that moves", file=robot.name)
    joints = tuple(_locked(robot, joint, all_positions) for joint in robot.joints)
    cylinders = moving_cylinders(robot, joints, robot.base, all_positions)
    return replaced(robot, "with_locked", joints=joints, cylinders=cylinders)


def _with_followers(positions: Mapping[str, Any], masters: Mapping[str, Any]) -> dict[str, float]:
    """The positions, and those of the joints that mimic locked ones."""
    locked = {name: float(position) for name, position in positions.items()}
    for _ in masters:  # as long as the longest chain can be
        for name, mimic in masters.items():
            if mimic.joint in locked:
                locked[name] = float(mimic.multiplier) * locked[mimic.joint] + float(mimic.offset)
    return locked


def _locked(robot: RobotDescription, joint: Joint, positions: Mapping[str, float]) -> Joint:
    """The joint: fixed if it is locked, otherwise without locked joints that turn its motor."""
    if not isinstance(joint, MovingJoint) or joint.name not in positions:
        return uncoupled(joint, positions)
    q, place = positions[joint.name], f"with_locked: joint {joint.name!r}"
    others = [] if joint.motor is None else [c.joint for c in joint.motor.coupling if c.joint not in positions]
    if others:
        raise DescriptionError(
            f"{others[0]!r} turns its motor too",
            place=place,
            expected=f"{others[0]!r} locked too, or none of the two",
            file=robot.name,
        )
    names = {key: getattr(joint, key) for key in ("source", "name", "parent", "child")}
    key = next(key for key in ("frame", "dh", "modified_dh") if getattr(joint, key) is not None)
    placed = _moved_frame(joint, q) if key == "frame" else _moved_row(joint, getattr(joint, key), q, place)
    return checked(FixedJoint, place, type="fixed", **names, **{key: placed})


def _moved_row(joint: MovingJoint, row: Any, q: float, place: str) -> FixedDH:
    """A Denavit-Hartenberg row at q: θ turned, r moved by the joint's motion."""
    kind = joint.kind
    angle, way = kind.motion(q)
    theta = _moved(row.offset_rad if kind.turns else row.theta_rad, angle)
    r = _moved(row.r_m if kind.turns else row.offset_m, way)
    return checked(FixedDH, place, source=row.source, alpha_rad=row.alpha_rad, a_m=row.a_m, theta_rad=theta, r_m=r)


def _moved(offset: Quantity, q: float) -> Quantity:
    """The offset's own digits and source where the joint is held at 0."""
    return offset if q == 0.0 else chosen(float(offset) + q)


def _moved_frame(joint: MovingJoint, q: float) -> JointFrame:
    """The frame turned about the joint's axis, or moved along it."""
    frame, kind = joint.frame, joint.kind
    assert frame is not None
    if q == 0.0:
        return frame
    rotation, moved = rotation_rpy(*np.array(frame.rpy_rad)), kind.placement(np.array(joint.axis), q)
    origin, angles = frame.xyz_m, frame.rpy_rad  # the file's own digits of what does not move
    if kind.slides:
        origin = chosen(*(np.array(origin) + rotation @ moved.position))
    if kind.turns:
        angles = chosen(*roll_pitch_yaw(rotation @ moved.rotation))
    return checked(JointFrame, joint.name, source=frame.source, xyz_m=origin, rpy_rad=angles)


def uncoupled(joint: Joint, names: Container[str]) -> Joint:
    """The joint, its motor no longer turned by the joints of those names."""
    motor = joint.motor if isinstance(joint, MovingJoint) else None
    if motor is None or not any(coupling.joint in names for coupling in motor.coupling):
        return joint
    left = tuple(coupling for coupling in motor.coupling if coupling.joint not in names)
    return joint.replace(motor=motor.replace(coupling=left))

"""RobotDescription → Tree: every joint convention becomes a fixed placement and a motion along or about z.

Classic DH puts the link's frame behind the joint:   T = Rz(θ) Tz(r) Tx(a) Rx(α).
Modified DH puts it on the joint:                    T = Rx(α) Tx(a) Rz(θ) Tz(r).
Explicit frames (URDF) put it on the joint, about any axis.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright import scalar
from armwright.description.robot import Link, MovingJoint, RobotDescription
from armwright.errors import DescriptionError, Problem
from armwright.model.joint_side import (
    brake_of,
    drive_of,
    elasticity_of,
    friction_of,
    limits_of,
    spring_of,
    stops_of,
    supply_of,
)
from armwright.model.mimics import Mimics
from armwright.model.springs import SpringCylinder
from armwright.model.tree import BASE, Body, Frame, Tree
from armwright.quantity import Quantity
from armwright.scalar import Array, Scalar
from armwright.spatial import Placement, inertia_about_origin, rotation_rpy, rotation_to_axis, rotation_x, rotation_z

STANDARD_GRAVITY = (0.0, 0.0, -9.80665)  # [m/s²], where a file says nothing about its place; CGPM 1901


def places_of_joints(robot: RobotDescription, model: Tree) -> dict[str, list[Any]]:
    """For every link that moves, the joints it hangs on and bears: (3,) [m] in the link's frame."""
    places: dict[str, list[Any]] = {link.name: [] for link in robot.links if model.frames[link.name].body != BASE}
    for joint in robot.joints:
        before, after = joint_placement(joint)
        if joint.parent in places:
            places[joint.parent].append(before.position)
        if joint.child in places:
            places[joint.child].append((after if joint.kind.moves else before @ after).inverse().position)
    return places


def massless(model: Tree) -> list[Problem]:
    """Warning about joints that move no mass: their acceleration has no solution."""
    carried = [
        float(body.mass) + float(np.trace(body.inertia)) + abs(float(body.drive.reflected)) for body in model.bodies
    ]
    for i, body in model.inward():
        if body.parent != BASE:
            carried[body.parent] += carried[i]
    if model.mimics is not None:
        carried = list(model.mimics.moved(carried))
    names = [name for name, moved in zip(model.names, carried, strict=True) if moved == 0.0]
    if not names:
        return []
    place, verb = ("joint", "moves") if len(names) == 1 else ("joints", "move")
    return [Problem(f"{verb} no mass: forward dynamics cannot be computed", f"{place} {', '.join(map(repr, names))}")]


def tree_of(robot: RobotDescription) -> Tree:
    """The numeric tree of a description whose values are numbers or symbols, unchecked.

    Raises:
        DescriptionError: no joint moves.
    """
    frames: dict[str, Frame] = {robot.base: Frame(BASE, Placement.identity())}
    moving: list[dict[str, Any]] = []
    for joint in _parents_first(robot):
        carrier = frames[joint.parent]
        before, after = joint_placement(joint)
        if not joint.kind.moves:
            frames[joint.child] = Frame(carrier.body, carrier.placement @ before @ after)
        else:
            moving.append(_body(robot, joint, carrier.body, carrier.placement @ before, after))
            frames[joint.child] = Frame(len(moving) - 1, after)
    for link in robot.links:
        _add_mass(moving, frames[link.name], link)
    for frame in robot.frames:
        placed = Placement(rotation_rpy(*vector(frame.rpy_rad)), vector(frame.xyz_m))
        frames[frame.name] = Frame(frames[frame.link].body, frames[frame.link].placement @ placed)
    bodies = tuple(Body(**_merged(body)) for body in moving)
    if not bodies:
        raise DescriptionError(place=robot.name, expected="at least one joint that moves")
    gravity = scalar.array(STANDARD_GRAVITY) if robot.gravity_m_s2 is None else vector(robot.gravity_m_s2)
    tip = robot.end_of_chain if robot.tip is None else robot.tip
    followers = {joint.name: joint.mimic for joint in robot.moving_joints if joint.mimic is not None}
    mimics = Mimics.of([body.joint for body in bodies], followers)
    cylinders = tuple(_cylinder(frames, cylinder) for cylinder in robot.cylinders)
    bare = tuple(link.name for link in robot.links if link.name in robot.without_masses and _is_bare(link))
    return Tree(robot.name, bodies, gravity, frames, tip, supply_of(robot.supply), mimics, cylinders, bare)


def _is_bare(link: Any) -> bool:
    """True of a link whose mass is still the 0 that stands for an unknown one; one to vary is given."""
    return not scalar.is_symbolic(link.mass_kg.number) and link.mass_kg.number == 0.0


def _cylinder(frames: dict[str, Frame], record: Any) -> SpringCylinder:
    a, b = frames[record.link_a], frames[record.link_b]
    ends = scalar.stack([a.placement.point(vector(record.anchor_a_m)), b.placement.point(vector(record.anchor_b_m))])
    numbers = (getattr(record, key).number for key in ("force_n", "length_m", "stiffness_n_per_m"))
    return SpringCylinder(record.name, (a.body, b.body), ends, *numbers)


def _parents_first(robot: RobotDescription) -> list[Any]:
    """Joints in the file's order, but with every parent before its children."""
    placed, waiting, order = {robot.base}, list(robot.joints), []
    while waiting:
        joint = next(joint for joint in waiting if joint.parent in placed)
        waiting.remove(joint)
        placed.add(joint.child)
        order.append(joint)
    return order


def vector(quantity: Quantity) -> Array:
    """The numbers or symbols of a quantity that has several."""
    return scalar.array(quantity.numbers)


def _screw_x(alpha: Scalar, a: Scalar) -> Placement:
    return Placement(rotation_x(alpha), scalar.array([a, 0.0, 0.0]))


def _screw_z(theta: Scalar, r: Scalar) -> Placement:
    return Placement(rotation_z(theta), scalar.array([0.0, 0.0, r]))


def joint_placement(joint: Any) -> tuple[Placement, Placement]:
    """Placements of the joint's axis frame in the parent link and of the child link's frame in the axis frame."""
    if joint.frame is not None:
        placed = Placement(rotation_rpy(*vector(joint.frame.rpy_rad)), vector(joint.frame.xyz_m))
        if not joint.kind.moves:
            return placed, Placement.identity()
        turn = Placement(rotation_to_axis(vector(joint.axis)), scalar.zeros(3))
        return placed @ turn, turn.inverse()
    row = joint.dh if joint.dh is not None else joint.modified_dh
    along_x = _screw_x(row.alpha_rad.number, row.a_m.number)
    if joint.kind.turns:  # what is constant along z: the offset before the motion, r behind it
        before, behind = _screw_z(row.offset_rad.number, 0.0), _screw_z(0.0, row.r_m.number)
    elif joint.kind.slides:
        before, behind = _screw_z(row.theta_rad.number, row.offset_m.number), Placement.identity()
    else:
        before, behind = _screw_z(row.theta_rad.number, row.r_m.number), Placement.identity()
    if joint.dh is not None:
        return before, behind @ along_x
    return along_x @ before @ behind, Placement.identity()  # r and θ share the z axis and commute


def _body(
    robot: RobotDescription, joint: MovingJoint, parent: int, placement: Placement, after: Placement
) -> dict[str, Any]:
    turns = [each.firmware.period_s.number for each in robot.moving_joints if each.firmware is not None]
    turn = None if any(map(scalar.is_symbolic, turns)) else min(turns, default=None)
    return {
        "joint": joint.name,
        "link": joint.child,
        "kind": joint.kind,
        "parent": parent,
        "placement": placement,
        "link_frame": after,
        "masses": [],
        "drive": drive_of(joint, "torque" if joint.mimic is not None else joint.command or robot.command, turn),
        "friction": friction_of(joint),
        "limits": limits_of(joint),
        "elasticity": elasticity_of(joint),
        "stops": stops_of(joint),
        "brake": brake_of(joint),
        "spring": spring_of(joint),
    }


def _add_mass(moving: list[dict[str, Any]], frame: Frame, link: Link) -> None:
    if frame.body == BASE:
        return  # stands still
    mass, com = link.mass_kg.number, frame.placement.point(vector(link.com_m))
    rotation = frame.placement.rotation
    tensor = inertia_about_origin(mass, com, rotation @ link.inertia_kg_m2.matrix() @ rotation.T)
    moving[frame.body]["masses"].append((mass, mass * com, 0.5 * (tensor + tensor.T)))


def _merged(body: dict[str, Any]) -> dict[str, Any]:
    """The masses that move together as one body: about one origin they add up."""
    mass, first_moment, inertia = (sum(parts) for parts in zip(*body.pop("masses"), strict=True))
    return {**body, "mass": mass, "first_moment": first_moment, "inertia": inertia}

"""A part of an arm, from one frame to another, as a complete arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.description.robot import MASSLESS, FixedJoint, JointFrame, Link, NamedFrame, RobotDescription
from armwright.errors import DescriptionError
from armwright.model.build import STANDARD_GRAVITY, tree_of
from armwright.model.tree import BASE, Tree
from armwright.model.variants.edits import CHOSEN, check_name, checked, chosen, moving_cylinders, replaced
from armwright.model.variants.locked import uncoupled
from armwright.spatial import Frozen, Placement, roll_pitch_yaw, rotated, rotation_rpy

Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Subchain(Frozen):
    """A part of a description, and its place in the whole.

    Attributes:
        robot: the part, its base the frame that was asked for.
        base: placement of that frame in the base of the whole, the joints before it at 0.
    """

    robot: RobotDescription
    base: Placement


def subchain(robot: RobotDescription, base: str, tip: str) -> Subchain:
    """The joints and links from one frame or link to another; the first becomes the base, the second the tip.

    Links fixed to the way stay, as they move with it. What hangs on the way by a joint that moves is left out, and `remarks`
    say so: hold it with `with_locked` first to keep its mass. Gravity is turned into the new base's axes as it is with the
    joints before the base at 0; hold them elsewhere with `with_locked`.

    Args:
        robot: the description.   base: a frame, link or the base.   tip: a frame or link that moves with respect to it.
    Raises:
        DescriptionError: no such frame, no moving joint between the two, or one that mimics a joint which is not.
    """
    place = f"subchain({base!r}, {tip!r})"
    frames = {frame.name: frame for frame in robot.frames}
    ends = [robot.base, *(link.name for link in robot.links), *frames]
    for end in (base, tip):
        check_name(robot, place, end, ends)
    start, end = (frames[name].link if name in frames else name for name in (base, tip))
    kept = _rigid_with(robot, _way(robot, place, start, end))
    joints = [joint for joint in robot.joints if joint.parent in kept and joint.child in kept]
    left = [joint for joint in robot.joints if joint.parent in kept and joint.child not in kept]
    names = {joint.name for joint in robot.joints} - {joint.name for joint in joints}
    links = [link for link in robot.links if link.name in kept and link.name != start]
    if base in frames:
        joints.insert(0, _standing(place, frames[base]))
        links.insert(0, _carrier(robot, place, start))
    for joint in joints:
        mimic = getattr(joint, "mimic", None)
        if mimic is not None and mimic.joint in names:
            raise DescriptionError(
                f"it mimics {mimic.joint!r}, which does not move between the two",
                place=f"{place} joint {joint.name!r}",
                expected=f"{mimic.joint!r} locked first, by with_locked",
                file=robot.name,
            )
    cylinders = moving_cylinders(robot, joints, base, dict.fromkeys(names, 0.0))
    at = _at_zero(tree_of(robot), base)
    part = replaced(
        robot,
        place,
        base=base,
        joints=tuple(uncoupled(joint, names) for joint in joints),
        links=tuple(links),
        frames=tuple(frame for frame in robot.frames if frame.link in kept and frame.name != base),
        tip=tip,
        cylinders=cylinders,
        gravity_m_s2=_gravity(robot, at),
        remarks=(*robot.remarks, *_remarks(robot, left, cylinders, place)),
    )
    return Subchain(part, at)


def _way(robot: RobotDescription, place: str, start: str, end: str) -> set[str]:
    """The links from one to the other."""
    mover = {joint.child: joint for joint in robot.joints}
    way, moves = {start, end}, False
    while end != start:
        if end not in mover:
            raise DescriptionError(place=place, expected="a tip that hangs on the base", file=robot.name)
        moves |= mover[end].kind.moves
        end = mover[end].parent
        way.add(end)
    if not moves:
        raise DescriptionError("no joint moves between the two", place=place, expected="one that does", file=robot.name)
    return way


def _rigid_with(robot: RobotDescription, way: set[str]) -> set[str]:
    """The links on the way and those that are fixed to them."""
    kept, added = way, way
    while added:
        added = {j.child for j in robot.joints if not j.kind.moves and j.parent in kept} - kept
        kept = kept | added
    return kept


def _standing(place: str, base: NamedFrame) -> FixedJoint:
    """Fixed joint from a frame that has become the base to the link that carries it."""
    back = Placement(rotation_rpy(*np.array(base.rpy_rad)), np.array(base.xyz_m)).inverse()
    pose = {"xyz_m": chosen(*back.position), "rpy_rad": chosen(*roll_pitch_yaw(back.rotation))}
    frame = checked(JointFrame, place, source=base.source, **pose)
    name = f"{base.name}_to_{base.link}"
    return checked(FixedJoint, place, name=name, type="fixed", parent=base.name, child=base.link, frame=frame)


def _carrier(robot: RobotDescription, place: str, start: str) -> Link:
    """The link that carries a frame; the old base has no mass that anybody knows, and needs none."""
    if start != robot.base:
        return robot.link(start)
    return checked(Link, place, name=start, source=CHOSEN, **MASSLESS)


def _at_zero(model: Tree, name: str) -> Placement:
    """Placement of a frame in the base, q at 0."""
    placed, at = model.frames[name].placement, model.frames[name].body
    while at != BASE:
        body, q = model.bodies[at], 0.0 if model.mimics is None else float(model.mimics.offset[at])
        placed, at = body.placement @ body.kind.placement(Z, q) @ placed, body.parent
    return placed


def _gravity(robot: RobotDescription, base: Placement) -> Any:
    """Gravity in the axes of the new base; unchanged, None too, if these are the old ones."""
    if (base.rotation == np.eye(3)).all():
        return robot.gravity_m_s2
    gravity = STANDARD_GRAVITY if robot.gravity_m_s2 is None else np.array(robot.gravity_m_s2)
    return chosen(*rotated(base.rotation.T, gravity))


def _remarks(robot: RobotDescription, left: list[Any], cylinders: Sequence[Any], place: str) -> list[str]:
    """Remarks on what is left out: links that moved with respect to the subchain, and cylinders to such links."""
    lost = [cylinder.name for cylinder in robot.cylinders if cylinder not in cylinders]
    remarks = [f"{place} left out the cylinders {', '.join(lost)}"] if lost else []
    behind = {joint.child for joint in left}
    for _ in robot.joints:
        behind |= {joint.child for joint in robot.joints if joint.parent in behind}
    if not left:
        return remarks
    mass = sum(float(link.mass_kg) for link in robot.links if link.name in behind)
    names = ", ".join(joint.name for joint in left)
    return [*remarks, f"{place} left out the links behind {names}: {len(behind)} links of {mass:.4g} kg"]

"""RobotDescription → URDF, with a drive file for everything else."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from armwright.description.drive_file import ENDING
from armwright.description.record_of import Arm, record_of
from armwright.description.robot import MovingJoint, RobotDescription
from armwright.description.urdf.joints import LARGEST
from armwright.export.drive_file import drive_file
from armwright.export.joints import (
    ExportedJoint,
    joint_frames,
    moved_tip,
    named_in,
    numbers_text,
    place_of,
    plain_friction,
    plain_limits,
)
from armwright.export.losses import Losses, loss_of, of_all_formats, of_friction
from armwright.export.springs import spring_losses
from armwright.features import Support
from armwright.model.variants.edits import tip_of
from armwright.output import whole_file
from armwright.solids.mesh import Mesh
from armwright.solids.shapes import Box, Cylinder, Sphere
from armwright.solids.visual import Visual
from armwright.spatial import Placement, roll_pitch_yaw

TYPES = {"revolute": "revolute", "prismatic": "prismatic", "fixed": "fixed"}
ENDLESS = {"revolute": "continuous"}  # without limits of position
SUPPORT = Support("convert to URDF", refused={"screw joints": "has no helical joint"})


def write_urdf(
    arm: Arm | RobotDescription,
    path: str | os.PathLike[str],
    *,
    drive: bool = True,
    elements: Sequence[ElementTree.Element] = (),
) -> list[str]:
    """Writes a URDF and, beside NAME.urdf, the drive file NAME.drive.toml; `read_urdf` reads both.

    Link frames are moved onto their joints, as the format wants them; named frames become fixed links without mass.

    Args:
        arm: the arm or its description.   path: of the file, ending in .urdf.   drive: whether to write the drive file.
        elements: further ones of the robot, such as <ros2_control>.
    Returns:
        losses: what the URDF itself cannot hold, one sentence each; (kept) where the drive file has it.
    Raises:
        OutputError: a file cannot be written.   ModelError: as `to_toml`.
    """
    description, path = record_of(arm), Path(path)
    losses = Losses()
    text = urdf_text(description, path, losses, elements)
    beside = path.with_name(path.stem + ENDING)
    with whole_file(path, (".urdf",)) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
        if drive:
            with whole_file(beside, follow_link=False) as other:
                other.write_text(drive_file(description), encoding="utf-8", newline="\n")
    kept = f" (kept in {beside.name})" if drive else ""
    gears = [joint.name for joint in description.joints if getattr(joint, "motor", None) is not None]
    motors = [f"{loss_of('motors with their rotor inertia', gears)}{kept}"] if gears else []
    gravity = [f"gravity{kept}"] if description.gravity_m_s2 is not None else []
    friction = [f"{sentence}{kept}" for sentence in of_friction(description)]
    springs = [f"{sentence}{kept}" for sentence in spring_losses(description)]
    return [*motors, *gravity, *friction, *springs, *of_all_formats(description, kept), *losses.sentences()]


def urdf_text(
    description: RobotDescription, path: Path, losses: Losses, elements: Sequence[ElementTree.Element] = ()
) -> str:
    """The URDF; lost details of its visuals are added to `losses`. Mesh paths are relative to `path` if they are below it."""
    robot = ElementTree.Element("robot", name=description.name)
    ElementTree.SubElement(robot, "link", name=description.base)
    frames = joint_frames(description)
    for entry in frames:
        _link(robot, entry, path, losses)
    for entry in frames:
        _joint(robot, entry, losses)
    tip, moved = tip_of(description), moved_tip(description, frames)
    if tip is not None and moved is not None:
        losses.add(f"the frame of the tip, which stands on its joint now (frame {moved} is where it was)", tip, "link")
        _frame(robot, moved, *place_of(description, frames, tip))
    for name in (frame.name for frame in description.frames):
        _frame(robot, name, *place_of(description, frames, name))
    robot.extend(elements)
    ElementTree.indent(robot)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{ElementTree.tostring(robot, encoding="unicode")}\n'


def _link(robot: ElementTree.Element, entry: ExportedJoint, path: Path, losses: Losses) -> None:
    link = ElementTree.SubElement(robot, "link", name=entry.link.name)
    if float(entry.link.mass_kg) or entry.tensor.any():
        inertial = ElementTree.SubElement(link, "inertial")
        ElementTree.SubElement(inertial, "origin", xyz=numbers_text(entry.com), rpy="0 0 0")
        ElementTree.SubElement(inertial, "mass", value=repr(float(entry.link.mass_kg)))
        pairs = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
        tensor = {name: repr(float(entry.tensor[i, j])) for name, (i, j) in pairs.items()}
        ElementTree.SubElement(inertial, "inertia", tensor)
    for visual in entry.link.visuals:
        _visual(link, entry, visual, path, losses)


def _visual(link: ElementTree.Element, entry: ExportedJoint, visual: Visual, path: Path, losses: Losses) -> None:
    solid = visual.solid
    if visual.hole or not isinstance(solid, (Box, Cylinder, Sphere, Mesh)):
        losses.add(f"the picture of a {'hole' if visual.hole else solid.shape}", entry.link.name, "link")
        return
    element = ElementTree.SubElement(link, "visual")
    ElementTree.SubElement(element, "origin", _pose(entry.shift @ visual.placement()))
    geometry = ElementTree.SubElement(element, "geometry")
    if isinstance(solid, Box):
        ElementTree.SubElement(geometry, "box", size=numbers_text(np.array(solid.size_m)))
    elif isinstance(solid, Sphere):
        ElementTree.SubElement(geometry, "sphere", radius=repr(float(solid.radius_m)))
    elif isinstance(solid, Cylinder):
        size = {"radius": repr(float(solid.radius_m)), "length": repr(float(solid.length_m))}
        ElementTree.SubElement(geometry, "cylinder", size)
    else:
        scale = np.broadcast_to(np.array(solid.scale), 3)
        ElementTree.SubElement(geometry, "mesh", filename=_mesh_name(solid.path, path), scale=numbers_text(scale))
    if visual.colour is not None:
        material = ElementTree.SubElement(element, "material", name="")
        ElementTree.SubElement(material, "color", rgba=numbers_text([*visual.colour, 1.0]))


def _joint(robot: ElementTree.Element, entry: ExportedJoint, losses: Losses) -> None:
    joint = entry.joint
    limits = _limits(joint, losses) if isinstance(joint, MovingJoint) else {}
    kind = named_in(TYPES, joint, "a URDF")
    kind = ENDLESS.get(kind, kind) if "lower" not in limits else kind
    element = ElementTree.SubElement(robot, "joint", name=joint.name, type=kind)
    ElementTree.SubElement(element, "parent", link=joint.parent)
    ElementTree.SubElement(element, "child", link=joint.child)
    ElementTree.SubElement(element, "origin", xyz=numbers_text(entry.frame.position), rpy=numbers_text(entry.angles))
    if not isinstance(joint, MovingJoint):
        return
    ElementTree.SubElement(element, "axis", xyz=numbers_text(entry.axis))
    if limits:
        ElementTree.SubElement(element, "limit", limits)
    viscous, dry = plain_friction(joint)
    if viscous or dry:
        ElementTree.SubElement(element, "dynamics", damping=repr(viscous), friction=repr(dry))
    if joint.mimic is not None:
        line = {"multiplier": repr(float(joint.mimic.multiplier)), "offset": repr(float(joint.mimic.offset))}
        ElementTree.SubElement(element, "mimic", {"joint": joint.mimic.joint, **line})
    if joint.motor is not None:
        transmission = ElementTree.SubElement(robot, "transmission", name=f"{joint.name}_transmission")
        ElementTree.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
        ElementTree.SubElement(transmission, "joint", name=joint.name)
        actuator = ElementTree.SubElement(transmission, "actuator", name=f"{joint.name}_motor")
        ElementTree.SubElement(actuator, "mechanicalReduction").text = repr(float(joint.motor.gear_ratio))


def _limits(joint: Any, losses: Losses) -> dict[str, str]:
    """A range must have both other limits, as a number; what is not known is written as LARGEST. A slide must have a range."""
    position, velocity, effort = plain_limits(joint)
    written = {}
    if position is not None:
        written |= dict(zip(("lower", "upper"), (repr(v) for v in np.array(position).tolist()), strict=True))
    elif not joint.kind.turns:
        losses.add(f"position limits, which are not known (written as ±{LARGEST:g} m)", joint.name)
        written |= {"lower": repr(-LARGEST), "upper": repr(LARGEST)}
    for name, value in (("effort", effort), ("velocity", velocity)):
        if value is not None:
            written[name] = repr(float(value))
        elif written or effort is not None or velocity is not None:
            losses.add(
                f"that no {name} limit is known (written as {LARGEST:g}, more than any joint reaches)", joint.name
            )
            written[name] = repr(LARGEST)
    return written


def _frame(robot: ElementTree.Element, name: str, link: str, at: Placement) -> None:
    """A fixed link without mass."""
    ElementTree.SubElement(robot, "link", name=name)
    joint = ElementTree.SubElement(robot, "joint", name=f"{name}_frame", type="fixed")
    ElementTree.SubElement(joint, "parent", link=link)
    ElementTree.SubElement(joint, "child", link=name)
    ElementTree.SubElement(joint, "origin", _pose(at))


def _mesh_name(mesh: Path, path: Path) -> str:
    folder, mesh = path.resolve().parent, mesh.resolve()
    return mesh.relative_to(folder).as_posix() if mesh.is_relative_to(folder) else mesh.as_uri()


def _pose(at: Placement) -> dict[str, str]:
    return {"xyz": numbers_text(at.position), "rpy": numbers_text(roll_pitch_yaw(at.rotation))}

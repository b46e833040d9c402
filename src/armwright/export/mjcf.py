"""RobotDescription → MuJoCo's XML."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from armwright.description.record_of import Arm, record_of
from armwright.description.robot import MovingJoint, RobotDescription
from armwright.export.joints import (
    ExportedJoint,
    joint_frames,
    named_in,
    numbers_text,
    place_of,
    plain_friction,
    plain_limits,
)
from armwright.export.losses import Losses, of_all_formats, of_friction
from armwright.export.servo_actuators import ServoActuator, element, joint_values
from armwright.export.springs import add_tendons, joint_stiffness
from armwright.features import Support
from armwright.lint.feasibility import is_possible
from armwright.model.build import STANDARD_GRAVITY
from armwright.model.variants.edits import tip_of
from armwright.output import write_whole
from armwright.solids.shapes import Box, Cylinder, Ellipsoid, Sphere
from armwright.spatial import Placement, pseudo_inertia, rotation_quaternion

TYPES = {"revolute": "hinge", "prismatic": "slide"}
LOST = "not in the file; named among what is lost"
SUPPORT = Support(
    "convert to MJCF",
    approximated={
        **dict.fromkeys(
            (
                *("mimic joints", "coupled motors", "gear loss", "smoothed friction", "friction by direction"),
                *("friction offset", "Stribeck friction", "sigmoid friction", "LuGre friction", "motor-side friction"),
                *("load-dependent friction", "friction by temperature", "effects of the simulator", "brakes"),
            ),
            LOST,
        ),
        **dict.fromkeys(("servo", "servo counts"), "with `--actuators` fitted; else not in the file"),
    },
    refused={"screw joints": "has no helical joint"},
)


@dataclass(frozen=True, eq=False)
class MujocoActuators:
    """Actuators that follow goals, in place of motors.

    Attributes:
        kind: MuJoCo's element, "position" or "dcmotor".   joints: numbers by joint.   step: of the simulation [s].
    """

    kind: str
    joints: Mapping[str, ServoActuator]
    step: float


def write_mjcf(
    arm: Arm | RobotDescription, path: str | os.PathLike[str], actuators: MujocoActuators | None = None
) -> list[str]:
    """Writes an MJCF: bodies, hinges and slides, armature, damping, dry friction, springs, gears, limits, named frames as sites.

    Armature is n² J_m. A motor's control is the torque on the joint over the gear ratio. Cylinders are
    spatial tendons. MuJoCo itself refuses bodies that move without mass, and tensors that no body has.

    Args:
        arm: the arm or its description.   path: of the file, ending in .xml.
        actuators: that follow goals, for all driven joints; None: motors, whose control is a torque.
    Returns:
        losses: properties that an MJCF cannot hold, one sentence each.
    Raises:
        OutputError: the file cannot be written.   ModelError: as `to_toml`.
    """
    description, path = record_of(arm), Path(path)
    text, losses = mjcf_text(description, actuators)
    write_whole(path, text, (".xml", ".mjcf"))
    return losses


def mjcf_text(description: RobotDescription, actuators: MujocoActuators | None = None) -> tuple[str, list[str]]:
    """The MJCF and its losses."""
    losses = Losses()
    root = ElementTree.Element("mujoco", model=description.name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false", balanceinertia="false")
    gravity = STANDARD_GRAVITY if description.gravity_m_s2 is None else np.array(description.gravity_m_s2)
    solver = {} if actuators is None else {"timestep": repr(actuators.step), "integrator": "implicitfast"}
    ElementTree.SubElement(root, "option", {"gravity": numbers_text(gravity), **solver})
    world = ElementTree.SubElement(root, "worldbody")
    actuator, equality = ElementTree.SubElement(root, "actuator"), ElementTree.SubElement(root, "equality")
    bodies, frames = {description.base: world}, joint_frames(description)
    for entry in frames:
        body = ElementTree.SubElement(
            bodies[entry.joint.parent], "body", {"name": entry.link.name, **_pose(entry.frame)}
        )
        bodies[entry.link.name] = body
        if isinstance(entry.joint, MovingJoint):
            _joint(body, actuator, entry, losses, actuators)
            if not _has_mass(description, entry.link.name):
                losses.add("MuJoCo will not read the file, as nothing moved has mass", entry.joint.name)
        _inertial(body, entry, losses)
        for visual in entry.link.visuals:
            _geom(body, entry, visual, losses)
    for name in (frame.name for frame in description.frames):
        link, at = place_of(description, frames, name)
        ElementTree.SubElement(bodies[link], "site", {"name": name, **_pose(at)})
    tip = tip_of(description)
    if tip is not None and "tip" not in (tip, *(frame.name for frame in description.frames)):
        link, at = place_of(description, frames, tip)
        ElementTree.SubElement(bodies[link], "site", {"name": "tip", **_pose(at)})
    for joint in description.moving_joints:
        if joint.mimic is not None:
            pair = {"joint1": joint.name, "joint2": joint.mimic.joint}
            line = numbers_text((joint.mimic.offset, joint.mimic.multiplier, 0.0, 0.0, 0.0))
            ElementTree.SubElement(equality, "joint", {**pair, "polycoef": line})
            losses.add(
                "that it follows exactly, as joints that follow others do (MuJoCo's equality constraints give way)",
                joint.name,
            )
    add_tendons(root, bodies, description, frames, losses)
    if not len(equality):
        root.remove(equality)
    ElementTree.indent(root)
    return f"{ElementTree.tostring(root, encoding='unicode')}\n", [
        *of_friction(description),
        *of_all_formats(description, servos=actuators is not None),
        *losses.sentences(),
    ]


def _joint(body: Any, actuator: Any, entry: ExportedJoint, losses: Losses, actuators: MujocoActuators | None) -> None:
    joint = entry.joint
    assert isinstance(joint, MovingJoint)
    kind, motor = named_in(TYPES, joint, "an MJCF"), joint.motor
    position, velocity, effort = plain_limits(joint)
    values = {"name": joint.name, "type": kind, "axis": numbers_text(entry.axis)}
    if position is not None:
        values |= {"limited": "true", "range": numbers_text(np.array(position))}
    if velocity is not None:
        losses.add("velocity limits", joint.name)
    gear = 1.0 if motor is None else float(motor.gear_ratio)
    rotor = 0.0 if motor is None else float(motor.rotor_inertia_kg_m2)
    viscous, dry = plain_friction(joint)
    numbers = {"armature": gear * gear * rotor, "damping": viscous, "frictionloss": dry}
    follows = None if actuators is None or joint.mimic is not None else actuators.joints[joint.name]
    if actuators is not None and follows is not None:
        numbers = joint_values(actuators.kind, follows)
    values |= {name: repr(value) for name, value in numbers.items() if value}
    ElementTree.SubElement(body, "joint", values | joint_stiffness(joint, losses))
    if actuators is not None and follows is not None:
        if actuators.kind == "position" and follows.integral:
            losses.add("I of the firmware", joint.name)
        if actuators.kind == "position" and np.isfinite(follows.goal_speed):
            losses.add("the goal's speed in the firmware", joint.name)
        tag, attributes = element(actuators.kind, joint.name, follows, actuators.step)
        ElementTree.SubElement(actuator, tag, attributes)
        return
    if joint.mimic is not None:
        if effort is not None:
            losses.add("effort limits of joints that follow another", joint.name)
        return
    drive = {"name": f"{joint.name}_motor", "joint": joint.name, "gear": repr(gear)}
    if effort is not None:
        most = float(effort) / abs(gear)
        drive |= {"ctrllimited": "true", "ctrlrange": numbers_text((-most, most))}
    ElementTree.SubElement(actuator, "motor", drive)


def _inertial(body: Any, entry: ExportedJoint, losses: Losses) -> None:
    mass, tensor = float(entry.link.mass_kg), entry.tensor
    if not mass and not tensor.any():
        return
    possible = is_possible(pseudo_inertia(mass, np.zeros(3), tensor))
    if not mass or not possible or np.linalg.eigvalsh(tensor)[0] <= 0:
        why = "the inertia of a point or a line" if mass and possible else "an inertia that no body has"
        losses.add(f"MuJoCo will not read the file, as it refuses {why}", entry.link.name, "link")
    entries = [tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    ElementTree.SubElement(
        body, "inertial", pos=numbers_text(entry.com), mass=repr(mass), fullinertia=numbers_text(entries)
    )


def _has_mass(description: RobotDescription, link: str) -> bool:
    """True if a link has mass or inertia, or one that is fixed to it has."""
    record = description.link(link)
    fixed = [j.child for j in description.joints if not j.kind.moves and j.parent == link]
    has_mass = bool(float(record.mass_kg)) or bool(record.inertia_kg_m2.matrix().any())
    return has_mass or any(_has_mass(description, child) for child in fixed)


def _geom(body: Any, entry: ExportedJoint, visual: Any, losses: Losses) -> None:
    """Pictures touch nothing and weigh nothing."""
    shape = None if visual.hole else _shape(visual.solid)
    if shape is None:
        losses.add(f"the picture of a {'hole' if visual.hole else visual.solid.shape}", entry.link.name, "link")
        return
    colour = {} if visual.colour is None else {"rgba": numbers_text((*visual.colour, 1.0))}
    place = _pose(entry.shift @ visual.placement())
    ElementTree.SubElement(body, "geom", {**shape, "contype": "0", "conaffinity": "0", "mass": "0", **place, **colour})


def _shape(solid: Any) -> dict[str, str] | None:
    """Type and half sizes of a geom."""
    if isinstance(solid, Box):
        return {"type": "box", "size": numbers_text(0.5 * np.array(solid.size_m))}
    if isinstance(solid, Sphere):
        return {"type": "sphere", "size": repr(float(solid.radius_m))}
    if isinstance(solid, Cylinder):
        return {"type": "cylinder", "size": numbers_text((float(solid.radius_m), 0.5 * float(solid.length_m)))}
    if isinstance(solid, Ellipsoid):
        return {"type": "ellipsoid", "size": numbers_text(np.array(solid.semi_axes_m))}
    return None


def _pose(at: Placement) -> dict[str, str]:
    return {"pos": numbers_text(at.position), "quat": numbers_text(rotation_quaternion(at.rotation))}

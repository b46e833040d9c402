"""Springs in other formats: MuJoCo's joints and tendons, and tables of a drive file."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import numpy as np

from armwright.description.robot import MovingJoint, RobotDescription
from armwright.export.joints import ExportedJoint, numbers_text, place_of
from armwright.export.losses import Losses, loss_of
from armwright.model.joint_side import spring_of
from armwright.model.springs import LinearSpring


def spring_losses(robot: RobotDescription) -> list[str]:
    """Springs of a description as losses of a format without springs, one sentence for each kind."""
    joints = [joint.name for joint in robot.moving_joints if joint.spring is not None]
    cylinders = loss_of("forces between two links", [cylinder.name for cylinder in robot.cylinders], "cylinder")
    return [loss for loss in (loss_of("springs", joints), cylinders) if loss]


def joint_stiffness(joint: MovingJoint, losses: Losses) -> dict[str, str]:
    """MuJoCo's  torque = -stiffness (q - springref):  a preload moves the reference to where the torque is 0."""
    spring = spring_of(joint)
    if spring is None:
        return {}
    if not isinstance(spring, LinearSpring):
        losses.add("springs by table", joint.name)
        return {}
    if not spring.stiffness:
        losses.add("springs without stiffness, whose torque is constant", joint.name)
        return {}
    return {"stiffness": repr(spring.stiffness), "springref": repr(spring.rest + spring.preload / spring.stiffness)}


def cylinder_ends(robot: RobotDescription, frames: list[ExportedJoint], cylinder: Any) -> list[tuple[str, np.ndarray]]:
    """The links that carry a cylinder's ends, and the anchors (3,) [m] in those links' frames here."""
    ends = (cylinder.link_a, cylinder.anchor_a_m), (cylinder.link_b, cylinder.anchor_b_m)
    return [(link, place_of(robot, frames, link)[1].point(np.array(anchor))) for link, anchor in ends]


def add_tendons(
    root: ElementTree.Element,
    bodies: dict[str, ElementTree.Element],
    robot: RobotDescription,
    frames: list[ExportedJoint],
    losses: Losses,
) -> None:
    """Adds each cylinder as a spatial tendon between two sites:  tension = stiffness (ℓ - springlength).

    A tendon rests at a length of 0 or more: what pulls there already, or pushes without stiffness, is lost.
    """
    taken = {robot.base, *(link.name for link in robot.links), *(frame.name for frame in robot.frames)}
    tendons = ElementTree.Element("tendon")
    for cylinder in robot.cylinders:
        force, length, stiffness = (float(getattr(cylinder, k)) for k in ("force_n", "length_m", "stiffness_n_per_m"))
        rest = length + force / stiffness if stiffness else -1.0
        if rest < 0.0:
            why = "that still pulls at length 0" if stiffness else "without stiffness"
            losses.add(f"a force {why} (a tendon has none)", cylinder.name, "cylinder")
            continue
        values = {"name": cylinder.name, "stiffness": repr(stiffness), "springlength": repr(rest)}
        tendon = ElementTree.SubElement(tendons, "spatial", values)
        for letter, (link, point) in zip("ab", cylinder_ends(robot, frames, cylinder), strict=True):
            site = f"{cylinder.name}_{letter}"
            while site in taken:
                site += "_"
            taken.add(site)
            ElementTree.SubElement(bodies[link], "site", {"name": site, "pos": numbers_text(point)})
            ElementTree.SubElement(tendon, "site", {"site": site})
    if len(tendons):
        root.append(tendons)

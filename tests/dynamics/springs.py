"""Arms with springs: random ones, and pendulums whose equations are known."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.description import RobotDescription
from armwright.description.consistency import carrier
from armwright.description.database import parse
from armwright.description.springs import CylinderRecord, LinearSpringRecord, RotarySpringRecord
from armwright.model import Model, build_model
from reference.random_trees import random_description

MASS, REACH, GRAVITY = 3.0, 0.4, 9.81


def pendulum(cylinders: Any = (), **joint: Any) -> Model:
    """A point mass on a rod without mass, turning about -y: at q = 0 it stands above the joint, q > 0 leans to -x."""
    frame = {"xyz_m": [0.0, 0.0, 0.0], "rpy_rad": [0.0, 0.0, 0.0]}
    hinge = {
        "name": "hinge",
        "type": "revolute",
        "parent": "base",
        "child": "rod",
        "frame": frame,
        "axis": [0.0, -1.0, 0.0],
    }
    nothing = dict.fromkeys(("xx", "xy", "xz", "yy", "yz", "zz"), 0.0)
    rod = {"name": "rod", "mass_kg": MASS, "com_m": [0.0, 0.0, REACH], "inertia_kg_m2": nothing}
    record = {"name": "pendulum", "source": "definition", "command": "torque", "gravity_m_s2": [0.0, 0.0, -GRAVITY]}
    return build_model(
        parse({**record, "joints": [{**hinge, **joint}], "links": [rod], "cylinders": cylinders}, "pendulum")
    )


def sprung_tree(seed: int, *, tables: bool = True) -> RobotDescription:
    """A random tree with springs at two of three joints, of all kinds, and two cylinders between links that move."""
    rng = np.random.default_rng([seed, 77])
    robot = random_description(seed)
    joints = [_with_spring(joint, rng, tables) for joint in robot.joints]
    links = [robot.base, *(link.name for link in robot.links)]
    cylinders = []
    while len(cylinders) < 2:
        a, b = rng.choice(links, 2)
        if carrier(robot.joints, a) != carrier(robot.joints, b):
            ends = {
                "link_a": a,
                "anchor_a_m": rng.uniform(-0.5, 0.5, 3),
                "link_b": b,
                "anchor_b_m": rng.uniform(-0.5, 0.5, 3),
            }
            numbers = {"force_n": rng.uniform(-30, 60), "length_m": 1.0, "stiffness_n_per_m": rng.uniform(90.0, 200.0)}
            cylinders.append(CylinderRecord(name=f"cylinder{len(cylinders)}", source="estimate", **ends, **numbers))
    return robot.replace(joints=tuple(joints), cylinders=tuple(cylinders))


def _with_spring(joint: Any, rng: np.random.Generator, tables: bool) -> Any:
    kind = rng.integers(3)
    if joint.type == "fixed" or kind == 0:
        return joint
    turns = joint.type == "revolute"
    record, angle, force, values = (
        (RotarySpringRecord, "rad", "n_m", "torques_n_m") if turns else (LinearSpringRecord, "m", "n", "forces_n")
    )
    if kind == 1 or not tables:
        stiffness, rest, preload = f"stiffness_{force}_per_{angle}", f"rest_{angle}", f"preload_{force}"
        numbers = {stiffness: rng.uniform(1.0, 20.0), rest: rng.normal(), preload: rng.normal()}
    else:
        points = {
            f"positions_{angle}": np.cumsum(rng.uniform(0.1, 0.6, 5)) - 1.0,
            values: rng.normal(size=5, scale=5.0),
        }
        numbers = {**points, "outside": rng.choice(["constant", "linear"])}
    return joint.replace(spring=record(source="estimate", **numbers))

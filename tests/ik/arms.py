"""Arms for inverse kinematics: built in, of example-robot-data, and one written here with the lengths of a KUKA iiwa 14."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from reference.example_robots import robot_files

URDFS = {
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
}
TIPS = {"ur5": "ee_link", "xarm7": "link7"}
IIWA = (0.36, 0.42, 0.4, 0.126)  # [m] base to shoulder, upper arm, forearm, wrist to flange [KUKA's data sheet]
TURNS = (2.967, 2.094, 2.967, 2.094, 2.967, 2.094, 3.054)  # [rad] to either side


def iiwa(folder):
    """A seven-joint arm of alternating roll and pitch axes."""
    heights = (IIWA[0], 0.0, IIWA[1], 0.0, IIWA[2], 0.0, IIWA[3])
    joints = "".join(
        f'<joint name="a{k + 1}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0 0 {height}"/><axis xyz="0 {k % 2} {1 - k % 2}"/>'
        f'<limit lower="-{turn}" upper="{turn}" velocity="2" effort="100"/></joint>'
        for k, (height, turn) in enumerate(zip(heights, TURNS, strict=True))
    )
    links = "".join(f'<link name="l{k}"/>' for k in range(8))
    path = folder / "iiwa.urdf"
    path.write_text(f'<robot name="iiwa">{links}{joints}</robot>')
    return aw.load(path, kinematics_only=True)


def arm_of(name, folder):
    """The arm of that name."""
    if name == "iiwa":
        return iiwa(folder)
    if name not in URDFS:
        return aw.load(name)
    if URDFS[name] not in robot_files():
        pytest.skip("needs the robots: pip install example-robot-data")
    return aw.load(robot_files()[URDFS[name]], kinematics_only=True).replace(tip=TIPS[name])


def samples(arm, count, seed=0):
    """Joint positions (count, n) within the limits, and the poses (count, 4, 4) of the tip there."""
    low, high = np.array([body.limits.position for body in arm.bodies]).T
    low, high = np.maximum(low, -np.pi), np.minimum(high, np.pi)
    q = np.random.default_rng(seed).uniform(low, high, (count, arm.n))
    return q, aw.compile(arm).forward_kinematics(q)

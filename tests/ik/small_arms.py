"""Arms of four and five joints as URDF: what they are bought for is a position and a part of the orientation."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

import armwright as aw

ALONG = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
SERVO = (  # name, axis, origin in the link before, lower, upper: a small servo arm, its tool along the hand's z
    ("waist", "z", "0 0 0.06", "0 0 0", -3.1, 3.1),
    ("shoulder", "y", "0 0 0.045", "0 0 0", -1.9, 1.9),
    ("elbow", "y", "0.05 0 0.2", "0 0 0", -2.1, 1.7),
    ("wrist", "y", "0.2 0 0", "0 1.5707963267948966 0", -1.8, 2.1),
)
JOINTS = {
    "pitch-4": SERVO,  # waist, shoulder, elbow, wrist: position and pitch
    "servo-5": (*SERVO, ("roll", "z", "0 0 0.065", "0 0 0", -3.1, 3.1)),  # position and axis, or position and pitch
    "palletiser": (  # its hand stays level: position and yaw
        ("waist", "z", "0 0 0.4", "0 0 0", -2.9, 2.9),
        ("arm", "y", "0.15 0 0.1", "0 0 0", -0.8, 1.5),
        ("rod", "y", "0 0 0.6", "0 0 0", -9.0, 9.0),
        ("forearm", "y", "0 0 0", "0 0 0", -0.4, 1.4),
        ("level", "y", "0.65 0 0", "0 0 0", -9.0, 9.0),
        ("tool", "z", "0.1 0 -0.1", "3.141592653589793 0 0", -6.0, 6.0),
    ),
    "scara": (
        ("arm", "z", "0 0 0.3", "0 0 0", -2.4, 2.4),
        ("forearm", "z", "0.25 0 0", "0 0 0", -2.6, 2.6),
        ("quill", "slide", "0.2 0 0", "3.141592653589793 0 0", 0.0, 0.18),
        ("tool", "z", "0 0 0", "0 0 0", -6.2, 6.2),
    ),
}
FOLLOWS = {"rod": "arm", "level": "forearm"}  # rods of parallelograms: minus the angle of these joints
REACH = {"pitch-4": "0 0 0.1", "servo-5": "0.01 0 0.06", "palletiser": "0 0 0.1", "scara": "0 0 0.02"}


def urdf(name):
    """Text of an arm's file; its last link is `tool`."""
    text, links = "", ["base_link"]
    for joint, axis, xyz, rpy, lower, upper in JOINTS[name]:
        links.append(f"{joint}_link")
        mimic = f'<mimic joint="{FOLLOWS[joint]}" multiplier="-1"/>' if joint in FOLLOWS else ""
        kind = "prismatic" if axis == "slide" else "revolute"
        text += (
            f'<joint name="{joint}" type="{kind}"><parent link="{links[-2]}"/><child link="{links[-1]}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{ALONG.get(axis, ALONG["z"])}"/>'
            f'<limit lower="{lower}" upper="{upper}" velocity="2" effort="20"/>{mimic}</joint>'
        )
    text += (
        f'<joint name="flange" type="fixed"><parent link="{links[-1]}"/><child link="tool"/>'
        f'<origin xyz="{REACH[name]}"/></joint>'
    )
    return f'<robot name="{name}">{"".join(f"<link name={link!r}/>" for link in [*links, "tool"])}{text}</robot>'


def small_arm(name, folder):
    """The arm of that name."""
    path = folder / f"{name}.urdf"
    path.write_text(urdf(name), encoding="utf-8")
    return aw.load(path, kinematics_only=True)


def samples_of(arm, count, seed=1):
    """Joint positions (count, n) within the limits, revolute ones within half a turn of 0."""
    low, high = np.array([body.limits.position for body in arm.coordinates]).T
    return np.random.default_rng(seed).uniform(np.maximum(low, -np.pi), np.minimum(high, np.pi), (count, arm.n))


def forward(name, q):
    """Positions (k, 3) and rotations of an arm's tool, joint by joint, from its table and by SciPy alone."""
    q, free = np.atleast_2d(q), [joint for joint, *_ in JOINTS[name] if joint not in FOLLOWS]
    at, turned = np.zeros((len(q), 3)), Rotation.identity(len(q))
    for joint, axis, xyz, rpy, *_ in JOINTS[name]:
        at = at + turned.apply(np.array(xyz.split(), dtype=float))
        turned = turned * Rotation.from_euler("xyz", np.array(rpy.split(), dtype=float))
        moved = q[:, free.index(FOLLOWS.get(joint, joint))] * (-1.0 if joint in FOLLOWS else 1.0)
        if axis == "slide":
            at = at + turned.apply(moved[:, None] * [0.0, 0.0, 1.0])
        else:
            turned = turned * Rotation.from_rotvec(moved[:, None] * np.eye(3)["xyz".index(axis)])
    return at + turned.apply(np.array(REACH[name].split(), dtype=float)), turned


def partly_off(aim, reached, target):
    """(k,) [rad] by which what counts of rotations differs, by SciPy and the words of the documentation."""
    word, _, rest = aim.partition(" ")
    if word in ("base", "tool"):
        turn = target * reached.inv() if word == "base" else reached.inv() * target
        return np.abs(turn.as_rotvec()[:, ["xyz".index(axis) for axis in rest]]).max(axis=1)
    if word in ("pose", "position"):
        return (reached.inv() * target).magnitude() * (word == "pose")
    axis = np.eye(3)["xyz".index(rest or {"yaw": "x"}.get(word, "z"))]
    a, b = reached.apply(axis), target.apply(axis)
    if word == "axis":
        return np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))
    if word == "pitch":
        return np.abs(np.subtract(*(np.arctan2(each[:, 2], np.hypot(each[:, 0], each[:, 1])) for each in (a, b))))
    difference = np.subtract(*(np.arctan2(each[:, 1], each[:, 0]) for each in (a, b)))
    return np.abs(np.remainder(difference + np.pi, 2.0 * np.pi) - np.pi)

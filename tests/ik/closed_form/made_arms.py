"""Arms of random axes that meet or are parallel as a closed form needs it, and no more than that."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

import armwright as aw

KINDS = {  # which axes meet, which are parallel, counted from 0
    "wrist, 2 and 3 parallel": ([(3, 4, 5)], [(1, 2)]),
    "wrist, 1 and 2 meet": ([(3, 4, 5), (0, 1)], []),
    "wrist, 2 and 3 meet": ([(3, 4, 5), (1, 2)], []),
    "wrist, 1 and 2 parallel": ([(3, 4, 5)], [(0, 1)]),
    "three parallel": ([(4, 5)], [(1, 2, 3)]),
}


def axes(kind, seed, backward=False):
    """Directions and points (6, 3) of an arm, and the translation and rotation of its tip."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(6, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = rng.uniform(-0.5, 0.5, (6, 3))
    meeting, parallel = KINDS[kind]
    for group in meeting:
        points[list(group)] = points[group[0]] + directions[list(group)] * rng.uniform(-0.3, 0.3, (len(group), 1))
    for group in parallel:
        directions[list(group)] = directions[group[0]] * rng.choice([-1.0, 1.0], (len(group), 1))
    if backward:
        directions, points = -directions[::-1], points[::-1]
    return directions, points, rng.uniform(-0.3, 0.3, 3), Rotation.random(rng=rng)


def arm_of_axes(folder, directions, points, tip, turn, limit=np.pi):
    """The arm with these axes in its zero pose, every joint from -limit to limit, unless limits (6, 2) are given."""
    limits = np.broadcast_to(limit, (6, 2)) * [-1.0, 1.0] if np.ndim(limit) == 0 else limit
    before = np.zeros(3)
    joints = []
    for k, (h, c) in enumerate(zip(directions, points, strict=True)):
        joints.append(
            f'<joint name="a{k + 1}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
            f'<origin xyz="{" ".join(f"{x:.17g}" for x in c - before)}"/><axis xyz="{" ".join(f"{x:.17g}" for x in h)}"/>'
            f'<limit lower="{limits[k][0]:.17g}" upper="{limits[k][1]:.17g}" velocity="2" effort="100"/></joint>'
        )
        before = c
    rpy = " ".join(f"{x:.17g}" for x in turn.as_euler("xyz"))
    xyz = " ".join(f"{x:.17g}" for x in tip)
    joints.append(
        f'<joint name="hand" type="fixed"><parent link="l6"/><child link="l7"/><origin xyz="{xyz}" rpy="{rpy}"/></joint>'
    )
    links = "".join(f'<link name="l{k}"/>' for k in range(8))
    path = folder / "made.urdf"
    path.write_text(f'<robot name="made">{links}{"".join(joints)}</robot>')
    return aw.load(path, kinematics_only=True).replace(tip="l7")

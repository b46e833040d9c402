"""Random arms for tests: trees of 1-30 moving joints, revolute and prismatic, with fixed links, branches and drives."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.description import RobotDescription
from armwright.description.database import parse
from armwright.dynamics import mass_matrix
from armwright.model import Model, build_model

MOST_JOINTS = 30
WORST_CONDITION = 1e6  # of the mass matrix: beyond it 1e-10 is more than two correct programs can agree to


def joint_count(seed: int) -> int:
    """Moving joints of a seed's tree: each third one runs through 1-30, the others are as small as most arms."""
    return 1 + (seed // 3 % MOST_JOINTS if seed % 3 == 0 else seed % 11)


def random_description(seed: int, screws: bool = False) -> RobotDescription:
    """A tree of `joint_count(seed)` moving joints whose mass matrix is well conditioned at a few random positions.

    Frames are explicit, axes point anywhere, inertias belong to real bodies. Joints may stand in the file before the
    joint that carries them. Some joints have a motor (rotor inertia, signed ratio), some of those friction and gear
    loss: take them away with `replace(friction=None, efficiency=None)` before comparing with a peer that has none.
    With `screws` every other joint that turns is one, of either hand.
    """
    for attempt in range(100):
        rng = np.random.default_rng([seed, attempt])
        tree = _random_tree(rng, joint_count(seed))
        if screws:
            turning = [joint for joint in tree["joints"] if joint["type"] == "revolute"]
            for joint in turning[::2]:
                joint |= {"type": "helical", "pitch_m_per_rad": rng.choice([-1.0, 1.0]) * rng.uniform(0.005, 0.1)}
        description = parse(tree, f"random tree {seed}")
        model = build_model(description)
        conditions = [np.linalg.cond(mass_matrix(model, random_position(model, rng))) for _ in range(3)]
        if max(conditions) < 0.1 * WORST_CONDITION:
            return description
    raise AssertionError(f"seed {seed}: no well-conditioned tree in 100 draws")


def random_position(model: Model, rng: np.random.Generator) -> np.ndarray:
    """q (n,): any angle, slides within 0.5 m."""
    reach = [body.kind.units.half_range for body in model.bodies]
    return rng.uniform(-1.0, 1.0, model.n) * reach


def random_body(rng: np.random.Generator) -> dict[str, Any]:
    """Mass, centre of mass and tensor of a real body: a cloud of mass with three random thicknesses."""
    mass = float(np.exp(rng.uniform(np.log(0.3), np.log(8.0))))
    turn = random_rotation(rng)
    spread = turn @ np.diag(rng.uniform(0.02, 0.2, 3) ** 2) @ turn.T  # ∫ r rᵀ dm / m
    tensor = mass * (np.trace(spread) * np.eye(3) - spread)
    entries = {f"{'xyz'[i]}{'xyz'[j]}": float(tensor[i, j]) for i in range(3) for j in range(i, 3)}
    return {"mass_kg": mass, "com_m": rng.uniform(-0.2, 0.2, 3).tolist(), "inertia_kg_m2": entries}


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """A rotation matrix, uniform over all of them."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def _random_tree(rng: np.random.Generator, moving: int) -> dict[str, Any]:
    joints: list[dict[str, Any]] = []
    links = ["base"]
    made = 0
    while made < moving:
        fixed = rng.random() < 0.2
        kind = "fixed" if fixed else ("revolute" if rng.random() < 0.7 else "prismatic")
        parent = links[-1] if rng.random() < 0.65 else links[rng.integers(len(links))]
        child = f"link{len(links)}"
        joints.append(_random_joint(rng, kind, parent, child))
        links.append(child)
        made += not fixed
    if rng.random() < 0.3:
        links.append(f"link{len(links)}")
        joints.append(_random_joint(rng, "fixed", links[rng.integers(len(links) - 1)], links[-1]))
    if rng.random() < 0.5:
        joints = [joints[k] for k in rng.permutation(len(joints))]
    tip = {"name": "tool", "link": links[rng.integers(max(1, len(links) // 2), len(links))], **_random_frame(rng)}
    return {
        "name": "random-tree",
        "source": "definition",
        "command": "torque",
        "gravity_m_s2": rng.normal(scale=6.0, size=3).tolist(),
        "tip": "tool",
        "joints": joints,
        "links": [{"name": name, **random_body(rng)} for name in links[1:]],
        "frames": [tip],
    }


def _random_frame(rng: np.random.Generator) -> dict[str, Any]:
    turn = rng.uniform(-np.pi, np.pi, 3)
    if rng.random() < 0.3:
        turn = rng.integers(-2, 3, 3) * (np.pi / 2)  # the right angles that tracing folds
    return {"xyz_m": rng.uniform(-0.4, 0.4, 3).tolist(), "rpy_rad": turn.tolist()}


def _random_joint(rng: np.random.Generator, kind: str, parent: str, child: str) -> dict[str, Any]:
    joint: dict[str, Any] = {"name": f"to-{child}", "type": kind, "parent": parent, "child": child}
    joint["frame"] = _random_frame(rng)
    if kind == "fixed":
        return joint
    along = rng.integers(3)
    straight = np.eye(3)[along] * rng.choice([-1.0, 1.0])
    joint["axis"] = (straight if rng.random() < 0.4 else rng.normal(size=3)).tolist()  # not normalised
    if rng.random() < 0.6:
        ratio = rng.choice([-1.0, 1.0]) * rng.uniform(5.0, 80.0)
        joint["motor"] = {"gear_ratio": ratio, "rotor_inertia_kg_m2": rng.uniform(0.02, 1.0) / ratio**2}
        if rng.random() < 0.5:
            torque, length = ("n_m", "rad") if kind == "revolute" else ("n", "m")
            per = "n_m_s_per_rad" if kind == "revolute" else "n_s_per_m"
            joint["friction"] = {
                f"viscous_{per}": rng.uniform(0.0, 2.0),
                f"coulomb_positive_{torque}": rng.uniform(0.0, 1.0),
                f"coulomb_negative_{torque}": rng.uniform(0.0, 1.0),
                f"smoothing_{length}_per_s": 0.1,
            }
            joint["motor"]["gear_efficiency"] = rng.uniform(0.6, 1.0)
    return joint

"""Long serial arms for tests: n revolute joints with rotors, placed at random or with parallel and perpendicular axes."""

from __future__ import annotations

import numpy as np

from armwright.description.database import parse
from armwright.model import Model, build_model
from reference.random_trees import random_body

STRAIGHT = (
    ([0.1, 0.0, 0.2], [np.pi / 2, 0.0, 0.0]),
    ([0.3, 0.0, 0.0], [0.0] * 3),
    ([0.0, 0.0, 0.2], [-np.pi / 2, 0.0, 0.0]),
)


def chain(n: int, *, straight: bool = False) -> Model:
    """A chain of n joints; `straight` has the right angles of industrial arms, otherwise axes point anywhere."""
    rng = np.random.default_rng(n)
    joints, links = [], []
    for k in range(n):
        xyz, rpy = STRAIGHT[k % 3] if straight else (rng.uniform(-0.4, 0.4, 3), rng.uniform(-np.pi, np.pi, 3))
        joints.append(
            {
                "name": f"joint{k}",
                "type": "revolute",
                "parent": f"link{k - 1}" if k else "base",
                "child": f"link{k}",
                "frame": {"xyz_m": list(map(float, xyz)), "rpy_rad": list(map(float, rpy))},
                "axis": [0.0, 0.0, 1.0] if straight else rng.normal(size=3).tolist(),
                "motor": {"gear_ratio": 30.0, "rotor_inertia_kg_m2": 1e-4},
            }
        )
        links.append({"name": f"link{k}", **random_body(rng)})
    record = {"name": f"chain{n}", "source": "definition", "command": "torque", "gravity_m_s2": [0.0, 0.0, -9.81]}
    tip = {"name": "tool", "link": f"link{n - 1}", "xyz_m": [0.0, 0.0, 0.1], "rpy_rad": [0.0] * 3}
    return build_model(parse({**record, "tip": "tool", "joints": joints, "links": links, "frames": [tip]}, "chain"))

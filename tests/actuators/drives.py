"""Arms of one joint for the tests of actuators, and of two where friction is told on either side."""

from __future__ import annotations

from typing import Any

from armwright.description.database import parse
from armwright.model import Model, build_model


def one_joint(friction: dict[str, Any] | None = None, motor: dict[str, Any] | None = None, **joint: Any) -> Model:
    """A pendulum with that friction and motor record."""
    own = {key: value for key, value in (("friction", friction), ("motor", motor)) if value is not None}
    kind = {"type": "revolute", "command": "torque"}
    frame = {"frame": {"xyz_m": [0, 0, 0], "rpy_rad": [0, 0, 0]}, "axis": [0, 1, 0]}
    tensor = {"xx": 0.1, "xy": 0, "xz": 0, "yy": 0.1, "yz": 0, "zz": 0.1}
    return build_model(
        parse(
            {
                "name": "one",
                "source": "definition",
                "joints": [{"name": "hinge", "parent": "base", "child": "rod", **kind, **frame, **own, **joint}],
                "links": [{"name": "rod", "mass_kg": 1.0, "com_m": [0.3, 0, 0], "inertia_kg_m2": tensor}],
            },
            "one",
        )
    )

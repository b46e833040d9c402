"""Arms with dry friction and lossy gears that stick, for tests."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from armwright.description.database import parse
from armwright.model import Model, build_model
from armwright.model.drive import Friction

UNIT = {"xx": 1, "xy": 0, "xz": 0, "yy": 1, "yz": 0, "zz": 1}


def block(mass: float = 1.0, weight: float = 0.0, friction: Friction | None = None, **changes: Any) -> Model:
    """A block on a slide along z, pulled back by `weight`, with a motor of ratio 1; changes of its joint and drive by name."""
    slide = {"name": "slide", "type": "prismatic", "command": "torque", "parent": "base", "child": "block"}
    frame = {"frame": {"xyz_m": [0, 0, 0], "rpy_rad": [0, 0, 0]}, "axis": [0, 0, 1]}
    robot = {
        "name": "block",
        "source": "definition",
        "gravity_m_s2": [0.0, 0.0, -weight / mass],
        "joints": [{**slide, **frame, "motor": {"gear_ratio": 1.0, "rotor_inertia_kg_m2": 0.0}}],
        "links": [{"name": "block", "mass_kg": mass, "com_m": [0, 0, 0], "inertia_kg_m2": UNIT}],
    }
    model = build_model(parse(robot, "block"))
    (body,) = model.bodies
    of_body = {name: changes.pop(name) for name in ("elasticity", "brake", "spring") if name in changes}
    body = replace(body, friction=friction, drive=replace(body.drive, **changes), **of_body)
    return replace(model, bodies=(body,))


def dry(level: float, **others: Any) -> Friction:
    """Coulomb friction without a smoothing speed."""
    return Friction(coulomb_positive=level, coulomb_negative=level, **others)


def sticking(model: Model, levels: np.ndarray, efficiency: float | None = None, on_motor: bool = False) -> Model:
    """The arm with dry friction of these levels in every joint, and lossy gears."""
    bodies = []
    moving = iter(levels)
    for body in model.bodies:
        drive = replace(body.drive, smoothing=None, efficiency=efficiency)
        bodies.append(replace(body, friction=dry(float(next(moving)), on_motor=on_motor), drive=drive))
    return replace(model, bodies=tuple(bodies))

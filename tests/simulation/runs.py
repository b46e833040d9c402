"""Runs that were never simulated: a dataset with every feature that files and pictures must carry."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from armwright.description.database import read_toml
from armwright.model import Model, build_model
from armwright.results.recording import make_dataset

MIXED = """
name = "lathe"
title = "A turning base, a slide and a hinge, each driven in its own way"
source = "estimate"
tip = "hand"
[[joints]]
name = "turn"
type = "revolute"
parent = "base"
child = "column"
command = "voltage"
frame = { xyz_m = [0, 0, 0], rpy_rad = [0, 0, 0] }
axis = [0, 0, 1]
[joints.motor]
gear_ratio = 50
rotor_inertia_kg_m2 = 1e-4
torque_constant_n_m_per_a = 0.1
resistance_ohm = 2.0
[[joints]]
name = "slide"
type = "prismatic"
parent = "column"
child = "carriage"
command = "torque"
dh = { alpha_rad = 0.5, theta_rad = 0.25, a_m = 0.1, offset_m = 0.2 }
[joints.limits]
position_m = [-0.1, 0.6]
[[joints]]
name = "hinge"
type = "revolute"
parent = "carriage"
child = "hand"
command = "current"
modified_dh = { alpha_rad = 0, r_m = 0.3, a_m = 0, offset_rad = -0.5 }
[joints.motor]
gear_ratio = -10
rotor_inertia_kg_m2 = 0
torque_constant_n_m_per_a = 0.2
[[links]]
name = "column"
mass_kg = 5
com_m = [0, 0, 0.1]
inertia_kg_m2 = { xx = 0.1, xy = 0, xz = 0, yy = 0.1, yz = 0, zz = 0.1 }
[[links]]
name = "carriage"
mass_kg = 2
com_m = [0, 0, 0]
inertia_kg_m2 = { xx = 0.1, xy = 0, xz = 0, yy = 0.1, yz = 0, zz = 0.1 }
[[links]]
name = "hand"
mass_kg = 1
com_m = [0, 0, 0]
inertia_kg_m2 = { xx = 0.1, xy = 0, xz = 0, yy = 0.1, yz = 0, zz = 0.1 }
"""


def mixed_file(folder: Path) -> Path:
    """A robot file with joints of both kinds, three ways to place them and three ways to drive them."""
    path = folder / "lathe.toml"
    path.write_text(MIXED, encoding="utf-8")
    return path


def mixed_arm(folder: Path) -> Model:
    """That robot."""
    return build_model(read_toml(mixed_file(folder)))


def invented(arm: Model, lanes: int | None = None, rows: int = 41):
    """A run of smooth invented numbers, (rows, n) or (lanes, rows, n)."""
    t = np.linspace(0.0, 2.0, rows)
    phase = np.arange(arm.n) + 0.1 * np.arange(lanes or 1)[:, None, None]
    q = np.sin(t[:, None] + phase)
    shape = (lambda values: values) if lanes else (lambda values: values[0])
    parts = {"qdd": 3 * q, "tau": 4 * q, "voltage": 5 * q, "current": 6 * q}
    attrs = {"step_s": 1e-3, "notes": ["turn: first", "slide: second"]}
    return make_dataset(
        arm,
        t,
        shape(q),
        shape(2 * q),
        shape(7 * q),
        **{name: shape(values) for name, values in parts.items()},
        attrs=attrs,
    )

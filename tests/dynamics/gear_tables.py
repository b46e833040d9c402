"""Arms whose gears lose power by tables of their efficiency and by friction that is proportional to their load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from armwright.description.database import parse
from armwright.model import Model, build_model
from physics.arms import workshop

TORQUES = (4.0, 10.0, 25.0, 60.0)
ROWS = (  # two speeds; driven back they lose more
    {
        "speed_rad_per_s": 0.2,
        "driving": (0.35, 0.6, 0.72, 0.8),
        "driven_back": (0.2, 0.45, 0.65, 0.75),
    },
    {
        "speed_rad_per_s": 1.5,
        "driving": (0.3, 0.5, 0.68, 0.77),
        "driven_back": (0.15, 0.4, 0.6, 0.7),
    },
)
TABLE = {"torque_n_m": list(TORQUES), "rows": [dict(row) for row in ROWS]}
LINEAR_TABLE = {"force_n": [20.0, 90.0], "rows": [{"driving": [0.5, 0.75]}]}


def workshop_record() -> dict[str, Any]:
    """`workshop` with tables on a turn and on the slide, and load-proportional friction on either side of a gear."""
    robot = workshop()
    robot["name"] = "worn"
    turn, slide, _, geared, bare = robot["joints"][:5]
    for joint, table in ((turn, TABLE), (slide, LINEAR_TABLE)):
        del joint["motor"]["gear_efficiency"]
        joint["motor"]["gear_efficiency_table"] = table
    turn["friction"]["load_coefficient"] = 0.1
    geared["friction"]["load_coefficient"] = 0.3  # the motor's, before an efficiency
    smooth = {"coulomb_positive_n_m": 0.0, "coulomb_negative_n_m": 0.0, "smoothing_rad_per_s": 0.05}
    bare["friction"] = {**smooth, "load_coefficient": 0.25}  # and nothing else
    return robot


def worn() -> Model:
    """The model of that."""
    return build_model(parse(workshop_record(), "worn"))


def lift(motor: dict[str, Any], load: float | None = None, **joint: Any) -> Model:
    """A load of 0.3 kg on a vertical spindle that 6 N pull down, before a rotor of 0.1 kg; its gear turns as it slides."""
    friction: dict[str, Any] = {"coulomb_positive_n": 0.0, "coulomb_negative_n": 0.0, "smoothing_m_per_s": 1e-7}
    friction |= {} if load is None else {"load_coefficient": load}
    slide = {"name": "spindle", "type": "prismatic", "command": "torque", "parent": "base", "child": "load"}
    frame = {"frame": {"xyz_m": [0, 0, 0], "rpy_rad": [0, 0, 0]}, "axis": [0, 0, 1]}
    tensor = {"xx": 1, "xy": 0, "xz": 0, "yy": 1, "yz": 0, "zz": 1}
    drive = {"gear_ratio": 50.0, "rotor_inertia_kg_m2": 4e-5, **motor}
    robot = {
        "name": "lift",
        "source": "definition",
        "gravity_m_s2": [0.0, 0.0, -20.0],
        "joints": [{**slide, **frame, "motor": drive, "friction": friction, **joint}],
        "links": [{"name": "load", "mass_kg": 0.3, "com_m": [0, 0, 0], "inertia_kg_m2": tensor}],
    }
    return build_model(parse(robot, "lift"))


def efficiencies(speed: float, column: str) -> Sequence[float]:
    """η of `ROWS` at a speed, by hand."""
    low, high = (row["speed_rad_per_s"] for row in ROWS)
    part = min(max((abs(speed) - low) / (high - low), 0.0), 1.0)
    return [(1.0 - part) * a + part * b for a, b in zip(ROWS[0][column], ROWS[1][column], strict=True)]

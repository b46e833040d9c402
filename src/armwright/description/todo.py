"""Numbers of a robot file that are still to be filled in, "TODO": what is wanted, and where a datasheet has it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from armwright.description.paths import unit_at
from armwright.description.robot import RobotDescription
from armwright.errors import TO_FILL_IN, Problem
from armwright.validation import Location, described_field, place_of

TODO = "TODO"
_CAD = "CAD, in the link's frame, which is that of its joint"
_MEASURED = (
    "seldom on a datasheet; `armwright identify friction` measures it, and without [joints.friction] there is none"
)
WHERE = {  # key → where to find it
    "text": "maker, type and date of the datasheet",
    "command": '"voltage", "current" or "torque": kind of command that the drive takes',
    "gear_ratio": 'datasheet of the gear: "ratio", "reduction" or i, times those of belts; 1 for a direct drive',
    "rotor_inertia_kg_m2": 'datasheet of the motor: "rotor inertia" or J; 1 g cm² = 1e-7 kg m²',
    "torque_constant_n_m_per_a": 'datasheet of the motor: "torque constant", Kt or kM; 1 mN m/A = 1e-3 N m/A',
    "resistance_ohm": 'datasheet of the motor: "terminal resistance" or R; between two phases with basis = "line_rms"',
    "voltage_v": 'datasheet of the drive: "supply voltage" or "output voltage"',
    "current_a": 'datasheet of the drive: "peak output current"; of the motor: "maximum current"; the smaller of the two',
    "position_rad": "datasheet of the arm: range of the joint; 1° = 0.0174533 rad; no such line if it turns without end",
    "position_m": "datasheet of the arm: travel of the joint",
    "velocity_rad_per_s": "datasheet of the arm, or the motor's largest speed over the gear ratio; 1 rpm = 0.10472 rad/s",
    "velocity_m_per_s": "datasheet of the arm, or the motor's largest speed over the gear ratio",
    "torque_n_m": 'datasheet of the gear: "repeated peak torque"; or Kt · current · ratio',
    "force_n": "datasheet of the axis, or Kt · current · ratio",
    **dict.fromkeys(("viscous_n_m_s_per_rad", "viscous_n_s_per_m"), _MEASURED),
    **dict.fromkeys(
        ("coulomb_positive_n_m", "coulomb_negative_n_m", "coulomb_positive_n", "coulomb_negative_n"), _MEASURED
    ),
    "mass_kg": "CAD, scales, or the arm's datasheet",
    "com_m": _CAD,
    "inertia_kg_m2": "CAD, about the centre of mass in link axes; xy = −∫ x y dm, and xz, yz likewise",
    "xyz_m": "drawing or CAD: distances along the axes of that frame, with the arm at q = 0",
    "axis": "drawing or CAD: [0, 0, 1] is z of this joint's frame",
}


def todo_problems(data: Any) -> list[Problem]:
    """A problem for each value "TODO" of a robot file.

    Args:
        data: the document.
    """
    return [_problem(location, data) for location in _todos(data, ())]


def _todos(value: Any, at: Location) -> Iterator[Location]:
    if isinstance(value, str) and value == TODO:
        yield at
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in pairs:
        yield from _todos(inner, (*at, key))


def _problem(location: Location, data: Any) -> Problem:
    if location[-1] == "value" and len(location) > 1:  # { value = "TODO", source = … }
        location = location[:-1]
    keys = [key for key in location if isinstance(key, str)]
    key = next((key for key in reversed(keys) if key in WHERE), keys[-1])
    wanted, about = described_field(location, RobotDescription)
    unit = unit_at(".".join(["x", *keys]))
    parts = (f"{wanted}{'' if unit == '1' else f' [{unit}]'}", about.rstrip("."), WHERE.get(key, ""))
    return Problem(TO_FILL_IN, place_of(location, data), TODO, expected="; ".join(filter(None, parts)))

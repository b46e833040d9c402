"""Records of motors without an arm: on a bench, detached, or with their rotor locked."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from armwright.description.database import parse
from armwright.description.robot import RobotDescription
from armwright.description.writer import to_toml
from armwright.errors import ModelError
from armwright.joint_kinds import KINDS

BENCH = "bench"  # key of the source of a number that no robot's record has
LOCKED = 1e9  # [kg m²] that a locked rotor turns: no motor moves it
AS = {False: "revolute", True: "prismatic"}  # joints that turn or move a constant inertia, by their units
KEPT = ("name", "type", "source", "motor", "friction", "limits", "elasticity", "command")
ABOUT = {"kind": "estimate", "text": "assumed by armwright identify motor; the log does not determine it"}


def bench_record(joint: str, command: str, locked: bool = False, ratio: float = 1.0) -> RobotDescription:
    """A record of one motor with a known gear; its rotor has all of the inertia, other numbers are guessed later."""
    motor = {"gear_ratio": ratio, "rotor_inertia_kg_m2": 1.0, "torque_constant_n_m_per_a": 1.0, "resistance_ohm": 1.0}
    friction = {"viscous_n_m_s_per_rad": 0.0, "coulomb_positive_n_m": 0.0, "coulomb_negative_n_m": 0.0}
    own = {"name": joint, "type": "revolute", "motor": motor, "friction": friction}
    loads = {joint: LOCKED if locked else 0.0}
    return _bench_record([own], loads, command, {"sources": {BENCH: ABOUT}, "source": BENCH}, "bench")


def decoupled_record(record: RobotDescription, joints: Sequence[str], loads: Mapping[str, float]) -> RobotDescription:
    """The record's motors, gears and friction without the arm: every joint turns a constant inertia about its axis.

    Springs, stops, brakes and couplings stay with the arm. Without an inertia an elastic gear has nothing to bend against, and
    is rigid.

    Args:
        record: of the arm.   joints: whose motors.   loads: by joint, what it turns behind its gear [kg m² | kg]; 0: nothing.
    Raises:
        ModelError: a joint without a motor, or one that turns nothing at all.
    """
    document = tomllib.loads(to_toml(record))
    tables = {each["name"]: each for each in document["joints"]}
    chosen = []
    for name in joints:
        own = {key: value for key, value in tables[name].items() if key in KEPT}
        if "motor" not in own:
            raise ModelError("has no motor in the record", place=f"joint {name!r}", expected="a table motor")
        rotor = own["motor"].get("rotor_inertia_kg_m2", 0.0)
        if loads[name] == 0.0:
            if (rotor["value"] if isinstance(rotor, dict) else rotor) == 0.0:
                what = "turns nothing: its rotor inertia is 0 in the record, as of a direct drive"
                raise ModelError(what, place=f"joint {name!r}", expected="load=…, the inertia that it turned")
            own.pop("elasticity", None)
        own["type"] = AS[KINDS[own["type"]].units.linear]
        own["motor"] = {key: value for key, value in own["motor"].items() if key != "coupling"}
        own["limits"] = {
            key: value
            for key, value in own.get("limits", {}).items()
            if not key.startswith(("position", "velocity", "acceleration"))
        }
        chosen.append(own)
    kept = {key: document[key] for key in ("source", "sources") if key in document}
    return _bench_record(chosen, loads, document.get("command", "voltage"), kept, record.name)


def _bench_record(
    joints: Sequence[dict[str, Any]], loads: Mapping[str, float], command: str, more: Mapping[str, Any], name: str
) -> RobotDescription:
    """A record of joints side by side on the base, each with an inertia about its axis."""
    tables, links = [], []
    for own in joints:
        load = loads[own["name"]]
        linear, child = KINDS[own["type"]].units.linear, f"{own['name']}_load"
        about = 0.0 if linear else load  # of a ball: a plate that turns about one axis alone is no body
        inertia = {"xx": about, "yy": about, "zz": about, "xy": 0.0, "xz": 0.0, "yz": 0.0}
        mass = load if linear else float(load > 0.0)
        links.append({"name": child, "mass_kg": mass, "com_m": [0.0, 0.0, 0.0], "inertia_kg_m2": inertia})
        frame = {"xyz_m": [0.0, 0.0, 0.0], "rpy_rad": [0.0, 0.0, 0.0]}
        tables.append({**own, "parent": "base", "child": child, "axis": [0.0, 0.0, 1.0], "frame": frame})
    document = {
        "name": name, "notes": "Motors by themselves.", "gravity_m_s2": [0.0, 0.0, 0.0], "command": command,
        "joints": tables, "links": links, **more,
    }  # fmt: skip
    document.setdefault("source", BENCH)
    document["sources"] = {BENCH: ABOUT, **document.get("sources", {})}
    return parse(document, "the record of a motor")

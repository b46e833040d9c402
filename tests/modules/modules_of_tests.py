"""A small module library, as a TOML document, that tests change in places."""

from __future__ import annotations

import copy
from typing import Any

FLAT = {"xyz_m": [0.0, 0.0, 0.0], "rpy_rad": [0.0, 0.0, 0.0]}


def frame(*xyz: float, rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> dict[str, Any]:
    return {"xyz_m": list(xyz), "rpy_rad": list(rpy)}


def body(name: str, mass: float = 1.0, com: tuple[float, ...] = (0.0, 0.0, 0.1), **more: Any) -> dict[str, Any]:
    tensor = {"xx": 0.02, "xy": 0.001, "xz": -0.002, "yy": 0.03, "yz": 0.0015, "zz": 0.025}
    fields = {"name": name, "mass_kg": mass, "com_m": list(com), "inertia_kg_m2": tensor, "inertia_about": "com"}
    return {**fields, **more}


def connector(name: str, on: str, gender: str, at: dict[str, Any], steps: int = 4, **more: Any) -> dict[str, Any]:
    fields = {
        "name": name,
        "body": on,
        "kind": "bolt",
        "size": "40",
        "gender": gender,
        "frame": at,
        "angle_steps": steps,
    }
    return {**fields, **more}


def joint(name: str, parent: str, child: str, at: dict[str, Any], axis: list[float], **more: Any) -> dict[str, Any]:
    fields = {"name": name, "type": "revolute", "parent": parent, "child": child, "frame": at, "axis": axis}
    limits = {
        "position_rad": [-3.0, 3.0],
        "torque_n_m": 60.0,
        "velocity_rad_per_s": 2.0,
        "acceleration_rad_per_s2": 5.0,
    }
    return {**fields, "limits": limits, **more}


def library() -> dict[str, Any]:
    """A foot, an elbow with one joint, a straight link, a hand, and an elbow whose connectors fit either way."""
    elbow = [body("lower"), body("upper", 0.8, (0.02, -0.03, 0.05), inertia_about="frame")]
    document = {
        "name": "toy",
        "source": "definition",
        "command": "torque",
        "modules": [
            {
                "name": "foot",
                "ground": "floor",
                "bodies": [body("plate", 2.0)],
                "connectors": [
                    connector("floor", "plate", "f", FLAT, kind="floor", flipped=True),
                    connector("top", "plate", "m", frame(0.0, 0.0, 0.2)),
                ],
            },
            {
                "name": "elbow",
                "available": 2,
                "bodies": elbow,
                "joints": [
                    joint(
                        "turn", "lower", "upper", frame(0.0, 0.0, 0.15), [0.0, 1.0, 0.0],
                        child_frame=frame(0.0, 0.02, 0.1, rpy=(0.3, -0.2, 0.5)),
                    )
                ],
                "connectors": [
                    connector("in", "lower", "f", FLAT, flipped=True),
                    connector("out", "upper", "m", frame(0.0, 0.0, 0.2, rpy=(0.0, 0.4, 0.0))),
                ],
            },
            {
                "name": "bar",
                "available": 1,
                "bodies": [body("tube", 0.5)],
                "connectors": [
                    connector("in", "tube", "f", FLAT, flipped=True),
                    connector("out", "tube", "m", frame(0.0, 0.0, 0.3)),
                ],
            },
            {
                "name": "hand",
                "available": 1,
                "bodies": [body("palm", 0.4, (0.0, 0.0, 0.03))],
                "connectors": [
                    connector("in", "palm", "f", FLAT, flipped=True, steps=2),
                    connector("grip", "palm", "m", frame(0.0, 0.0, 0.1), kind="grip"),
                ],
            },
            {
                "name": "either",
                "bodies": copy.deepcopy(elbow),
                "joints": [joint("turn", "lower", "upper", frame(0.0, 0.05, 0.15), [0.0, 0.6, 0.8])],
                "connectors": [
                    connector("a", "lower", "n", frame(0.01, 0.0, 0.0, rpy=(3.141592653589793, 0.0, 0.0)), kind="ring"),
                    connector("b", "upper", "n", frame(0.0, 0.02, 0.2, rpy=(0.1, 0.2, 0.3)), kind="ring"),
                ],
            },
        ],
    }  # fmt: skip
    return copy.deepcopy(document)


def assembly(*modules: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"name": "arm", "source": "definition", "libraries": ["toy"], "modules": list(modules), **more}


def put(module: str, on: str | None = None, angle: float | None = 0.0, **more: Any) -> dict[str, Any]:
    given = {"module": module, "on": on, "angle_rad": angle if on else None, **more}
    return {key: value for key, value in given.items() if value is not None}

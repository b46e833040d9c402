"""The bench of a servo as an arm: a pendulum whose joint follows goals by the firmware's loop.

    (m l² + m_a l² / 3 + J) q̈ = τ_m + τ_e - friction,   τ_e = -(m + m_a / 2) g l sin(q + q_offset)

with a mass m at the tip of a uniform rod of mass m_a and length l, downward at 0. τ_m = K_t (V - K_t q̇) / R of a duty times the
supply, or K_t i of a current. [DuclusaudEtAl2025]
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any, Literal

import numpy as np

from armwright.description.database import parse
from armwright.description.robot import RobotDescription
from armwright.errors import LogError, ModelError, check_known
from armwright.identification.servo.bench_log import BenchLog
from armwright.scalar import real_number

GRAVITY = 9.80665  # standard: a log does not say where it is from
JOINT, ROD = "servo", "rod"
MOTOR = {"kt": "torque_constant_n_m_per_a", "R": "resistance_ohm", "J": "rotor_inertia_kg_m2"}
FRICTION = {
    "viscous": "viscous_n_m_s_per_rad",
    "coulomb": "coulomb_positive_n_m",
    "coulomb_back": "coulomb_negative_n_m",
    "still": "stribeck_torque_n_m",
    "stribeck_speed": "stribeck_speed_rad_per_s",
    "exponent": "stribeck_exponent",
    "load_motor": "load_motor",
    "load_external": "load_external",
    "load_motor_still": "load_motor_stribeck",
    "load_external_still": "load_external_stribeck",
    "square_motor": "load_motor_quadratic_per_n_m",
    "square_external": "load_external_quadratic_per_n_m",
}
FIRMWARE = {"gain": "p_scale_per_rad", "goal_speed": "goal_speed_rad_per_s"}
PATHS = {
    name: f"{JOINT}.{table}.{key}"
    for table, keys in (("motor", MOTOR), ("friction", FRICTION), ("firmware", FIRMWARE))
    for name, key in keys.items()
}


@dataclass(frozen=True)
class ServoLoop:
    """The position loop of a servo, as far as it is known before a fit.

    Args:
        p_scale_per_rad: output per radian and unit of P.   output_limit: of the duty, at most 1, or of the current [A].
        output: "duty", of the supply's voltage, or "current".   goal_speed_rad_per_s: with which the goal moves; None: it jumps.
        d_scale_s_per_rad: output per rad/s of the error's derivative; 0: none.   period_s: of the loop.
        source: of these numbers.
    Raises:
        ModelError: names the field.
    Example:
        >>> loop = aw.identification.ServoLoop(p_scale_per_rad=0.16, output="duty")
        >>> loop.output_limit
        1.0
    """

    p_scale_per_rad: float
    output_limit: float = 1.0
    output: Literal["duty", "current"] = "duty"
    goal_speed_rad_per_s: float | None = None
    d_scale_s_per_rad: float = 0.0
    period_s: float = 1e-3
    source: str = ""

    def __post_init__(self) -> None:
        for name in ("p_scale_per_rad", "output_limit", "goal_speed_rad_per_s", "period_s"):
            value = getattr(self, name)
            number = real_number(value)
            if value is not None and (number is None or not number > 0.0):
                raise ModelError(place=name, value=value, expected="a number above 0")
        check_known(ModelError, self.output, ("duty", "current"), place="output")


def known_loops() -> dict[str, ServoLoop]:
    """Loops of servos by the name that logs have for them."""
    text = (resources.files("armwright.identification.servo") / "loops.toml").read_text(encoding="utf-8")
    return {name: ServoLoop(**table) for name, table in tomllib.loads(text).items()}


def loop_of(logs: Sequence[BenchLog], loop: ServoLoop | None) -> ServoLoop:
    """The given loop, or the known one of the logs' servo.

    Raises:
        LogError: the logs' servo is not known.
    """
    if loop is not None:
        return loop
    name, known = next((each.servo for each in logs if each.servo), ""), known_loops()
    if name not in known:
        what = "a servo whose loop is not known"
        expected = "loop=aw.identification.ServoLoop(…) (--duty-gain, --max-duty)"
        raise LogError(what, place="motor", value=name, expected=expected, choices=known, file=logs[0].name)
    return known[name]


def bench_record(log: BenchLog, loop: ServoLoop, numbers: Mapping[str, float], offset: float = 0.0) -> RobotDescription:
    """The bench of a log as a robot's record.

    Args:
        log: whose mass and length it has, and P.   loop: of the servo.
        numbers: values of `PATHS` by name; those that the loop lacks are left out.   offset: q_offset [rad].
    """
    current = loop.output == "current"
    of_motor = {key: numbers[name] for name, key in MOTOR.items() if not (current and name == "R")}
    firmware: dict[str, Any] = {"period_s": loop.period_s, "output": loop.output, "output_limit": loop.output_limit}
    firmware |= {"p": log.p, "p_scale_per_rad": numbers["gain"]}
    if loop.goal_speed_rad_per_s is not None:
        firmware["goal_speed_rad_per_s"] = numbers["goal_speed"]
    if loop.d_scale_s_per_rad:
        firmware |= {"d": 1.0, "d_scale_s_per_rad": loop.d_scale_s_per_rad}
    rod = link_numbers(log, offset)
    tensor = dict.fromkeys(("xx", "yy"), float(rod["inertia"])) | dict.fromkeys(("zz", "xy", "xz", "yz"), 0.0)
    joint = {
        "name": JOINT, "type": "revolute", "parent": "base", "child": ROD, "axis": [0.0, -1.0, 0.0],
        "frame": {"xyz_m": [0.0] * 3, "rpy_rad": [0.0] * 3}, "command": "position",
        "motor": {"gear_ratio": 1.0, **of_motor},
        "limits": {"voltage_v": float(np.median(log.supply))},
        "friction": {"law": "load-dependent", **{key: numbers[name] for name, key in FRICTION.items()}},
        "firmware": firmware,
    }  # fmt: skip
    link = {"name": ROD, "mass_kg": float(rod["mass"]), "com_m": [float(rod["x"]), 0.0, float(rod["z"])]}
    about = {"kind": "estimate", "text": "identify servo: a guess, or not determined by its logs"}
    document = {
        "name": "bench", "sources": {"bench": about}, "source": "bench", "gravity_m_s2": [0.0, 0.0, -GRAVITY], "tip": ROD,
        "joints": [joint], "links": [link | {"inertia_kg_m2": tensor}],
    }  # fmt: skip
    return parse(document, "bench")


def link_numbers(log: BenchLog, offset: np.ndarray | float = 0.0) -> dict[str, Any]:
    """Mass [kg], centre of mass x and z [m], and inertia about it [kg m²] of the rod with its mass, turned by `offset` [rad]."""
    arm = log.arm_mass or 0.0
    mass, moment = log.mass + arm, (log.mass + arm / 2.0) * log.length
    centre = moment / mass
    inertia = (log.mass + arm / 3.0) * log.length**2 - mass * centre**2
    x, z = centre * np.sin(offset), -centre * np.cos(offset)
    return {"mass": mass, "x": x, "z": z, "inertia": max(inertia, 0.0) + 0.0 * x}


def with_arm_mass(logs: Sequence[BenchLog], arm_mass: float | None) -> tuple[tuple[BenchLog, ...], list[str]]:
    """The logs with the mass of the rod where they do not say it, and a remark about that."""
    if arm_mass is not None and not arm_mass >= 0.0:
        raise ModelError(place="arm_mass", value=arm_mass, expected="a number of 0 or more [kg]")
    silent = [each for each in logs if each.arm_mass is None]
    if not silent:
        return tuple(logs), []
    value = 0.0 if arm_mass is None else float(arm_mass)
    changed = tuple(replace(each, arm_mass=value) if each.arm_mass is None else each for each in logs)
    if arm_mass is not None:
        return changed, []
    many = "no log states" if len(silent) == len(logs) else f"{len(silent)} of {len(logs)} logs do not state"
    return changed, [
        f"{many} the mass of the rod: 0 is taken, and what it weighs goes into the other numbers (--arm-mass)"
    ]

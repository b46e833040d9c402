"""Robots that people begin with: a geared motor, a plain arm from datasheets, and a UR5 with drives of their own choice."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

import numpy as np

import armwright as aw
from armwright.description.database import parse
from armwright.model import Model, build_model
from reference.example_robots import robot_files

GEARED_MOTOR = """
# 24 V, 200 : 1. Its mechanical time constant J R / (n Kt)² is 0.24 · 1.2 / 12² s = 2 ms, its speed at 24 V is 2 rad/s.
name = "geared-motor"
command = "voltage"
source = "datasheet"
gravity_m_s2 = [0, 0, 0]

[[joints]]
name = "axis"
type = "revolute"
parent = "base"
child = "load"
frame = { xyz_m = [0, 0, 0], rpy_rad = [0, 0, 0] }
axis = [0, 0, 1]

[joints.motor]
gear_ratio = 200.0
rotor_inertia_kg_m2 = 4e-6
torque_constant_n_m_per_a = 0.06
resistance_ohm = 1.2

[[links]]
name = "load"
mass_kg = 2.0
com_m = [0, 0, 0]
inertia_kg_m2 = { xx = 0.05, yy = 0.05, zz = 0.08, xy = 0, xz = 0, yz = 0 }
"""

PLAIN_JOINT = """
[[joints]]
name = "{name}"
type = "revolute"
parent = "{parent}"
child = "{child}"
frame = {{ xyz_m = [{x}, 0, 0], rpy_rad = [0, 0, 0] }}
axis = [0, 1, 0]

[joints.limits]
voltage_v = 12.0

[joints.motor]
gear_ratio = 131.0
rotor_inertia_kg_m2 = 5e-6
torque_constant_n_m_per_a = 0.018
resistance_ohm = 2.2
gear_efficiency = 0.6

[joints.friction]
coulomb_positive_n_m = 0.25
coulomb_negative_n_m = 0.25
{smoothing}

[[links]]
name = "{child}"
mass_kg = 0.6
com_m = [0.12, 0, 0]
inertia_kg_m2 = {{ xx = 1e-4, yy = 3e-3, zz = 3e-3, xy = 0, xz = 0, yz = 0 }}
"""

UR5_DRIVES = """
# Brushless motors as DC equivalents, estimated; harmonic drives of 101 : 1. Those of the wrists have a time constant of 0.8 ms.
source = "estimate"
command = "voltage"
"""
UR5_DRIVE = """
[joints.{joint}]
limits = {{ voltage_v = 48.0 }}
motor = {{ gear_ratio = 101.0, rotor_inertia_kg_m2 = {j}, torque_constant_n_m_per_a = {kt}, resistance_ohm = {r} }}
"""
UR5_GOAL = np.array([0.6, -1.0, 0.8, 0.5, -0.4, 0.7])


def geared_motor() -> Model:
    """One joint with a motor."""
    return built(GEARED_MOTOR)


def plain_arm(smoothing: float | None = None) -> Model:
    """Two links with geared motors of 12 V, an efficiency and a dry friction each; rad/s over which both are smoothed."""
    text = 'name = "plain"\ncommand = "voltage"\nsource = "datasheet"\ngravity_m_s2 = [0, 0, -9.81]\n'
    line = "" if smoothing is None else f"smoothing_rad_per_s = {smoothing}"
    for name, parent, child, x in (("shoulder", "base", "upper", 0.0), ("elbow", "upper", "fore", 0.25)):
        text += PLAIN_JOINT.format(name=name, parent=parent, child=child, x=x, smoothing=line)
    return built(text)


def built(text: str) -> Model:
    """The arm of a robot file's text."""
    return build_model(parse(tomllib.loads(text), "text"))


def ur5(folder: Path) -> Model | None:
    """The UR5 of the `example-robot-data` wheel with drives, copied into a folder; None where that is not installed."""
    file = robot_files().get("ur_description/urdf/ur5_robot.urdf")
    if file is None:
        return None
    text = UR5_DRIVES
    for joint in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"):
        kt, r, j = (0.0925, 0.55, 1.1e-5) if "wrist" in joint else (0.127, 0.35, 6e-5)
        text += UR5_DRIVE.format(joint=f"{joint}_joint", kt=kt, r=r, j=j)
    (folder / "ur5.drive.toml").write_text(text, encoding="utf-8")
    return aw.load(shutil.copy(file, folder / "ur5.urdf"))


def ur5_under_pid(arm: Model, solver: aw.Solver) -> aw.Scenario:
    """The UR5 on its way to a goal close by, under a PID controller of 2 ms."""
    pid = aw.JointPID(kp=[600.0, 600.0, 400.0, 200.0, 200.0, 200.0], kd=[20.0, 20.0, 15.0, 4.0, 4.0, 6.0])
    start = aw.Start(UR5_GOAL - 0.02)
    return aw.Scenario(arm, 0.4, loop=aw.Loop(pid, UR5_GOAL, period=2e-3), start=start, solver=solver)

"""Logs with known truth: a motion of two joints in closed form, its torques, and the files that a logger would write."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from armwright.results.csv_tables import write_table

RATE = 500.0
HEAD = """
title = "Two joints"
joints = ["shoulder", "elbow"]
[files.arm]
path = "arm.csv"
[time]
column = "t"
unit = "s"
"""
POSITIONS = """
[[signals]]
quantity = "position"
columns = ["q1", "q2"]
unit = "rad"
side = "joint"
"""
SPEEDS = """
[[signals]]
quantity = "speed"
columns = ["v1", "v2"]
unit = "rad/s"
side = "joint"
"""
TORQUES = """
[[signals]]
quantity = "torque"
columns = ["m1", "m2"]
unit = "N m"
side = "joint"
"""
ALL = HEAD + POSITIONS + SPEEDS + TORQUES


def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """q, q̇, q̈ and torques (rows, 2) of a multisine that ends where it began; each joint has inertia, friction and gravity."""
    waves = (
        ((0.5, 2 * np.pi * 0.5, 0.3), (0.2, 2 * np.pi * 1.5, 1.0)),
        ((0.4, 2 * np.pi * 0.25, 0.0), (0.15, 2 * np.pi * 1.25, 2.0)),
    )
    q = np.stack([sum(a * np.sin(w * t + p) for a, w, p in wave) for wave in waves], axis=1)
    qd = np.stack([sum(a * w * np.cos(w * t + p) for a, w, p in wave) for wave in waves], axis=1)
    qdd = np.stack([sum(-a * w**2 * np.sin(w * t + p) for a, w, p in wave) for wave in waves], axis=1)
    tau = [0.8, 0.3] * qdd + [1.5, 0.6] * qd + [2.0, 0.7] * np.tanh(qd / 0.05) + [9.0, 3.0] * np.sin(q)
    return q, qd, qdd, tau


def columns(seconds: float = 8.0, rate: float = RATE) -> dict[str, np.ndarray]:
    """Columns of the log that `ALL` describes."""
    t = np.arange(round(seconds * rate) + 1) / rate
    q, qd, _, tau = motion(t)
    return {"t": t, "q1": q[:, 0], "q2": q[:, 1], "v1": qd[:, 0], "v2": qd[:, 1], "m1": tau[:, 0], "m2": tau[:, 1]}


def written(folder: Path, text: str, tables: Mapping[str, Mapping[str, np.ndarray]] | None = None) -> Path:
    """Path of a log file that describes CSV files beside it; by default `arm.csv` with `columns()`."""
    for name, table in (tables or {"arm.csv": columns()}).items():
        write_table(folder / name, table)
    path = folder / "two.log.toml"
    path.write_text(text, encoding="utf-8")
    return path


JOINT_STATE = (
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    "================================================================================\nMSG: std_msgs/Header\n"
    "builtin_interfaces/Time stamp\nstring frame_id\n"
    "================================================================================\nMSG: builtin_interfaces/Time\n"
    "int32 sec\nuint32 nanosec\n"
)


def write_joint_states(path: Path, names: list[str], t: np.ndarray, q: np.ndarray, qd: np.ndarray, tau: np.ndarray):
    """Writes an MCAP recording of `sensor_msgs/JointState`; its messages list the joints in any order."""
    from mcap_ros2.writer import Writer

    begin = 1_700_000_000 * 10**9 + 123_456_789
    with path.open("wb") as file:
        mcap = Writer(file)
        schema = mcap.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for k in range(len(t)):
            stamp = begin + round(1e9 * t[k])
            order = list(range(len(names)))[:: 1 if k % 2 else -1]
            message = {
                "header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""},
                "name": [names[j] for j in order],
                "position": q[k, order].tolist(), "velocity": qd[k, order].tolist(), "effort": tau[k, order].tolist(),
            }  # fmt: skip
            mcap.write_message("/joint_states", schema, message, log_time=stamp, publish_time=stamp)
        mcap.finish()

"""Logs with known truth: a motion of two joints in closed form, its torques, and the files that a logger would write."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from armwright.results.tables import write_table

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

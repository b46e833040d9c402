"""Logs of arms that move along known multisines, with noise, written and read as a user's would be."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import armwright as aw
from armwright.identification.logs.log import Log
from armwright.results.csv_tables import write_table

FILE = """
title = "{name}"
joints = {joints}
[files.log]
path = "{name}.csv"
[time]
column = "t"
unit = "s"
"""
SIDE = 'side = "joint"'
SIGNAL = """
[[signals]]
quantity = "{quantity}"
columns = {columns}
unit = "{unit}"
{side}
"""


def multisine(n: int, seconds: float, rate: float, seed: int, size: float = 1.0, harmonics: int = 5):
    """t, q, q̇, q̈ of random Fourier series with the period of the whole log."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    w = 2 * np.pi / seconds * np.arange(1, harmonics + 1)
    phase = w * t[:, None]
    a, b = size * rng.normal(size=(2, harmonics, n)) / np.sqrt(np.arange(1, harmonics + 1))[:, None]
    q = np.sin(phase) @ a + np.cos(phase) @ b + rng.uniform(-0.5, 0.5, n)
    qd = (w * np.cos(phase)) @ a - (w * np.sin(phase)) @ b
    qdd = -(w**2 * np.sin(phase)) @ a - (w**2 * np.cos(phase)) @ b
    return t, q, qd, qdd


def written_log(
    folder: Path, name: str, joints: list[str], t: np.ndarray, q: np.ndarray, tau: np.ndarray, quantity: str = "torque"
) -> Log:
    """A log of positions and torques, currents or voltages, written as CSV and read."""
    unit = {"torque": "N m", "current": "A", "voltage": "V"}[quantity]
    text = FILE.format(name=name, joints=joints)
    text += SIGNAL.format(quantity="position", columns=[f"q{k}" for k in range(len(joints))], unit="rad", side=SIDE)
    text += SIGNAL.format(
        quantity=quantity,
        columns=[f"u{k}" for k in range(len(joints))],
        unit=unit,
        side=SIDE if quantity == "torque" else "",
    )
    columns = {
        "t": t,
        **{f"q{k}": q[:, k] for k in range(q.shape[1])},
        **{f"u{k}": tau[:, k] for k in range(q.shape[1])},
    }
    write_table(folder / f"{name}.csv", columns)
    path = folder / f"{name}.log.toml"
    path.write_text(text, encoding="utf-8")
    return aw.identification.read_log(path)


def moved(
    folder: Path,
    name: str,
    arm: aw.Model,
    *,
    seconds: float = 8.0,
    rate: float = 250.0,
    seed: int = 0,
    torque_noise: float = 0.0,
    position_noise: float = 0.0,
    size: float = 1.0,
    harmonics: int = 5,
) -> Log:
    """A log of the arm on a random multisine: its own torques and positions, both with noise."""
    t, q, qd, qdd = multisine(arm.n, seconds, rate, seed, size, harmonics)
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    rng = np.random.default_rng([seed, 1])
    tau = tau + torque_noise * rng.normal(size=tau.shape)
    return written_log(folder, name, arm.names, t, q + position_noise * rng.normal(size=q.shape), tau)

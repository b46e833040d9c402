"""Logs that the simulator makes of arms whose records are known, and records that differ from them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import armwright as aw
from armwright.results.csv_tables import write_table

HEAD = """
title = "{title}"
joints = {joints}
[files.log]
path = "fit.csv"
[time]
column = "t"
unit = "s"
[[runs]]
name = "fit"
[[runs]]
name = "held"
files.log = "held.csv"
use = "{use}"
"""
SIGNAL = """
[[signals]]
quantity = "{quantity}"
columns = {columns}
unit = "{unit}"
{side}
"""
UNITS = {"position": "rad", "speed": "rad/s", "torque": "N m", "voltage": "V", "current": "A"}
SHORT = {"position": "q", "speed": "qd", "torque": "tau", "voltage": "voltage", "current": "current"}
MOTOR = """
name = "motor"
source = "definition"
gravity_m_s2 = [0.0, 0.0, -9.81]
command = "voltage"

[[joints]]
name = "motor"
type = "revolute"
parent = "base"
child = "shaft"
frame = {{ xyz_m = [0.0, 0.0, 0.0], rpy_rad = [0.0, 0.0, 0.0] }}
axis = [0.0, 0.0, 1.0]

[joints.motor]
gear_ratio = {gear}
rotor_inertia_kg_m2 = 2e-5
torque_constant_n_m_per_a = 0.04
resistance_ohm = 2.0

[joints.friction]
viscous_n_m_s_per_rad = 0.02
{coulomb}

[[links]]
name = "shaft"
mass_kg = 0.0
com_m = [0.0, 0.0, 0.0]
inertia_kg_m2 = {{ xx = 0.0, xy = 0.0, xz = 0.0, yy = 0.0, yz = 0.0, zz = 0.0 }}
"""
COULOMB = "coulomb_positive_n_m = 0.15\ncoulomb_negative_n_m = 0.15"


def motor_file(folder: Path, gear: float = 10.0, coulomb: str = COULOMB, name: str = "motor.toml") -> Path:
    """Path of the record of a geared motor."""
    (folder / name).write_text(MOTOR.format(gear=gear, coulomb=coulomb))
    return folder / name


def written_log(
    folder: Path, joints: list[str], tables: dict[str, dict], use: str = "hold-out", title: str = "Made"
) -> Path:
    """Path of a log of two runs, `fit` and `held`, with every quantity of the tables."""
    text = HEAD.format(title=title, joints=joints, use=use)
    for quantity, values in tables["held"].items():
        if quantity != "t":
            side = "" if quantity in ("voltage", "current") else 'side = "joint"'
            columns = [f"{SHORT[quantity]}{k}" for k in range(np.shape(values)[1])]
            text += SIGNAL.format(quantity=quantity, columns=columns, unit=UNITS[quantity], side=side)
    for name, table in tables.items():
        columns = {"t": table["t"]}
        for quantity in (each for each in table if each != "t"):
            columns |= {f"{SHORT[quantity]}{k}": column for k, column in enumerate(np.asarray(table[quantity]).T)}
        write_table(folder / f"{name}.csv", columns)
    path = folder / "made.log.toml"
    path.write_text(text)
    return path


def driven(arm, commands: np.ndarray, period: float, kept: tuple[str, ...], noise: float = 0.0) -> dict:
    """Signals of an arm that commands (rows, n) drive, held from row to row, as a logger writes them."""
    times = period * np.arange(len(commands))
    run = aw.simulate(
        aw.Scenario(
            arm, times[-1], command=aw.Schedule(times, commands, arm.names), recording=aw.Recording(period=period)
        )
    )
    rng = np.random.default_rng(7)
    own = {"voltage": "V", "current": "A", "torque": "N m"}
    command = next(quantity for quantity in own if quantity == arm.coordinates[0].drive.command)
    table = {"t": run["time"].values}
    for quantity in kept:
        values = commands if quantity == command else run[SHORT[quantity]].values
        table[quantity] = values + noise * values.std(axis=0) * rng.normal(size=values.shape)
    return table


def random_steps(rows: int, every: int, size: list[float], seed: int) -> np.ndarray:
    """(rows, n) levels that change every so many rows."""
    levels = np.random.default_rng(seed).uniform(-1.0, 1.0, (-(-rows // every), len(size)))
    return np.repeat(levels, every, axis=0)[:rows] * size

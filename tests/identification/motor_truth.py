"""Logs of a motor with known parameters: noise, quantisation and a delay that is no whole number of samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np

TRUE = {"R": 1.3, "Kt": 0.052, "J": 8.4e-5, "viscous": 4.0e-4, "coulomb": 0.012}
PATHS = {
    "R": "motor.motor.resistance_ohm",
    "Kt": "motor.motor.torque_constant_n_m_per_a",
    "J": "motor.motor.rotor_inertia_kg_m2",
    "viscous": "motor.friction.viscous_n_m_s_per_rad",
    "coulomb": "motor.friction.coulomb_positive_n_m",
}
PERIOD, DELAY = 0.005, 2.3  # [s], [samples]
RECORD = """
name = "bench"
source = "definition"
gravity_m_s2 = [0, 0, 0]
command = "voltage"
[[joints]]
name = "motor"
type = "revolute"
parent = "base"
child = "shaft"
axis = [0, 0, 1]
frame = {{ xyz_m = [0, 0, 0], rpy_rad = [0, 0, 0] }}
[joints.motor]
gear_ratio = 1.0
rotor_inertia_kg_m2 = {J}                      # with its load
torque_constant_n_m_per_a = {Kt}
resistance_ohm = {R}
[joints.friction]
viscous_n_m_s_per_rad = {viscous}
coulomb_positive_n_m = {coulomb}
coulomb_negative_n_m = {coulomb}
[[links]]
name = "shaft"
mass_kg = 0
com_m = [0, 0, 0]
inertia_kg_m2 = {{ xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0 }}
"""
LOG = """
joints = ["motor"]
[files.log]
path = "{name}.csv"
[time]
column = "t"
unit = "s"
[[signals]]
quantity = "voltage"
columns = "u"
unit = "V"
{signals}
"""
SIGNALS = {
    "current": '[[signals]]\nquantity = "current"\ncolumns = "i"\nunit = "A"\n',
    "q": '[[signals]]\nquantity = "position"\ncolumns = "q"\nunit = "counts"\ncounts_per_turn = 4096\nside = "joint"\n',
    "qd": '[[signals]]\nquantity = "speed"\ncolumns = "w"\nunit = "rad/s"\nside = "joint"\n',
}
COLUMNS = {"current": "i", "q": "q", "qd": "w"}


def true_record(folder: Path, **changes: float) -> Path:
    """Path of the record with the true numbers, some of them changed."""
    path = folder / "truth.toml"
    path.write_text(RECORD.format(**{**TRUE, **changes}))
    return path


def commands(rng: np.random.Generator, rows: int, most: float = 10.0) -> np.ndarray:
    """(rows,) volts of a converter of 12 bit: levels of random length, every fifth of them 0."""
    lengths = rng.integers(8, 50, rows // 8)
    levels = rng.uniform(-most, most, len(lengths)) * (np.arange(len(lengths)) % 5 > 0)
    return rounded(np.repeat(levels, lengths)[:rows], most)


def rounded(values: np.ndarray, most: float) -> np.ndarray:
    """Values as a converter of 12 bit between ±most gives them."""
    step = 2.0 * most / 4096
    return np.round(values / step) * step


def exact(values: dict[str, float], u: np.ndarray, delay: float = DELAY, q: float = 0.3) -> dict[str, np.ndarray]:
    """Position, speed and current at the rows in closed form; every command acts `delay` samples late, before them the first.

    Between changes of command and of direction  w = w∞ + (w0 - w∞) exp(-t/τ),  τ = J / D,  D = Kt²/R + viscous,
    w∞ = (Kt u/R - coulomb sgn w) / D.  At rest the motor sticks while |Kt u/R| ≤ coulomb.
    """
    resistance, constant, inertia = values["R"], values["Kt"], values["J"]
    damping = constant**2 / resistance + values["viscous"]
    time, w = inertia / damping, 0.0
    rows: dict[str, list[float]] = {"q": [], "qd": [], "current": []}
    whole, part = int(np.ceil(delay)) - 1, delay - (np.ceil(delay) - 1)
    for k in range(len(u)):
        before, now = u[max(k - whole - 1, 0)], u[max(k - whole, 0)]
        rows["q"].append(q)
        rows["qd"].append(w)
        rows["current"].append((before - constant * w) / resistance)
        for volts, length in ((before, part * PERIOD), (now, (1.0 - part) * PERIOD)):
            driven, left = constant * volts / resistance, length
            while left > 0.0:
                side = np.sign(w) if w != 0.0 else np.sign(driven) * (abs(driven) > values["coulomb"])
                if side == 0.0:
                    break
                final = (driven - side * values["coulomb"]) / damping
                rest = time * np.log((w - final) / -final) if w * final < 0.0 else np.inf
                step = min(left, rest)
                decay = np.exp(-step / time)
                q += final * step + (w - final) * time * (1.0 - decay)
                w = 0.0 if rest <= left else final + (w - final) * decay
                left -= step
    return {name: np.array(column) for name, column in rows.items()}


def write_log(
    folder: Path,
    seed: int,
    signals: tuple[str, ...] = ("current", "q", "qd"),
    rows: int = 2000,
    name: str = "log",
    **changes,
) -> Path:
    """Path of a log with 1 % noise, converters of 12 bit and an encoder of 4096 counts."""
    rng = np.random.default_rng(seed)
    u = commands(rng, rows)
    truth = exact({**TRUE, **changes}, u)
    columns = {"t": np.arange(rows) * PERIOD, "u": u}
    for signal in signals:
        values = truth[signal]
        if signal == "q":
            columns["q"] = np.round(values / (2 * np.pi) * 4096)
        else:
            most = float(np.abs(values).max())
            columns[COLUMNS[signal]] = rounded(values + 0.01 * most * rng.standard_normal(rows), 1.2 * most)
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / f"{name}.csv", table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    path = folder / f"{name}.log.toml"
    path.write_text(LOG.format(name=name, signals="".join(SIGNALS[signal] for signal in signals)))
    return path

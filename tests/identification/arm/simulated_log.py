"""Logs of an arm's inverse dynamics with known truth, as CSV and log file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import armwright as aw


def motion(n: int, seconds: float, rate: float, seed: int = 0, still: tuple[int, ...] = ()) -> tuple[np.ndarray, ...]:
    """t (rows,) and q, q̇, q̈ (rows, n) of a sum of five sines for each joint, of a few rad/s; `still` joints rest."""
    generator = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    q, qd, qdd = (np.zeros((len(t), n)) for _ in range(3))
    for j in range(n):
        q[:, j] = generator.uniform(-0.5, 0.5)
        for harmonic in range(1, 6) if j not in still else ():
            w = 2 * np.pi * 0.1 * harmonic
            a, phase = generator.uniform(0.2, 0.6) / harmonic**0.5, generator.uniform(0, 2 * np.pi)
            q[:, j] += a * np.sin(w * t + phase)
            qd[:, j] += a * w * np.cos(w * t + phase)
            qdd[:, j] -= a * w**2 * np.sin(w * t + phase)
    return t, q, qd, qdd


def write_log(
    folder: Path,
    arm: aw.Arm,
    seconds: float = 30.0,
    rate: float = 200.0,
    noise: float = 0.1,
    seed: int = 0,
    extra: str = "",
    still: tuple[int, ...] = (),
    columns: str = "",
) -> Path:
    """Path of a log of positions and torques, these with white noise [N m]."""  # fmt: skip
    t, q, qd, qdd = motion(arm.n, seconds, rate, seed, still)
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    tau += noise * np.random.default_rng(seed + 1).normal(size=tau.shape)
    heads = ["t", *(f"q{k}" for k in range(arm.n)), *(f"tau{k}" for k in range(arm.n))]
    data = np.column_stack([t, q, tau])
    np.savetxt(folder / "log.csv", data, delimiter=",", header=",".join(heads), comments="", fmt="%.12g")
    path = folder / "arm.log.toml"
    positions, torques = [f"q{k}" for k in range(arm.n)], [f"tau{k}" for k in range(arm.n)]
    path.write_text(f"""
joints = {arm.names}
{columns}
[files.log]
path = "log.csv"
[time]
column = "t"
unit = "s"
[[signals]]
quantity = "position"
columns = {positions}
unit = "rad"
side = "joint"
[[signals]]
quantity = "torque"
columns = {torques}
unit = "N m"
side = "joint"
{extra}
""")
    return path

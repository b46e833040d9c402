"""Logs of arms without and with a payload as a user has them: counts of motor encoders, noisy milliamperes, dry friction."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import armwright as aw
from armwright.results.csv_tables import write_table
from identification.arm.moved_arm import multisine

COUNTS = 8192
ORIGINS = (
    ("0 0 0.3", 0.0),
    ("0.1 0 0.1", -np.pi / 2),
    ("0.4 0.02 0", 0.0),
    ("0.35 0 -0.02", 0.0),
)  # xyz [m], roll [rad]
MASSES, SIZES = (9.0, 7.0, 4.0, 1.5), (0.3, 0.4, 0.35, 0.12)  # [kg], [m]
RADII = ("ixx", 0.2), ("iyy", 0.3), ("izz", 0.31)  # of gyration, by the size
GEARS, KT = (-101.0, 121.0, 100.0, -81.0), (0.105, 0.118, 0.062, 0.041)
ROTORS = (1.1e-4, 1.3e-4, 4e-5, 9e-6)
VISCOUS, COULOMB = (9.0, 11.0, 4.0, 0.9), (8.0, 10.0, 4.0, 1.5)
JOINTS = ("base", "shoulder", "elbow", "wrist")
LOG = """
joints = {joints}
[files.log]
path = "{name}.csv"
[time]
column = "t"
unit = "s"
[gears]
ratios = {ratios}
[[signals]]
quantity = "position"
columns = {counts}
unit = "counts"
side = "motor"
counts_per_turn = {per_turn}
[[signals]]
quantity = "current"
columns = {currents}
unit = "mA"
"""


def four_joints(folder: Path, *, constants: bool) -> aw.Model:
    """A geared arm of four joints by a URDF and a drive file, with its torque constants or, as bought, without."""
    links, joints = ['<link name="stand"/>'], []
    lines = ['source = "bench"', f'command = "{"current" if constants else "torque"}"', "[sources.bench]"]
    lines += ['kind = "datasheet"', 'text = "of the test"']
    for k, ((xyz, roll), m, size) in enumerate(zip(ORIGINS, MASSES, SIZES, strict=True)):
        moments = " ".join(f'{axis}="{m * (size * share) ** 2:.6g}"' for axis, share in RADII)
        own = f'<origin xyz="{0.45 * size} {0.05 * size} {-0.04 * size}"/><mass value="{m}"/>'
        links.append(
            f'<link name="part{k}"><inertial>{own}<inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
        joints.append(
            f'<joint name="{JOINTS[k]}" type="revolute"><parent link="{"stand" if k == 0 else f"part{k - 1}"}"/>'
            f'<child link="part{k}"/><axis xyz="0 0 1"/><origin xyz="{xyz}" rpy="{roll!r} 0 0"/>'
            '<limit lower="-3" upper="3" velocity="6" effort="400"/></joint>'
        )
        constant = f", torque_constant_n_m_per_a = {KT[k]}" if constants else ""
        lines += [
            f"[joints.{JOINTS[k]}]",
            f"motor = {{ gear_ratio = {GEARS[k]}, rotor_inertia_kg_m2 = {ROTORS[k]}{constant} }}",
        ]
        dry = f"coulomb_positive_n_m = {COULOMB[k]}, coulomb_negative_n_m = {COULOMB[k]}"
        lines.append(f"friction = {{ viscous_n_m_s_per_rad = {VISCOUS[k]}, {dry} }}")
    name = "with_constants" if constants else "as_bought"
    (folder / f"{name}.urdf").write_text(f'<robot name="four">{"".join(links + joints)}</robot>')
    (folder / f"{name}.drive.toml").write_text("\n".join(lines))
    return aw.load(folder / f"{name}.urdf")


def weighed(
    folder: Path,
    name: str,
    arm: aw.Model,
    seed: int,
    *,
    seconds: float = 10.0,
    rate: float = 100.0,
    noise: float = 0.01,
    moving: np.ndarray | None = None,
    factors: np.ndarray | None = None,
) -> aw.identification.Log:
    """A log of the arm on a random multisine of its own.

    Args:
        noise: of the currents, by their root mean square.   moving: (n,) 1 or 0 for joints at rest.
        factors: (n,) by which the drives report other currents than flow.
    """
    size = 0.4 if moving is None else 0.4 * moving
    t, q, qd, qdd = multisine(arm.n, seconds, rate, seed, size, 8)
    gears = np.array([float(body.drive.gear_ratio) for body in arm.coordinates])
    constants = np.array([float(body.drive.torque_constant) for body in arm.coordinates])
    current = aw.compile(arm).inverse_dynamics(q, qd, qdd) / (gears * constants)
    size = np.sqrt(np.mean(current**2, axis=0))
    current += noise * size * np.random.default_rng([seed, 1]).normal(size=current.shape)
    current *= 1.0 if factors is None else factors
    columns = {"t": t}
    columns |= {f"n{k}": np.round(q[:, k] * gears[k] / (2 * np.pi) * COUNTS) for k in range(arm.n)}
    columns |= {f"i{k}": 1e3 * current[:, k] for k in range(arm.n)}
    write_table(folder / f"{name}.csv", columns)
    text = LOG.format(
        joints=arm.names, name=name, ratios=gears.tolist(), per_turn=COUNTS, counts=[f"n{k}" for k in range(arm.n)],
        currents=[f"i{k}" for k in range(arm.n)],
    )  # fmt: skip
    (folder / f"{name}.log.toml").write_text(text)
    return aw.identification.read_log(folder / f"{name}.log.toml")

"""A motor under currents that are held from row to row: each sample of delay is a minimum that a search may end in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.identification import MotorSearch

PERIOD, DELAY, PARTS = 0.005, 1.5, 100  # [s], [samples], steps of the simulation in a sample
KT, J, VISCOUS, COULOMB = 0.05, 2.2e-5, 4.2e-4, 0.01
BENCH = """
joints = ["motor"]
files.log.path = "bench.csv"
time = { column = "t", unit = "s" }
signals = [
    { quantity = "current", columns = "i", unit = "A", held = true },
    { quantity = "speed", columns = "w", unit = "rad/s", side = "joint" },
]
"""
RECORD = """
name = "bench"
source = "estimate"
gravity_m_s2 = [0, 0, 0]
command = "current"
[[joints]]
name = "motor"
type = "revolute"
parent = "base"
child = "shaft"
axis = [0, 0, 1]
frame = { xyz_m = [0, 0, 0], rpy_rad = [0, 0, 0] }
[joints.motor]
gear_ratio = 1.0
rotor_inertia_kg_m2 = 9.6e-5
torque_constant_n_m_per_a = 0.05
[joints.friction]
viscous_n_m_s_per_rad = 2e-4
coulomb_positive_n_m = 0.007
coulomb_negative_n_m = 0.007
[[links]]
name = "shaft"
mass_kg = 0
com_m = [0, 0, 0]
inertia_kg_m2 = { xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0 }
"""


def bench(folder: Path, seed: int, coulomb: float = COULOMB) -> tuple[Path, Path]:
    """Paths of a log of random currents, each held for a row, and of a record with other numbers."""
    rng = np.random.default_rng(seed)
    i, w, speeds = rng.uniform(-1.0, 1.0, 800), 0.0, np.zeros(800)
    decay = np.exp(-VISCOUS / J * PERIOD / PARTS)
    for k in range(len(i)):
        speeds[k] = w
        for part in range(PARTS):
            torque = KT * i[max(int(np.floor(k + part / PARTS - DELAY)), 0)]
            if w == 0.0 and abs(torque) <= coulomb:
                continue
            ends = (torque - coulomb * np.sign(w or torque)) / VISCOUS
            after = ends + (w - ends) * decay
            w = 0.0 if after * w < 0.0 else after
    columns = np.column_stack([np.arange(len(i)) * PERIOD, i, speeds + 0.6 * rng.normal(size=len(i))])
    np.savetxt(folder / "bench.csv", columns, delimiter=",", header="t,i,w", comments="", fmt="%.9g")
    (folder / "bench.log.toml").write_text(BENCH)
    (folder / "bench.toml").write_text(RECORD)
    return folder / "bench.log.toml", folder / "bench.toml"


@pytest.mark.parametrize("seed", [32, 156])
def test_one_start_finds_delay_and_inertia(tmp_path, seed):
    """Torque constant and inertia by their ratio, which is all that such a log tells."""
    found = aw.identification.identify_motor(
        *bench(tmp_path, seed), search=MotorSearch(starts=1), progress=False
    ).estimate
    ratio = found["motor.motor.rotor_inertia_kg_m2"] / found["motor.motor.torque_constant_n_m_per_a"]
    assert found["delay_s"] / PERIOD == pytest.approx(DELAY, abs=0.1)
    assert ratio == pytest.approx(J / KT, rel=0.1)


@pytest.mark.parametrize("seed", [2, 3])
def test_dry_friction_that_hardly_acts_at_the_first_guess_is_fitted(tmp_path, seed):
    """The motor hardly moves, and the guess, which knows no sticking, has next to no friction."""
    log, _ = bench(tmp_path, seed, coulomb=0.03)
    found = aw.identification.identify_motor(log, fixed={"Kt": KT}, progress=False).estimate
    assert found["motor.motor.rotor_inertia_kg_m2"] == pytest.approx(J, rel=0.1)
    assert found["motor.friction.coulomb_positive_n_m"] == pytest.approx(0.03, rel=0.05)

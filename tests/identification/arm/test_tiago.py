"""TIAGo's dynamic log: stamps that jitter, a lift whose torque is not known, currents of a few counts at the wrist."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.results.csv_tables import write_table
from identification.geometry.tiago import JOINTS, urdf
from identification.real_logs import DATA
from reference.example_robots import robot_files

FOLDER = DATA / "tiago"
TORQUE_CONSTANTS = np.array([0.136, 0.136, -0.087, -0.087, -0.0613, -0.0613, -0.0613])  # [N m/A]
GEARS = np.array([100, 100, 100, 100, 336, 336, 336])
FILE = """
title = "TIAGo"
joints = {joints}
files.log.path = "tiago.csv"
time.column = "t"
time.unit = "s"
[[runs]]
name = "fit"
from_s = 9.2
to_s = 55.0
[[runs]]
name = "held out"
from_s = 55.0
to_s = 67.9
use = "hold-out"
"""
SIGNAL = """
[[signals]]
quantity = "{quantity}"
joints = {joints}
columns = {columns}
unit = "{unit}"
side = "joint"
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Positions, and torques of the arm's joints, by the constants of the source."""
    if not FOLDER.is_dir() or not robot_files():
        pytest.skip("TIAGo's log or its URDF are not here")
    folder = tmp_path_factory.mktemp("tiago")
    position, effort = (
        np.genfromtxt(FOLDER / f"tiago_{name}.csv", delimiter=",", skip_header=1) for name in ("position", "effort")
    )
    columns = {"t": position[:, 0]} | {f"q_{joint}": position[:, k] for k, joint in enumerate(JOINTS, start=1)}
    torques = effort[:, 2:] * TORQUE_CONSTANTS * GEARS
    columns |= {f"tau_{joint}": torques[:, k] for k, joint in enumerate(JOINTS[1:])}
    write_table(folder / "tiago.csv", columns)
    text = FILE.format(joints=JOINTS)
    for quantity, unit, joints in (
        ("position", "m", JOINTS[:1]),
        ("position", "rad", JOINTS[1:]),
        ("torque", "N m", JOINTS[1:]),
    ):
        names = [f"{'q' if quantity == 'position' else 'tau'}_{joint}" for joint in joints]
        text += SIGNAL.format(quantity=quantity, joints=joints, columns=names, unit=unit)
    path = folder / "tiago.log.toml"
    path.write_text(text)
    return aw.identification.read_log(path)


@pytest.mark.study
def test_the_default_fit_predicts_runs_held_out_where_currents_tell_something(log):
    """R² of the arm's first four joints; the wrist's currents are a few counts of dry friction, and that is said."""
    whole = aw.load(urdf(), on_impossible="warn", tip="arm_7_link")
    arm = whole.with_locked({name: 0.0 for name in whole.names if name not in JOINTS})
    found = aw.identification.identify_arm(log, arm, checks=())
    assert any("stamps are late" in str(note) for note in log.notes)
    assert found.fit.r2[1:5].min() > 0.96
    assert np.isnan(found.fit.r2[0])
    r2s = {row.joint: row.written.r2 for row in found.hold_out.rows if row.quantity == "torque"}
    assert min(r2s[f"arm_{k}_joint"] for k in range(1, 5)) > 0.95
    remarks = "\n".join(found.estimate.remarks)
    for k in (5, 6, 7):
        assert f"arm_{k}_joint: R² {r2s[f'arm_{k}_joint']:.2f} on the runs held out, below 0.5" in remarks
    assert "torso_lift_joint: no torque was measured" in remarks
    assert "exchanged" not in remarks
    assert found.verdict == "not identified"

"""Logs of real machines, which are not part of this repository: a geared DC motor, a Staubli TX40, a Schunk LWA 4P."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armwright as aw

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
JOINTS = [f"joint{k}" for k in range(1, 7)]

DC_MOTOR = """
title = "Geared DC motor"
joints = ["motor"]
[files.log]
[time]
column = "t"
unit = "s"
[[runs]]
name = "prbs"
files.log = "{folder}/DCmotor_prbs_open_exp.csv"
[[runs]]
name = "step"
files.log = "{folder}/DCmotor_step_open_exp.csv"
use = "hold-out"
[[signals]]
quantity = "voltage"
columns = "u"
unit = "V"
[[signals]]
quantity = "speed"
columns = "y"
unit = "deg/s"
side = "joint"
"""
TX40 = """
title = "Staubli TX40"
joints = {joints}
time.rate_hz = 5000
[files.position]
path = "{folder}/pos_read_data.csv"
[files.torque]
path = "{folder}/curr_data.csv"
[gears]                                   # the motor of joint 6 is coupled with joint 5
matrix = [[32, 0, 0, 0, 0, 0], [0, 32, 0, 0, 0, 0], [0, 0, 45, 0, 0, 0], [0, 0, 0, -48, 0, 0], [0, 0, 0, 0, 45, 0], [0, 0, 0, 0, 32, 32]]
[[signals]]
quantity = "position"
file = "position"
columns = [1, 2, 3, 4, 5, 6]
unit = "rad"
side = "motor"
offsets = [0, -1.5707963267948966, 1.5707963267948966, 0, 0, 0]
[[signals]]
quantity = "torque"
file = "torque"
columns = [1, 2, 3, 4, 5, 6]
unit = "N m"
side = "motor"
"""  # noqa: E501
LWA_4P = """
title = "Schunk LWA 4P"
joints = {joints}
[files.time]
path = "time.csv"
header = false
[files.motion]
path = "trajectory.csv"
header = false
[files.torque]
path = "input.csv"
header = false
[time]
file = "time"
column = 1
unit = "s"
[[runs]]
folder = {fit}
[[runs]]
folder = {held}
use = "hold-out"
[[signals]]
quantity = "position"
file = "motion"
columns = [1, 2, 3, 4, 5, 6]
unit = "rad"
side = "joint"
[[signals]]
quantity = "speed"
file = "motion"
columns = [7, 8, 9, 10, 11, 12]
unit = "rad/s"
side = "joint"
[[signals]]
quantity = "torque"
file = "torque"
columns = [1, 2, 3, 4, 5, 6]
unit = "N m"
side = "joint"
"""


def log_of(tmp_path: Path, name: str, text: str, **values) -> Path:
    """Path of a log file about measurements that lie elsewhere."""
    folder = DATA / name
    if not folder.is_dir():
        pytest.skip(f"the measurements are not here: {folder}")
    path = tmp_path / f"{name}.log.toml"
    for key, value in {"folder": folder.as_posix(), "joints": JOINTS, **values}.items():
        text = text.replace(f"{{{key}}}", str(value))
    path.write_text(text)
    return path


def test_dc_motor(tmp_path):
    log = aw.read_log(log_of(tmp_path, "dc_motor", DC_MOTOR))
    assert (log.fit, log.hold_out) == (("prbs",), ("step",))
    assert [run.rows for run in log.runs] == [4093, 502]
    assert [1 / run.period for run in log.runs] == pytest.approx([50.0, 50.0])
    (note,) = log.notes  # one count in 20 ms, 2800 in a turn
    assert f"quantised in steps of {2 * np.pi / 2800 / 0.02:.4g} rad/s" in str(note)
    assert log.dataset("prbs")["qd"].values.max() == pytest.approx(3.8148, abs=1e-4)


def test_staubli_tx40(tmp_path):
    log = aw.read_log(log_of(tmp_path, "staubli_tx40", TX40))
    assert log.notes == ()
    data = aw.prepare_log(log, preparation=aw.choose_preparation(log, cutoff=100.0, decimate=20))
    assert np.abs(data["qd"]).max("time").values == pytest.approx([5.0, 5.0, 7.0, 7.2, 5.6, 11.6], rel=0.02)
    assert np.abs(data["q"].values[0] - [0, -np.pi / 2 + 50.265 / 32, np.pi / 2 - 70.685 / 45, 0, 0, 0]).max() < 0.01
    raw = log.dataset()
    rms = np.sqrt((raw["tau"] ** 2).mean("time")).values
    assert rms == pytest.approx([31.0, 32.4, 12.0, 5.7, 8.2, 5.0], rel=0.05)
    choice = aw.choose_preparation(log)
    assert 40.0 < choice.cutoff < 160.0  # others chose 100 Hz by hand


def test_schunk_lwa_4p(tmp_path):
    folders = sorted(each.as_posix() for each in (DATA / "schunk_lwa4p").glob("measurement_*"))
    log = aw.read_log(log_of(tmp_path, "schunk_lwa4p", LWA_4P, fit=folders[:8], held=folders[8:11]))
    assert len(log.fit) == 8
    assert len(log.hold_out) == 3
    assert all(run.rows in (233, 467, 702, 936, 1087) for run in log.runs)  # inputs have one row fewer
    assert not log.errors
    data = log.dataset(log.fit[0])
    assert np.diff(data["time"]).max() == pytest.approx(0.004)

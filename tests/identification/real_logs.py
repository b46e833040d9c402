"""Logs of real machines: a geared DC motor and a TX40 of `examples/logs`; an LWA 4P, which is not part of this repository."""

from __future__ import annotations

from pathlib import Path

import pytest

LOGS = Path(__file__).resolve().parents[2] / "examples" / "logs"
HERE = {"dc_motor": LOGS / "dc_motor", "staubli_tx40": LOGS / "tx40"}
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
[files.log]
path = "{folder}/tx40.parquet"
[gears]                                   # the motor of joint 6 is coupled with joint 5
matrix = [[32, 0, 0, 0, 0, 0], [0, 32, 0, 0, 0, 0], [0, 0, 45, 0, 0, 0], [0, 0, 0, -48, 0, 0], [0, 0, 0, 0, 45, 0], [0, 0, 0, 0, 32, 32]]
[[signals]]
quantity = "position"
columns = ["position_1", "position_2", "position_3", "position_4", "position_5", "position_6"]
unit = "rad"
side = "motor"
offsets = [0, -1.5707963267948966, 1.5707963267948966, 0, 0, 0]
[[signals]]
quantity = "torque"
columns = ["torque_1", "torque_2", "torque_3", "torque_4", "torque_5", "torque_6"]
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
lacks = ["gravity", "coulomb", "offset"]     # taken off before it was logged, see SOURCE.md there
"""


def log_of(tmp_path: Path, name: str, text: str, **values) -> Path:
    """Path of a log file about measurements that lie elsewhere."""
    folder = HERE.get(name, DATA / name)
    if ".parquet" in text:
        pytest.importorskip("pyarrow", reason="the extra `logs` is not installed")
    if not folder.is_dir():
        pytest.skip(f"the measurements are not here: {folder}")
    path = tmp_path / f"{name}.log.toml"
    for key, value in {"folder": folder.as_posix(), "joints": JOINTS, **values}.items():
        text = text.replace(f"{{{key}}}", str(value))
    path.write_text(text)
    return path

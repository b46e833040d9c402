"""A designed motion beside a published one, the TX40's log that comes with FIGAROH: same ranges, speeds, accelerations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

import armwright as aw
from armwright.identification.experiments.columns import DRIVES, BaseRegressor
from armwright.identification.experiments.information import condition_number
from identification.arm.tx40 import tx40_urdf
from identification.real_logs import DATA

FILE = DATA / "staubli_tx40" / "pos_read_data.csv"
GEARS = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
GEARS[5, 4] = 32.0
OFFSETS = (0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0)


@pytest.mark.skipif(not FILE.is_file(), reason=f"the measurements are not here: {FILE}")
def test_the_condition_number_is_better_than_the_published_motions(tmp_path):
    arm = aw.load(tx40_urdf(tmp_path))
    motors = np.loadtxt(FILE, delimiter=",", skiprows=1)
    q = filtfilt(*butter(4, 100 / 2500), np.linalg.solve(GEARS, motors.T).T + OFFSETS, axis=0)
    qd = np.gradient(q, 2e-4, axis=0)
    qdd = np.gradient(qd, 2e-4, axis=0)
    q, qd, qdd = (each[200:-200:20] for each in (q, qd, qdd))
    information = BaseRegressor.of(arm, DRIVES, np.full(6, 0.01)).information(q, qd, qdd)
    found = aw.design_excitation(
        arm, period=9.0, starts=1, position=np.stack([q.min(axis=0), q.max(axis=0)], axis=1),
        velocity=np.abs(qd).max(axis=0), acceleration=np.abs(qdd).max(axis=0),
    )  # fmt: skip
    assert found.condition < 0.7 * condition_number(information, "columns")
    assert found.condition_si < condition_number(information, "none")

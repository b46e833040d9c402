"""Designed motions beside published ones, of the same arms, within the same ranges, speeds and accelerations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

import armwright as aw
from armwright.identification.experiments.columns import DRIVES, BaseRegressor
from armwright.identification.experiments.information import condition_number
from identification.arm.tx40 import tx40_urdf
from identification.experiments.ur10e import PERIOD, START, published_motion, ur10e_urdf
from identification.real_logs import LOGS

FILE = LOGS / "tx40" / "tx40.parquet"
GEARS = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
GEARS[5, 4] = 32.0
OFFSETS = (0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0)


def information_of(arm, q, qd, qdd):
    return BaseRegressor.of(arm, DRIVES, np.full(6, 0.01)).information(q, qd, qdd)


def same_limits(q, qd, qdd):
    return np.stack([q.min(axis=0), q.max(axis=0)], axis=1), np.abs(qd).max(axis=0), np.abs(qdd).max(axis=0)


@pytest.mark.parametrize(("scaling", "harmonics"), [("columns", 4), ("none", 5)])
@pytest.mark.study
def test_the_condition_number_is_better_than_that_published_for_a_ur10e(tmp_path, scaling, harmonics):
    """In less than half the time, by columns of length 1 and in SI units, which is what the published motion minimises."""
    arm = aw.load(ur10e_urdf(tmp_path), kinematics_only=True)
    states = published_motion(np.linspace(0.0, PERIOD, 1001))
    np.testing.assert_allclose([states[0][0], states[0][-1]], [START, START], atol=1e-9)
    np.testing.assert_allclose([part[[0, -1]] for part in states[1:]], 0.0, atol=1e-9)
    published = condition_number(information_of(arm, *states), scaling)
    assert published == pytest.approx({"columns": 11.25, "none": 96.8}[scaling], rel=0.02)  # as computed by us
    position, velocity, acceleration = same_limits(*states)
    found = aw.identification.design_excitation(
        arm, cycle=20.0, harmonics=harmonics, starts=1, criterion={"columns": "condition", "none": "condition_si"}[scaling],
        limits=aw.trajectories.MotionLimits.of(arm, position=position, velocity=velocity, acceleration=acceleration),
    )  # fmt: skip
    assert {"columns": found.condition, "none": found.condition_si}[scaling] < 0.9 * published
    q, qd, qdd = found.trajectory.at(np.linspace(0.0, 20.0, 5001))
    assert (q >= position[:, 0] - 1e-3).all()
    assert (q <= position[:, 1] + 1e-3).all()
    assert (np.abs(qd) <= velocity * (1.0 + 1e-3)).all()
    assert (np.abs(qdd) <= acceleration * (1.0 + 1e-3)).all()


@pytest.mark.study
def test_the_condition_number_is_better_than_that_of_the_log_of_a_tx40(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra `logs` is not installed")
    arm = aw.load(tx40_urdf(tmp_path))
    table = parquet.read_table(FILE)
    motors = np.stack([table[f"position_{k}"].to_numpy() for k in range(1, 7)], axis=1)
    q = filtfilt(*butter(4, 100 / 2500), np.linalg.solve(GEARS, motors.T).T + OFFSETS, axis=0)
    qd = np.gradient(q, 2e-4, axis=0)
    qdd = np.gradient(qd, 2e-4, axis=0)
    q, qd, qdd = (each[200:-200:20] for each in (q, qd, qdd))
    information = information_of(arm, q, qd, qdd)
    position, velocity, acceleration = same_limits(q, qd, qdd)
    limits = aw.trajectories.MotionLimits.of(arm, position=position, velocity=velocity, acceleration=acceleration)
    found = aw.identification.design_excitation(arm, limits=limits, cycle=9.0, starts=1)
    assert found.condition < 0.7 * condition_number(information, "columns")
    assert found.condition_si < condition_number(information, "none")

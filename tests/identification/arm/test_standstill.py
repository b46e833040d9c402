"""Joints that stick where they turn back: dry friction is whatever keeps them at rest, and no fit may have a direction there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import armwright as aw
from identification.arm.logged_machine import counted
from identification.arm.moved_arm import written_log

HALF_PERIODS, SIZES = np.array([0.61, 0.43]), np.array([0.9, 0.7])  # [s], [rad]
COULOMB = np.array([8.0, 5.0])  # [N m]


def swings(t: np.ndarray, rest: float) -> tuple[np.ndarray, ...]:
    """q, q̇, q̈ of two joints that swing, and rest [s] at each end; and the sign of dry friction, from end to end of a rest."""
    ends, since = np.divmod(t[:, None] + [0.1, 0.3], HALF_PERIODS + rest)
    w, done = np.pi / HALF_PERIODS, np.minimum(since / HALF_PERIODS, 1.0)
    phase, moves = np.pi * (ends + done), since < HALF_PERIODS
    way = -((-1.0) ** ends)
    sticks = way * (1.0 - 2.0 * np.clip((since - HALF_PERIODS) / max(rest, 1e-9), 0.0, 1.0))
    q, qd, qdd = SIZES * np.cos(phase), -SIZES * w * np.sin(phase) * moves, -SIZES * w * w * np.cos(phase) * moves
    return q, qd, qdd, np.where(moves, way, sticks)


def found_of(folder: Path, rest: float, step: float, noise: float):
    """The fit of a log in encoder counts of a step [rad], with noise of torques [N m], and z of its dry friction."""
    arm, rng = aw.load("two-link"), np.random.default_rng(1)
    t = np.arange(6000) / 300.0
    q, qd, qdd, dry = swings(t, rest)
    bare = arm.replace(friction=None)
    tau = aw.compile(bare).inverse_dynamics(q, qd, qdd) + COULOMB * dry + 0.3 * qd + noise * rng.normal(size=q.shape)
    log = written_log(folder, "swings", arm.names, t, counted(q, step, rng), tau)
    found = aw.identification.identify_arm(log, arm, record=False, checks=())
    fit = found.fit
    z = [
        (fit.values[b] - COULOMB[arm.names.index(fit.base.columns[k].joint)]) / fit.std[b]
        for b, k in enumerate(fit.base.independent)
        if fit.base.columns[k].kind == "coulomb"
    ]
    return found, np.array(z)


def test_dry_friction_of_joints_that_stick_is_within_its_deviations(tmp_path):
    found, z = found_of(tmp_path, 0.03, 2e-4, 0.05)
    assert np.abs(z).max() < 3.0
    assert found.fit.r2.min() > 0.999
    assert any("near standstill" in remark for remark in found.estimate.remarks)


def test_joints_that_turn_back_at_once_keep_all_rows(tmp_path):
    found, z = found_of(tmp_path, 0.0, 1e-6, 0.5)
    assert np.abs(z).max() < 3.0
    assert not any("near standstill" in remark for remark in found.estimate.remarks)

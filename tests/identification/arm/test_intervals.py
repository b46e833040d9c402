"""Stated 95 % intervals of base parameters cover the truth, and widen where parts of a log differ by more than noise.

A few seeds of `tools/arm_coverage.py`, whose table is in the docs; the logs are of Pinocchio and NumPy.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import IdentificationError
from identification.arm.logged_machine import Machine, Motion, read, written

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "tools"))
import arm_coverage

from raises_at import raises_at


def cover(case: str, joints: int, seeds: int) -> tuple[float, float]:
    """Share of the parameters within their intervals, and root mean square of z."""
    z = np.concatenate([arm_coverage.deviations(case, joints, seed)[0] for seed in range(seeds)])
    return float((np.abs(z) < 1.96).mean()), float(np.sqrt((z**2).mean()))


@pytest.mark.study
@pytest.mark.parametrize("case", ["noise", "quantised", "both"])
def test_few_seeds_of_a_small_arm(case):
    share, size = cover(case, 3, 3)
    assert share > 0.8
    assert size < 1.5


@pytest.mark.study
@pytest.mark.parametrize(("case", "joints"), [("truncated", 3), ("loop", 3), ("quantised", 6)])
def test_more_cases(case, joints):
    share, size = cover(case, joints, 4)
    assert share > 0.8
    assert size < 1.6


@pytest.mark.parametrize("case", ["noise", "quantised"])
def test_blocks_of_the_log_have_the_stated_deviations(case):
    found, _ = arm_coverage.fitted(case, 3, 1, checks=("bootstrap",))
    assert 0.8 < np.median(found.bootstrap.ratios) < 1.25
    assert any(each.startswith("bootstrap of ") for each in found.estimate.remarks)


def test_the_bootstrap_is_of_least_squares_alone():
    with raises_at(IdentificationError, "checks", "ols or wls", value="bootstrap"):
        arm_coverage.fitted("noise", 3, 1, checks=("bootstrap",), method="irls")


def drifting(
    folder: Path, drift: float, seed: int = 1, part: slice = slice(None)
) -> tuple[Machine, aw.identification.Log]:
    """A log of 40 s, or part of it, in which friction becomes smaller by a share, as of a gear that warms up."""
    machine, t = Machine.written(folder, 3, seed), np.arange(20000) / 500
    states, rng = Motion.of(3, seed).at(t), np.random.default_rng(seed)
    friction = machine.coulomb * np.sign(states[1]) + machine.viscous * states[1]
    torque = machine.torque(*states) - drift * (t / t[-1])[:, None] * friction
    torque = torque + 0.01 * torque.std(axis=0) * rng.normal(size=torque.shape)
    columns = {"t": t[part], "position": states[0][part], "torque": torque[part]}
    path = written(folder, f"drift{drift}_{seed}_{part.start}", machine.names, columns)
    return machine, read(path)


@pytest.mark.study
def test_friction_that_changes_widens_intervals_and_is_said(tmp_path):
    machine, log = drifting(tmp_path, 0.4)
    found = aw.identification.identify_arm(log, machine.arm, record=False, checks=())
    assert found.fit.part_effect > 1.5
    assert any("times what noise explains" in each for each in found.estimate.remarks)
    _, steady = drifting(tmp_path, 0.0)
    same = aw.identification.identify_arm(steady, machine.arm, record=False, checks=())
    assert same.fit.part_effect == 1.0
    assert not any("times what noise explains" in each for each in same.estimate.remarks)


@pytest.mark.study
@pytest.mark.parametrize("drift", [0.1, 0.4])
def test_halves_of_drifting_logs_differ_by_what_is_stated(tmp_path, drift):
    z = []
    for seed in range(8):
        fits = []
        for half in (slice(0, 10000), slice(10000, 20000)):
            machine, log = drifting(tmp_path, drift, seed, half)
            fits.append(aw.identification.identify_arm(log, machine.arm, record=False, checks=()).fit)
        one, other = fits
        z.append((one.values - other.values) / np.hypot(one.std, other.std))
    assert np.sqrt((np.concatenate(z) ** 2).mean()) < 1.3

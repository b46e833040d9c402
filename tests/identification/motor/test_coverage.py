"""Intervals of all defaults on logs of a simulator that is not ours; `tools/motor_seeds.py` has the table of 100 seeds."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from identification.motor_simulator import CASES, PATHS, Bench, Motor, deviations, write_log

INDUCTANCE = "motor.motor.inductance_h"
FEW = 3  # seeds


def errors(folder, case: str, seeds: int) -> tuple[np.ndarray, list[aw.identification.Estimate]]:
    """(seeds, parameters) errors in stated deviations, and the estimates."""
    motor, bench = CASES[case]
    found = [
        aw.identification.identify_motor(write_log(folder, motor, bench, seed), progress=False).estimate
        for seed in range(seeds)
    ]
    return np.array([list(deviations(each, motor, bench).values()) for each in found]), found


@pytest.mark.study
def test_an_inductance_that_nobody_named_is_found(tmp_path):
    """L/R = 0.33 ms at rows of 1 ms: without it R is wrong by 0.6 %, J by 3 %, and the delay by the time constant."""
    z, estimates = errors(tmp_path, "L/R 0.33 ms", FEW)
    assert np.sqrt(np.mean(z**2)) < 1.5
    assert np.abs(z).max() < 4.0
    for estimate in estimates:
        assert estimate[INDUCTANCE] == pytest.approx(CASES["L/R 0.33 ms"][0].L, rel=0.05)
        assert "inductance_h is fitted too" in str(estimate)


def test_an_inductance_that_rows_do_not_tell_widens_the_delay(tmp_path):
    """A motor without one; a lag of a hundredth of a sample cannot be told from as much more delay."""
    z, estimates = errors(tmp_path, "no inductance", 1)
    (estimate,) = estimates
    assert INDUCTANCE not in estimate.names
    assert np.abs(z).max() < 3.0
    period = CASES["no inductance"][1].period
    assert estimate.std[estimate.number("delay_s")] > 2e-3 * period
    assert "an inductance is not found, nor ruled out" in str(estimate)


def test_a_motor_without_dry_friction_is_fitted_like_any(tmp_path):
    """Its coarse guess has none; a search that began there could not stick, nor would it look for an inductance."""
    motor, bench = Motor(C=1e-9), Bench(rows=1000)
    estimate = aw.identification.identify_motor(write_log(tmp_path, motor, bench, 0), progress=False).estimate
    assert estimate[INDUCTANCE] == pytest.approx(motor.L, rel=0.1)
    assert estimate[PATHS["coulomb"]] == pytest.approx(0.0, abs=2e-5)
    assert estimate[PATHS["R"]] == pytest.approx(motor.R, rel=0.02)


@pytest.mark.study
@pytest.mark.parametrize("case", CASES)
def test_intervals_hold(tmp_path, case):
    z, _ = errors(tmp_path, case, FEW)
    known = z[np.isfinite(z)]
    assert len(known) >= 5 * FEW
    assert np.sqrt(np.mean(known**2)) < 1.6
    assert np.abs(known).max() < 4.5

"""Standard deviations of the record as measurements of its numbers: what they add, and where they contradict the log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError
from armwright.identification import MotorSearch
from identification.motor_truth import PATHS, TRUE, true_record, write_log
from raises_at import raises_at

R, KT = PATHS["R"], PATHS["Kt"]


def with_prior(folder: Path, value: float, std: float) -> Path:
    """Path of the record with a resistance that is known so well."""
    path = true_record(folder)
    quantity = f"resistance_ohm = {{ value = {value}, std = {std} }}"
    path.write_text(path.read_text().replace(f"resistance_ohm = {TRUE['R']}", quantity))
    return path


def test_a_prior_tells_what_the_log_does_not(tmp_path):
    """Without a current R, J and Coulomb friction are known as ratios: their relative deviations are hardly more than its."""
    log = write_log(tmp_path, 0, ("qd",), rows=800)
    fit = aw.identification.identify_motor(
        log,
        with_prior(tmp_path, 1.25, 0.05),
        free=["R", "Kt", "J", "coulomb", "delay"],
        fixed={"viscous": TRUE["viscous"]},
        search=MotorSearch(priors=True, starts=1),
    )
    estimate = fit.estimate
    assert estimate.identifiable[estimate.number(R)]
    assert estimate[R] == pytest.approx(1.25, rel=1e-2)
    for name in ("R", "J", "coulomb"):
        k = estimate.number(PATHS[name])
        assert 0.038 < estimate.std[k] / estimate.values[k] < 0.06, name
    assert "0.05 Ω in the record is a prior; the log adds next to nothing" in str(estimate)


@pytest.mark.study
def test_two_measurements_of_one_number_are_weighed(tmp_path):
    """Posterior of two normal measurements: weights by their variances."""
    log = write_log(tmp_path, 0, rows=800)
    alone = aw.identification.identify_motor(log, true_record(tmp_path), search=MotorSearch(starts=1)).estimate
    k = alone.number(R)
    value, std = float(alone.values[k]), float(alone.std[k])
    prior = value + 2.0 * std
    both = aw.identification.identify_motor(
        log, with_prior(tmp_path, prior, std), search=MotorSearch(priors=True, starts=1)
    ).estimate
    assert both[R] == pytest.approx(value + std, abs=0.25 * std), "half way: both are known as well"
    assert both.std[k] == pytest.approx(std / np.sqrt(2.0), rel=0.1)
    far = aw.identification.identify_motor(
        log, with_prior(tmp_path, 1.5, 0.02), search=MotorSearch(priors=True, starts=1)
    ).estimate
    assert "the log and the record contradict each other" in str(far)


def test_priors_need_a_record_that_states_them(tmp_path):
    log = write_log(tmp_path, 0, rows=200)
    with raises_at(ModelError, "priors", value=True):
        aw.identification.identify_motor(log, search=MotorSearch(priors=True))
    with raises_at(ModelError, "priors", "standard deviation"):
        aw.identification.identify_motor(log, true_record(tmp_path), search=MotorSearch(priors=True))

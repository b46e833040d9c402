"""Measures agree with closed forms, with SciPy, and with textbook examples worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from armwright.fitting.measures import agreement, rms


def test_by_hand():
    found = agreement(np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 2.0, 3.0, 5.0]))
    assert found.rows == 4
    assert found.rms == pytest.approx(0.5)
    assert found.measured_rms == pytest.approx(7.5**0.5)
    assert found.r2 == pytest.approx(1 - 1 / 5)
    assert found.nrmse == pytest.approx(5**-0.5)
    assert found.fit == pytest.approx(100 * (1 - 5**-0.5))
    assert found.vaf == pytest.approx(100 * (1 - 0.75 / 5))  # the offset of the residual, 1/4, is forgiven
    assert found.bias == pytest.approx(-0.25)


def test_gain_and_correlation_against_scipy():
    rng = np.random.default_rng(1)
    predicted = rng.normal(size=500)
    measured = 0.5 * predicted + 3.0 + 0.1 * rng.normal(size=500)
    found, line = agreement(measured, predicted), np.polyfit(predicted, measured, 1)
    assert (found.gain, found.correlation) == pytest.approx((line[0], stats.pearsonr(predicted, measured)[0]))
    assert found.vaf == pytest.approx(100 * (1 - (measured - predicted).var() / measured.var()))
    assert found.r2 < 0 < found.correlation


def test_the_mean_as_prediction_explains_nothing():
    y = np.sin(np.arange(100.0))
    found = agreement(y, np.full(100, y.mean()))
    assert found.r2 == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(found.gain)


def test_a_constant_signal_has_no_relative_measures():
    found = agreement(np.full(10, 2.0), np.full(10, 1.5))
    assert np.isnan([found.r2, found.fit, found.vaf, found.correlation]).all()
    assert found.rms == pytest.approx(0.5)


def test_rows_that_are_not_finite_are_left_out():
    y = np.array([1.0, np.nan, 3.0, 4.0])
    assert agreement(y, np.array([1.0, 2.0, np.nan, 4.0])).rows == 2
    assert agreement(y, np.full(4, np.nan)).rows == 0
    assert rms(np.array([3.0, 4.0])) == pytest.approx(12.5**0.5)

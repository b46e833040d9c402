"""Tests of residuals against their definitions summed in plain loops, and against processes whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal, stats

from armwright.fitting.residuals import autocorrelation, cross_correlation, ljung_box, parts_of, residual_spectrum
from armwright.identification.logs.delay import delay_of

WHOLE = [slice(0, 2000)]


def ar1(pole: float, rows: int = 2000, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=rows)
    return np.asarray(signal.lfilter([1.0], [1.0, -pole], noise))


def test_autocorrelation_and_ljung_box_by_hand():
    e = np.array([1.0, -2.0, 0.5, 1.5, -1.0, 0.0, 2.0, -2.0])
    found = autocorrelation(e, [slice(0, 8)], 2)
    assert found is not None
    power = sum(x * x for x in e)
    r = [sum(e[t] * e[t + k] for t in range(8 - k)) / power for k in (1, 2)]
    assert found.values == pytest.approx(r)
    assert found.bound == pytest.approx(2.5758 / 8**0.5, rel=1e-4)
    test = ljung_box(found, 8)
    assert test.q == pytest.approx(8 * 10 * (r[0] ** 2 / 7 + r[1] ** 2 / 6))
    assert test.p == pytest.approx(1 - stats.chi2.cdf(test.q, 2))


def test_white_residuals_pass_as_often_as_the_test_says():
    p = []
    for seed in range(200):
        found = autocorrelation(ar1(0.0, seed=seed), WHOLE)
        assert found is not None
        p.append(ljung_box(found, 2000).p)
    assert stats.kstest(p, "uniform").pvalue > 1e-3  # p is uniform where the residual is white


def test_coloured_residuals_fail_and_have_their_poles_correlation():
    found = autocorrelation(ar1(0.6), WHOLE)
    assert found is not None
    assert found.values[:3] == pytest.approx([0.6, 0.36, 0.216], abs=0.08)
    assert ljung_box(found, 2000).p < 1e-6
    assert found.outside > 0.1


def test_products_do_not_reach_over_gaps():
    e = ar1(0.9)
    halves = autocorrelation(e, [slice(0, 1000), slice(1000, 2000)], 1)
    assert halves is not None
    centred = e - e.mean()
    expected = sum(centred[t] * centred[t + 1] for t in range(1999) if t != 999) / (centred @ centred)
    assert halves.values[0] == pytest.approx(expected)
    assert parts_of(np.array([0, 0, 1, 1, 1, 0])) == [slice(0, 2), slice(2, 5), slice(5, 6)]


def test_cross_correlation_finds_what_the_model_missed_and_when():
    u = ar1(0.5, seed=3)
    missed = np.roll(u, 4)  # of the input four rows earlier
    found = cross_correlation(missed + ar1(0.0, seed=4), u, WHOLE)
    assert found is not None
    lag, value = found.largest
    assert (lag, value > found.bound) == (4, True)


def test_cross_correlation_of_unrelated_signals_keeps_its_bound():
    outside = []
    for seed in range(60):  # both coloured: a bound for white signals would be left far more often
        found = cross_correlation(ar1(0.8, seed=seed), ar1(0.8, seed=1000 + seed), WHOLE)
        assert found is not None
        outside.append(found.outside)
    assert np.mean(outside) < 0.03


def test_spectrum_holds_the_variance():
    e, y = ar1(0.7), ar1(0.95, seed=9)
    found = residual_spectrum(e, y, WHOLE, 100.0)
    assert found is not None
    f, residual, measured = found
    assert residual.sum() * (f[1] - f[0]) == pytest.approx(e.var(), rel=0.1)
    assert measured.sum() * (f[1] - f[0]) == pytest.approx(y.var(), rel=0.3)


@pytest.mark.parametrize("delay", [0.0, 0.4, 2.3, -1.5])
def test_a_known_delay_is_found(delay):
    t = np.arange(2000.0)
    smooth = lambda t: np.sin(0.05 * t) + 0.5 * np.sin(0.13 * t + 1.0)  # noqa: E731
    noise = 0.01 * np.random.default_rng(5).normal(size=2000)
    found = delay_of(smooth(t - delay) + noise, smooth(t), [slice(0, 1000), slice(1000, 2000)])
    assert found is not None
    assert found.samples == pytest.approx(delay, abs=0.05)
    assert found.std < 0.05


def test_no_delay_is_told_of_signals_that_are_not_alike():
    assert delay_of(ar1(0.5), ar1(0.5, seed=8), WHOLE) is None
    assert delay_of(np.ones(2000), ar1(0.5), WHOLE) is None


def test_residuals_without_change_have_no_correlation():
    assert autocorrelation(np.zeros(100), [slice(0, 100)]) is None
    assert autocorrelation(np.zeros(0), []) is None
    assert cross_correlation(ar1(0.5), np.full(2000, np.nan), WHOLE) is None
    assert residual_spectrum(np.zeros(9), np.zeros(9), [slice(0, 9)], 1.0) is None

"""Stated deviations of least squares are those of the fits, whatever the correlation of the noise."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.fitting.covariance import covariance_of
from fitting.noise import RHOS, ar1, ratios

ROWS, DRAWS = 3000, 200


def columns(rows: int = ROWS) -> np.ndarray:
    """(rows, 2, 3) of two signals: a level, a slow wave and a fast one, each seen by both."""
    t = np.arange(rows) / rows
    waves = np.stack([np.ones(rows), np.sin(2 * np.pi * 8 * t), np.sign(np.sin(2 * np.pi * 40 * t))], axis=1)
    return np.stack([waves, waves[:, ::-1] * [1.0, -0.5, 2.0]], axis=1)


def stated_by_true(noise) -> np.ndarray:
    """Ratios of deviations, of noise (rows, 2) by its seed."""
    X, values, stds = columns(), [], []
    flat = X.reshape(-1, X.shape[2])
    for seed in range(DRAWS):
        e = noise(seed)
        value = np.linalg.lstsq(flat, e.ravel(), rcond=None)[0]
        values.append(value)
        stds.append(np.sqrt(np.diag(covariance_of([(X, e - X @ value)]))))
    return ratios(values, stds)


@pytest.mark.study
@pytest.mark.parametrize("rho", RHOS)
def test_deviations_are_those_of_the_fits(rho):
    found = stated_by_true(lambda seed: ar1(rho, ROWS, 2, seed) * [1.0, 3.0])
    assert (np.abs(found - 1.0) < 0.15).all(), found


@pytest.mark.study
def test_differences_of_rounded_signals_take_less():
    """Negatively correlated noise leaves less in a level than white noise does; an autoregression of 12 rows sees most of it."""
    found = stated_by_true(
        lambda seed: np.diff(ar1(0.0, ROWS + 1, 2, seed), axis=0) + 0.3 * ar1(0.0, ROWS, 2, seed + DRAWS)
    )
    assert (found > 0.85).all(), found
    assert (found < 1.35).all(), found


def test_missing_rows_count_nothing():
    X, e = columns(), ar1(0.9, ROWS, 2)
    gone = np.zeros(ROWS, dtype=bool)
    gone[1000:1100] = True
    blocks = [(X[:1000], e[:1000]), (X[1100:], e[1100:])]
    lost = np.where(gone[:, None], np.nan, e)
    whole = covariance_of([(np.where(gone[:, None, None], 0.0, X), lost)])
    np.testing.assert_allclose(np.diag(whole), np.diag(covariance_of(blocks)), rtol=0.1)


def test_a_prior_is_a_measurement():
    X, e, prior = columns(), ar1(0.0, ROWS, 2), np.diag([1e9, 0.0, 0.0])
    found = covariance_of([(X, e)], prior)
    assert found[0, 0] == pytest.approx(1e-9, rel=0.01)
    assert found[1, 1] == pytest.approx(covariance_of([(X[:, :, 1:], e)])[0, 0], rel=0.1)

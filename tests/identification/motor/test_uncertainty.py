"""Covariance of a fit with correlated residuals against the spread of the fits themselves; repeated counts."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from armwright.identification.motor.measured import rows_of_count
from armwright.identification.motor.uncertainty import covariance

ROWS, DRAWS = 4000, 300


@pytest.mark.parametrize(
    ("numerator", "denominator", "least", "most"),
    [([1.0], [1.0], 0.95, 1.05), ([1.0], [1.0, -0.7], 0.8, 1.05), ([1.0, -0.5], [1.0], 0.95, 1.5)],
    ids=["white", "positively correlated", "negatively correlated"],
)
def test_deviations_are_those_of_the_fits(numerator, denominator, least, most):
    """A level and a slow wave in noise: deviations of least squares as stated, by the spread over draws."""
    rng = np.random.default_rng(0)
    jacobian = np.column_stack([np.ones(ROWS), np.sin(2 * np.pi * np.arange(ROWS) / 500)])
    problem = SimpleNamespace(prior=None, targets=[np.zeros((ROWS, 1))], stretches=[SimpleNamespace(t=np.arange(ROWS))])
    fits, stated = [], []
    for _ in range(DRAWS):
        noise = lfilter(numerator, denominator, rng.standard_normal(ROWS))
        fit, *_ = np.linalg.lstsq(jacobian, noise, rcond=None)
        fits.append(fit)
        stated.append(np.diag(covariance(problem, noise - jacobian @ fit, jacobian)))  # pyright: ignore[reportArgumentType]
    ratio = np.sqrt(np.mean(stated, axis=0)) / np.std(fits, axis=0)
    assert (ratio > least * 0.92).all(), ratio
    assert (ratio < most * 1.08).all(), ratio


def test_rows_that_hold_a_count_share_its_weight():
    counts = np.array([3.0, 3.0, 3.0, 4.0, 5.0, 5.0, 3.0])
    rows = rows_of_count(counts)
    np.testing.assert_array_equal(rows, [3, 3, 3, 1, 2, 2, 1])
    assert (1.0 / rows).sum() == pytest.approx(4.0), "as many measurements as changes"

"""Recursive least squares is least squares: of all rows without forgetting, of fading rows with it."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.errors import IdentificationError
from armwright.identification.arm.recursive import RecursiveEstimate


def rows(count: int = 400, p: int = 7, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of columns of very unequal size, their measurements, and the truth."""
    rng = np.random.default_rng(seed)
    truth = rng.normal(size=p)
    Y = rng.normal(size=(count, p)) * np.geomspace(1e-3, 1e3, p)
    return Y, Y @ truth + 0.1 * rng.normal(size=count), truth


def fading(Y, y, forgetting):
    """Least squares with weights λ^(age)."""
    root = np.sqrt(forgetting ** np.arange(len(y) - 1, -1, -1.0))
    size = np.linalg.norm(Y, axis=0)
    return np.linalg.lstsq(root[:, None] * Y / size, root * y, rcond=None)[0] / size


@pytest.mark.parametrize("block", [1, 7, 400])
@pytest.mark.parametrize("forgetting", [1.0, 0.98])
def test_it_is_least_squares_at_its_end(block, forgetting):
    Y, y, _ = rows()
    estimate = RecursiveEstimate.begin(7, forgetting)
    for begin in range(0, len(y), block):
        estimate = estimate.with_rows(Y[begin : begin + block], y[begin : begin + block])
    whole = fading(Y, y, forgetting)
    np.testing.assert_allclose(estimate.values, whole, rtol=0, atol=1e-9 * np.linalg.norm(whole))
    assert estimate.rows == 400
    assert estimate.memory == pytest.approx(np.sum(forgetting ** np.arange(400.0)))


def test_covariance_is_that_of_least_squares():
    Y, y, _ = rows()
    estimate = RecursiveEstimate.begin(7).with_rows(Y, y)
    residual = y - Y @ np.linalg.lstsq(Y, y, rcond=None)[0]
    assert estimate.variance == pytest.approx(residual @ residual / (400 - 7))
    np.testing.assert_allclose(estimate.covariance, estimate.variance * np.linalg.inv(Y.T @ Y), rtol=1e-8)


def test_it_follows_a_parameter_that_changes():
    Y, y, truth = rows(1000)
    changed = truth + 1.0
    y[500:] += Y[500:] @ (changed - truth)
    fast = RecursiveEstimate.begin(7, 0.95).with_rows(Y, y).values
    slow = RecursiveEstimate.begin(7).with_rows(Y, y).values
    assert np.abs(fast - changed)[-1] < 1e-3 < 0.1 < np.abs(slow - changed)[-1]


def test_before_there_is_enough_nothing_is_made_up():
    Y, y, _ = rows()
    estimate = RecursiveEstimate.begin(7)
    for k in range(6):
        assert not estimate.identifiable
        assert np.isnan(estimate.values).all()
        estimate = estimate.with_rows(Y[k], y[k])
    assert np.isnan(estimate.values).all()
    estimate = estimate.with_rows(Y[6], y[6])
    np.testing.assert_allclose(estimate.values, np.linalg.solve(Y[:7], y[:7]), rtol=1e-6)
    assert np.isinf(estimate.variance)


def test_a_start_is_a_prior():
    Y, y, truth = rows()
    start = truth + 0.3
    estimate = RecursiveEstimate.begin(7, start=start, std=np.full(7, 2.0))
    np.testing.assert_allclose(estimate.values, start)
    estimate = estimate.with_rows(Y[:3], y[:3], weights=4.0)
    information = np.eye(7) / 4 + 4 * Y[:3].T @ Y[:3]
    expected = np.linalg.solve(information, start / 4 + 4 * Y[:3].T @ y[:3])
    np.testing.assert_allclose(estimate.values, expected, rtol=1e-6)


def test_bad_input_is_refused():
    Y, y, _ = rows()
    for forgetting in (0.0, 1.1, np.nan):
        with pytest.raises(IdentificationError, match="forgetting"):
            RecursiveEstimate.begin(7, forgetting)
    estimate = RecursiveEstimate.begin(7)
    with pytest.raises(IdentificationError, match="shapes"):
        estimate.with_rows(Y[:, :5], y)
    with pytest.raises(IdentificationError, match="finite"):
        estimate.with_rows(Y, y * np.nan)

"""Essential parameters: what a log does not tell goes, what it tells stays, and the residual hardly grows."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.errors import IdentificationError
from armwright.identification.arm.essential import essential_parameters


def problem(seed: int = 0):
    """R, z, residual of 600 rows; parameters 0 to 4 are large, 5 to 9 tiny beside their deviation."""
    rng = np.random.default_rng(seed)
    truth = np.concatenate([[3.0, -2.0, 1.0, 0.5, -0.4], 1e-3 * rng.normal(size=5)])
    A = rng.normal(size=(600, 10)) * np.geomspace(0.1, 10, 10)[rng.permutation(10)] ** 0.3
    y = A @ truth + 0.2 * rng.normal(size=600)
    factor = np.linalg.qr(np.column_stack([A, y]), mode="r")
    return A, y, truth, (factor[:10, :10], factor[:10, 10], abs(factor[10, 10]), 600)


def test_only_what_the_log_tells_is_left():
    A, y, truth, (R, z, residual, rows) = problem()
    found = essential_parameters(R, z, residual, rows, growth=0.02)
    assert found.kept.tolist() == [0, 1, 2, 3, 4]
    assert sorted(found.dropped) == [5, 6, 7, 8, 9]
    assert (found.values[5:] == 0).all()
    few = np.linalg.lstsq(A[:, :5], y, rcond=None)
    np.testing.assert_allclose(found.values[:5], few[0], rtol=1e-10)
    assert 1 + found.growth == pytest.approx(np.sqrt(few[1][0]) / residual)
    assert found.growth < 0.02
    variance = few[1][0] / (600 - 5)
    np.testing.assert_allclose(found.covariance, variance * np.linalg.inv(A[:, :5].T @ A[:, :5]), rtol=1e-9)
    np.testing.assert_allclose(found.values[:5], truth[:5], atol=0.1)


def test_growth_bounds_the_residual():
    *_, args = problem()
    assert essential_parameters(*args, growth=0.0).dropped == ()
    assert essential_parameters(*args, growth=10.0, well_told=0.0).growth <= 10.0
    assert len(essential_parameters(*args, growth=10.0, well_told=0.0).kept) < 5


def test_wider_deviations_drop_more():
    *_, args = problem()
    wide = np.ones(10)
    wide[7] = 1e6
    assert essential_parameters(*args, inflation=wide).dropped[0] == 7


def test_bad_input_is_refused():
    *_, (R, z, residual, rows) = problem()
    with pytest.raises(IdentificationError, match="rows"):
        essential_parameters(R, z, residual, 8)
    R[:, 3] = R[:, 2]
    with pytest.raises(IdentificationError, match="distinguish"):
        essential_parameters(R, z, residual, rows)

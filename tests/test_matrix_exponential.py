"""Exponentials of matrices beside SciPy's."""

import numpy as np
import pytest
from scipy.linalg import expm

from armwright.matrix_exponential import matrix_exponential


@pytest.mark.parametrize("size", [1e-9, 0.1, 3.0, 60.0])
def test_matrix_exponential(size):
    a = size * np.random.default_rng(2).normal(size=(6, 5, 5)) / 5
    expected = expm(a)
    assert np.abs(matrix_exponential(a) - expected).max() <= 1e-12 * np.abs(expected).max()

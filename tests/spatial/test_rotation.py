"""Rotations of every kind and size of axis."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.spatial import rotation_to_axis


@pytest.mark.parametrize("size", [1e-320, 1e-200, 1e-12, 1.0, 3.0, 1e200, 1.7e308])
@pytest.mark.parametrize("axis", [(0, 1, 0), (0, 0, -1), (1, -1, 0.5), (0.3, 0.2, 0.9)])
@pytest.mark.filterwarnings("error")
def test_only_the_direction_of_an_axis_counts(axis, size):
    with np.errstate(all="raise", under="ignore"):
        turned = rotation_to_axis(size * np.array(axis, dtype=float))
    rtol = 1e-3 if size < 1e-300 else 1e-12  # the smallest floats have few digits
    np.testing.assert_allclose(turned[:, 2], np.array(axis) / np.linalg.norm(axis), rtol=rtol, atol=1e-12)
    np.testing.assert_allclose(turned @ turned.T, np.eye(3), atol=1e-12)

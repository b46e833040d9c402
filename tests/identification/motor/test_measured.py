"""Rows of an encoder that hold one count."""

from __future__ import annotations

import numpy as np
import pytest

from armwright.identification.motor.measured import rows_of_count


def test_rows_that_hold_a_count_share_its_weight():
    counts = np.array([3.0, 3.0, 3.0, 4.0, 5.0, 5.0, 3.0])
    rows = rows_of_count(counts)
    np.testing.assert_array_equal(rows, [3, 3, 3, 1, 2, 2, 1])
    assert (1.0 / rows).sum() == pytest.approx(4.0), "as many measurements as changes"

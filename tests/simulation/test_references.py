"""References as functions of time are differentiated exactly."""

import numpy as np

from armwright import scalar
from armwright.simulation.references import reference_notes, reference_rows
from physics.arms import arm

T = np.linspace(0.0, 1.0, 11)


def test_speed_and_acceleration_follow_from_the_position():
    model = arm("cmu-dd")
    rows = reference_rows(model, lambda t: scalar.array([0.3 * scalar.sin(3.0 * t), t * t, 0.1, 0.0, 0.0, 0.0]), T)
    np.testing.assert_allclose(rows[:, 0], 0.3 * np.sin(3 * T), atol=1e-15)
    np.testing.assert_allclose(rows[:, 6], 0.9 * np.cos(3 * T), atol=1e-14)
    np.testing.assert_allclose(rows[:, 12], -2.7 * np.sin(3 * T), atol=1e-14)
    np.testing.assert_allclose(rows[:, [1, 7, 13]], np.stack([T * T, 2 * T, 2 + 0 * T], axis=1), atol=1e-14)
    assert not rows[:, [8, 14]].any()
    assert reference_notes(model, rows, T) == []

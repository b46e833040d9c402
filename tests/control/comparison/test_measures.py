"""Path errors, settling and overshoot against curves whose answers are known."""

import numpy as np
import pytest

from armwright.control.comparison.measures import (
    attained_points,
    last_direction,
    overshoot,
    path_errors,
    settling_time,
    tool_path,
)

T = np.linspace(0.0, 2.0, 4001)


def circle(t, radius=0.3):
    angle = np.pi * t
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.1 + 0.0 * t], axis=-1)


def there_and_back(t):
    x = 0.5 * np.sin(0.5 * np.pi * t)
    return np.stack([x, 0.0 * t, 0.0 * t], axis=-1)


def errors(path, *tools):
    found = tool_path(T, path)
    assert found is not None
    return path_errors(found, attained_points(found, T, np.array(tools)))


def test_a_tool_that_is_late_on_its_path_has_no_path_error():
    later = np.maximum(T - 0.07, 0.0)  # it stops short of the end of the circle, all points but the last are crossed
    late = errors(circle(np.minimum(T, 1.5)), circle(np.minimum(later, 1.5)))
    assert late.largest < 1e-6
    assert late.accuracy < 1e-6


def test_a_circle_of_another_radius():
    for radius in (0.29, 0.32):
        found = errors(circle(T), circle(T, radius))
        assert found.mean == pytest.approx(abs(radius - 0.3), rel=1e-4)
        assert found.largest == pytest.approx(abs(radius - 0.3), rel=1e-4)
        assert np.isnan(found.repeatability)


def test_the_way_back_is_compared_with_the_way_back():
    beside = there_and_back(T)
    beside[T > 1.0, 1] = 2e-3  # 2 mm beside the path on the way back, which lies on the way there
    found = errors(there_and_back(T), beside)
    assert found.largest == pytest.approx(2e-3, rel=1e-6)
    assert found.mean == pytest.approx(1e-3, rel=1e-2)


def test_a_tool_that_stops_short_of_a_turn_is_measured_there():
    """Down to a place, up, aside, and down to another: 10 mm short of the first bottom, it crosses that height at the second."""

    def way(bottom):
        corners = np.array([[0.0, 0.0, 0.3], [0.0, 0.0, bottom], [0.0, 0.0, 0.3], [0.6, 0.0, 0.3], [0.6, 0.0, -0.1]])
        return np.stack([np.interp(T, np.linspace(0.0, 2.0, 5), column) for column in corners.T], axis=-1)

    found = errors(way(0.0), way(1e-2))
    assert found.largest < 1.2e-2


def test_accuracy_and_repeatability_of_runs_beside_the_path():
    offsets = np.array([1e-3, 2e-3, 4e-3, 5e-3])
    tools = [there_and_back(T) + np.array([0.0, 0.0, z]) for z in offsets]
    found = errors(there_and_back(T), *tools)
    spread = np.abs(offsets - offsets.mean())
    assert found.accuracy == pytest.approx(3e-3, rel=1e-6)
    assert found.mean == pytest.approx(3e-3, rel=1e-6)
    assert found.repeatability == pytest.approx(spread.mean() + 3.0 * spread.std(ddof=1), rel=1e-6)


def test_a_tool_that_stands_has_no_path():
    assert tool_path(T, np.zeros((len(T), 3))) is None


def test_settling_of_an_exponential():
    tau, band, end = 0.1, 1e-2, 0.5
    error = np.exp(-(T - end) / tau)[None, :, None] * np.array([1.0, -2.0, 0.0])
    found = settling_time(T, error, end, np.full(3, band))
    expected = [tau * np.log(1.0 / band), tau * np.log(2.0 / band), 0.0]
    np.testing.assert_allclose(found[0], expected, atol=T[1])
    assert np.isinf(settling_time(T, error + 0.1, end, np.full(3, band))).all()


def test_overshoot_counts_in_the_sense_of_the_motion():
    q = np.array([[[0.9, -0.9, 0.2], [1.1, -1.2, 0.3], [1.0, -1.0, 0.1]]])
    goal, direction = np.array([1.0, -1.0, 0.0]), last_direction(np.array([[1.0, -2.0, 0.0], [0.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(direction, [1.0, -1.0, 0.0])
    np.testing.assert_allclose(overshoot(q, goal, direction)[0], [0.1, 0.2, 0.0])

"""Geometric paths: splines through waypoints, against SciPy and closed forms; what is refused."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from armwright.errors import ScenarioError
from armwright.trajectory.path import JointPath

POINTS = np.array([[0.0, 0.3], [1.0, -0.4], [1.5, 0.2], [0.2, 0.9]])


def test_a_path_is_the_natural_spline_by_chords() -> None:
    path = JointPath(POINTS)
    chords = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(POINTS, axis=0), axis=1))])
    assert path.n == 2
    assert path.length == pytest.approx(chords[-1])
    np.testing.assert_array_equal(path.breaks, chords)
    s, spline = np.linspace(0.0, path.length, 57), CubicSpline(chords, POINTS, bc_type="natural")
    for order, found in enumerate(path.at(s)):
        np.testing.assert_allclose(found, spline(s, order), rtol=0, atol=1e-12)
    np.testing.assert_allclose(path.derivative(s, 3), spline(s, 3))
    np.testing.assert_allclose(path.at([0.0, path.length])[2], 0.0, atol=1e-12)


def test_two_waypoints_make_a_straight_line() -> None:
    path = JointPath([[0.0, 1.0], [3.0, 5.0]])
    q, first, second = path.at([0.0, 2.5, 5.0])
    np.testing.assert_allclose(q, [[0.0, 1.0], [1.5, 3.0], [3.0, 5.0]])
    np.testing.assert_allclose(first, np.tile([0.6, 0.8], (3, 1)))
    np.testing.assert_allclose(second, 0.0, atol=1e-15)


def test_a_parameter_of_its_own_is_kept() -> None:
    path = JointPath(POINTS, [0.0, 1.0, 4.0, 5.0])
    np.testing.assert_allclose(path.at(4.0)[0], POINTS[2], atol=1e-15)
    assert path.at(np.zeros((2, 3)))[1].shape == (2, 3, 2)


@pytest.mark.parametrize("points", [POINTS, [[0.0, 1.0], [3.0, 1.0]], [[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]]])
def test_extremes_are_those_of_a_dense_grid(points) -> None:
    path = JointPath(points)
    s, values = path.extremes()
    dense = path.at(np.linspace(0.0, path.length, 20001))[0]
    np.testing.assert_allclose(values, np.stack([dense.min(axis=0), dense.max(axis=0)], axis=1), atol=1e-6)
    for joint in range(path.n):
        np.testing.assert_allclose(path.at(s[joint])[0][:, joint], values[joint], atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "place"),
    [
        (([[0.0, 1.0]],), "JointPath.waypoints"),
        (([[0.0, 1.0], [0.0, 1.0]],), "JointPath.waypoints"),
        (([[0.0], [1.0], [1.0], [2.0]],), "JointPath.waypoints[2]"),
        (([[0.0, 1.0], [np.nan, 1.0]],), "JointPath.waypoints[1]"),
        (([[0.0, 1.0], [2.0]],), "JointPath.waypoints"),
        (("ab",), "JointPath.waypoints"),
        ((POINTS, [0.0, 1.0, 1.0, 2.0]), "JointPath.parameter"),
        ((POINTS, [1.0, 2.0, 3.0, 4.0]), "JointPath.parameter"),
        ((POINTS, [0.0, 1.0]), "JointPath.parameter"),
        ((POINTS, [0.0, 1.0, np.inf, 4.0]), "JointPath.parameter"),
    ],
)
def test_what_is_no_path_is_refused(arguments, place: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        JointPath(*arguments)
    assert caught.value.problems[0].place == place

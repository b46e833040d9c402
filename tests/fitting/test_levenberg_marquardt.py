"""Searches side by side end where SciPy's do, each by itself."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from armwright.fitting.levenberg_marquardt import Descent, descended


def rosenbrock(x):
    """Errors (lanes, 2) and their derivatives; points beyond 3 are forbidden."""
    e = np.stack([10 * (x[:, 1] - x[:, 0] ** 2), 1 - x[:, 0]], axis=1)
    J = np.zeros((len(x), 2, 2))
    J[:, 0, 0], J[:, 0, 1], J[:, 1, 0] = -20 * x[:, 0], 10.0, -1.0
    e[np.abs(x).max(axis=1) > 3.0] = np.inf
    return e, J


def ends(gained, cost, moved):
    return moved <= 1e-20


def test_every_lane_finds_the_minimum():
    starts = np.array([[-1.2, 1.0], [2.0, -1.0], [0.0, 0.0]])
    found = descended(rosenbrock, Descent.begin(rosenbrock, starts), ends=ends)
    np.testing.assert_allclose(found.x, 1.0, atol=1e-8)
    assert found.ended.all()
    alone = descended(rosenbrock, Descent.begin(rosenbrock, starts[:1]), ends=ends)
    np.testing.assert_array_equal(alone.x[0], found.x[0])


def test_a_move_keeps_bounds():
    """Where the minimum lies outside, the search ends on the bound, as SciPy's does."""

    def move(x, step):
        return np.clip(x + step, -3.0, [0.5, 3.0])

    found = descended(rosenbrock, Descent.begin(rosenbrock, np.array([[-1.0, 1.0]])), move=move, ends=ends, rounds=500)
    expected = least_squares(lambda x: rosenbrock(x[None])[0][0], [-1.0, 1.0], bounds=([-3, -3], [0.5, 3]))
    np.testing.assert_allclose(found.x[0], expected.x, atol=1e-4)


def test_searches_go_on_where_they_were():
    whole = descended(rosenbrock, Descent.begin(rosenbrock, np.array([[-1.2, 1.0]])), ends=ends, trials=9)
    part = descended(rosenbrock, Descent.begin(rosenbrock, np.array([[-1.2, 1.0]])), ends=ends, trials=4)
    part = descended(rosenbrock, part, ends=ends, trials=5)
    np.testing.assert_array_equal(whole.x, part.x)
    assert whole.cost == pytest.approx(part.cost)


def test_a_box_keeps_a_valley_that_meets_a_bound():
    """The least-squares step within bounds, not one that is cut off there: SciPy's end, in few steps."""
    low, high = np.array([-3.0, -3.0]), np.array([0.5, 3.0])

    def box(x):
        return low - x, high - x

    found = descended(rosenbrock, Descent.begin(rosenbrock, np.array([[-1.0, 1.0]])), ends=ends, box=box, trials=60)
    expected = least_squares(lambda x: rosenbrock(x[None])[0][0], [-1.0, 1.0], bounds=(low, high))
    np.testing.assert_allclose(found.x[0], expected.x, atol=1e-6)


def test_bent_steps_follow_a_narrow_valley():
    """With Rosenbrock's valley ten times as narrow, derivatives are taken at a third of the points or fewer."""

    def narrow(x):
        e, J = rosenbrock(x)
        return e * [10.0, 1.0], J * np.array([10.0, 1.0])[:, None]

    def points(errors):
        seen = []

        def evaluate(x):
            seen.append(x)
            return narrow(x)

        begun = Descent.begin(evaluate, np.array([[-1.2, 1.0]]))
        found = descended(evaluate, begun, ends=lambda gained, cost, moved: moved <= 1e-12, rounds=500, errors=errors)
        np.testing.assert_allclose(found.x, 1.0, atol=1e-6)
        return len(seen)

    assert 3 * points(lambda x: narrow(x)[0]) <= points(None)

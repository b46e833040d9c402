"""Weak directions of a matrix whose singular vectors are known."""

import numpy as np

from armwright.fitting.directions import WEAK, directions, gain, in_words, scaled, without

ABOUT = ["mass of link6", "first moment along z of link6", "viscous friction of joint1"]


def weak_directions(matrix):
    return [each for each in directions(scaled(matrix)[0]) if each.condition > WEAK]


def factor(difference: float) -> np.ndarray:
    """Columns m6 and mcz6 that differ by little, and one of its own; scaled by units that must not count."""
    return np.array([[1.0, 1.0, 0.0], [0.0, difference, 0.0], [0.0, 0.0, 1.0]]) * np.array([1e3, 1e-3, 5.0])


def test_columns_that_are_nearly_equal_are_named_together():
    (direction,) = weak_directions(factor(1e-4))
    assert set(direction.members()) == {0, 1}
    assert np.isclose(direction.condition, 2e4, rtol=1e-3)
    words = in_words(direction, ABOUT, "a swing of joint5 by ±90° would")
    assert "mass of link6" in words
    assert (
        "first moment along z of link6 cannot be distinguished" in words
        or "mass of link6 cannot be distinguished" in words
    )
    assert words.endswith("a swing of joint5 by ±90° would")


def test_well_conditioned_columns_need_no_word():
    assert weak_directions(factor(1.0)) == []


def test_column_of_zeros_is_a_direction_by_itself():
    (direction,) = weak_directions(np.diag([1.0, 0.0, 2.0]))
    assert direction.members() == [1]
    assert np.isinf(direction.condition)
    assert "cannot be identified from this motion" in in_words(direction, ABOUT)


def test_gain_is_the_growth_of_the_smallest_singular_value():
    known = np.diag([1.0, 1e-3])
    assert np.isclose(gain(known, np.array([[0.0, 1.0]])), 1e3, rtol=1e-2)
    assert gain(known, np.array([[1.0, 0.0]])) < 1.5


def test_what_nuisances_explain_is_no_direction():
    """Of two columns, one is the nuisance's but for a part of 1e-3: that part alone is left."""
    nuisance = np.array([[1.0], [1.0], [0.0]])
    left = without(np.array([[1.0, 0.0], [1.0, 0.0], [1e-3, 2.0]]), nuisance)
    np.testing.assert_allclose(left, [[0.0, 0.0], [0.0, 0.0], [1e-3, 2.0]], atol=1e-12)
    np.testing.assert_allclose(without(left, 1e-9 * nuisance, least=1e-6), left)

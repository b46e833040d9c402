"""Weak directions of a matrix whose singular vectors are known."""

import numpy as np

from armwright.identification.identifiability import gain, in_words, weak_directions

ABOUT = {"m6": "mass of link6", "mcz6": "first moment along z of link6", "fv1": "viscous friction of joint1"}


def factor(difference: float) -> np.ndarray:
    """Columns m6 and mcz6 that differ by little, and one of its own; scaled by units that must not count."""
    return np.array([[1.0, 1.0, 0.0], [0.0, difference, 0.0], [0.0, 0.0, 1.0]]) * np.array([1e3, 1e-3, 5.0])


def test_columns_that_are_nearly_equal_are_named_together():
    (direction,) = weak_directions(factor(1e-4), ["m6", "mcz6", "fv1"])
    assert set(direction.names) == {"m6", "mcz6"}
    assert np.isclose(direction.condition, 2e4, rtol=1e-3)
    words = in_words(direction, ABOUT, "a swing of joint5 by ±90° would")
    assert "mass of link6" in words
    assert (
        "first moment along z of link6 cannot be distinguished" in words
        or "mass of link6 cannot be distinguished" in words
    )
    assert words.endswith("a swing of joint5 by ±90° would")


def test_well_conditioned_columns_need_no_word():
    assert weak_directions(factor(1.0), ["m6", "mcz6", "fv1"]) == []


def test_column_of_zeros_is_a_direction_by_itself():
    (direction,) = weak_directions(np.diag([1.0, 0.0, 2.0]), ["m6", "mcz6", "fv1"])
    assert direction.names == ("mcz6",)
    assert np.isinf(direction.condition)
    assert "cannot be identified from this motion" in in_words(direction, ABOUT)


def test_gain_is_the_growth_of_the_smallest_singular_value():
    known = np.diag([1.0, 1e-3])
    assert np.isclose(gain(known, np.array([[0.0, 1.0]])), 1e3, rtol=1e-2)
    assert gain(known, np.array([[1.0, 0.0]])) < 1.5

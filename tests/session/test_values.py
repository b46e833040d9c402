"""Values as they are typed: laws of the notation, units, formulas; and everything that is none."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given, strategies as st

from armwright.errors import SessionError
from armwright.session.values import number, split, vector

NAMES = ["a", "b", "c"]
RAD = ["rad"] * 3
NUMBERS = st.floats(-1e6, 1e6)


def none(name, index):
    return None


def typed(text, units=RAD, lookup=none):
    return vector("theta", text, NAMES, units, lookup)


@given(st.lists(NUMBERS, min_size=3, max_size=3), st.sampled_from([" ", ", ", "  ", ","]))
def test_numbers_come_back_to_the_bit(values, between):
    assert typed(between.join(repr(v) for v in values)).tolist() == values


@given(NUMBERS, st.sampled_from(["deg", "rad", "mrad"]))
def test_one_value_is_for_all_and_a_group_shares_its_unit(value, unit):
    assert np.array_equal(typed(f"{value!r} {unit}"), typed(f"[{value!r} {value!r} {value!r}] {unit}"))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("30 deg", [pi / 6] * 3),
        ("30deg 0 pi/2", [pi / 6, 0, pi / 2]),
        ("1 -2 3", [1, -2, 3]),
        ("1 - 2", [-1] * 3),
        ("1 -2 - 3 2*pi", [1, -5, 2 * pi]),
        ("2 * (1 + 1) 0 0", [4, 0, 0]),
        ("(10 + 20) deg 0 0", [pi / 6, 0, 0]),
        ("0 0 30 deg", [0, 0, pi / 6]),
        ("1e-3, .5, -2.5e2", [1e-3, 0.5, -250]),
        ("atan2(1, 1) sin(0) 0", [pi / 4, 0, 0]),
    ],
)
def test_what_is_meant(text, expected):
    assert np.allclose(typed(text), expected, rtol=1e-15, atol=1e-15)


def test_units_with_blanks_and_of_each_joint():
    assert typed("1 N m 2 mN m 3Nm", ["N m"] * 3).tolist() == [1.0, 0.002, 3.0]
    assert typed("90 deg 5 cm 1 rad", ["rad", "m", "rad"]).tolist() == [pi / 2, 0.05, 1.0]
    assert number("t", "5 ms", "s") == 0.005


def test_variables_in_formulas():
    values = {"theta": np.array([1.0, 2.0, 3.0]), "k": 4.0}

    def lookup(name, index):
        return None if name not in values else values[name] if index is None else values[name][NAMES.index(index)]

    assert typed("2*theta", lookup=lookup).tolist() == [2, 4, 6]
    assert typed("theta[b] k -theta[c]", lookup=lookup).tolist() == [2, 4, -3]


REFUSED = [  # text, reason, expectation
    ("1 2", "2 values", "3 (a, b, c), or one for all joints"),
    ("1 2 3 4", "4 values", "3 (a, b, c), or one for all joints"),
    ("", "no value given", ""),
    ("5 V", "unit 'V' does not fit", "rad: rad, deg, °, mrad, rev"),
    ("5 deg/s 0 0", "unit 'deg/s' does not fit", "rad: rad, deg, °, mrad, rev"),
    ("deg", "a unit behind no number", "a number before it, such as 30 deg"),
    ("10 20 30 deg", "only the last value is in deg", "the unit behind each of them, or [...] deg for all"),
    ("[1 deg 2 deg 3 deg] deg", "units inside and behind the bracket", "one of them"),
    ("[1 2 3] parsec", "no unit behind the bracket", "a unit"),
    ("(1 2", "a bracket is not closed", ""),
    ("1) 2 3", "a bracket closes that none opened", ""),
    ("nan", "unknown name in 'nan'", ""),
    ("1/0", "divides by zero", "a finite number"),
    ("9**9**9", "too large", "a finite number"),
    ("1e999", "not finite", "finite numbers"),
    ("sqrt(-1)", "not finite", "finite numbers"),
    ("(-1)**0.5", "a power of a negative number", "a real number"),
    ("spam", "unknown name in 'spam'", ""),
    ("__import__('os')", "unknown function in \"__import__('os')\"", ""),
    ("(1).real", "", "numbers, + - * / **, brackets and functions such as sin(…)"),
    ("[x for x in 1]", "5 values", "3 (a, b, c), or one for all joints"),
    ("'a'*3 0 0", "no number in \"'a'*3\"", ""),
    ("lambda: 1", "2 values", "3 (a, b, c), or one for all joints"),
    ("x[1] 0 0", "no such variable", ""),
    ("1" * 20000, "20000 characters", "at most 10000"),
    ("(" * 400 + "1" + ")" * 400, "", "a number or a formula such as 0.5, 30 deg or pi/2"),
]


@pytest.mark.parametrize(("text", "what", "expected"), REFUSED, ids=[text[:20] for text, *_ in REFUSED])
def test_refused_in_one_line(text, what, expected):
    with pytest.raises(SessionError) as error:
        typed(text)
    assert error.value.place.startswith("theta")
    assert (error.value.what, error.value.expected) == (what, expected)
    assert "\n" not in str(error.value)


@given(st.text(alphabet="0123456789 .,+-*/()[]eEdgramVNpi²°'_x\"", max_size=40))
def test_any_text_is_a_vector_or_one_of_our_errors(text):
    try:
        values = typed(text)
    except SessionError:
        return
    assert np.isfinite(values).all()


def test_split_keeps_formulas_whole():
    assert split("x", "1 2 * 3 deg -4") == [("1", ""), ("2 * 3", "deg"), ("-4", "")]

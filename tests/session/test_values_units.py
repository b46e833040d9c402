"""Units in formulas: each belongs to the number before it; sums of them are the sums worked out by hand."""

from __future__ import annotations

from fractions import Fraction
from math import isclose, pi

import numpy as np
import pytest
from hypothesis import given, strategies as st

from armwright.errors import SessionError
from armwright.expressions import number as plain_number
from armwright.session import Session
from armwright.session.formulas import ACCEPTED
from armwright.session.values import number, split, vector
from session.walks import refused

NAMES = ["a", "b", "c"]
HELD = {"theta": np.array([0.1, 0.2, 0.3]), "k": 4.0}


def lookup(name, index):
    return None if name not in HELD else HELD[name] if index is None else HELD[name][NAMES.index(index)]


def typed(text, units=("rad",) * 3):
    return vector("theta", text, NAMES, units, lookup)


@st.composite
def sums(draw):
    """(the unit that is meant, a sum of numbers with and without units as typed, its value by hand)."""
    kept = draw(st.sampled_from(sorted(ACCEPTED)))
    by_hand, text = Fraction(0), ""
    for k in range(draw(st.integers(1, 5))):
        value = draw(st.decimals(-1000, 1000, places=3, allow_nan=False))
        unit = draw(st.sampled_from(["", *ACCEPTED[kept]]))
        between = draw(st.sampled_from(["", " ", "  "])) if unit else ""
        times = draw(st.sampled_from([1, 1, 2, 5]))
        sign = draw(st.sampled_from("+-")) if k else "+"
        by_hand += (
            (1 if sign == "+" else -1) * times * Fraction(value) * Fraction(ACCEPTED[kept][unit] if unit else 1.0)
        )
        text += f" {sign} " if k else ""
        text += (f"{times} * " if times > 1 else "") + f"{value:f}{between}{unit}"
    return kept, text, float(by_hand)


@given(sums())
def test_a_sum_with_units_is_the_sum_by_hand(drawn):
    kept, text, by_hand = drawn
    assert isclose(number("x", text, kept), by_hand, rel_tol=1e-12, abs_tol=1e-6)


@given(sums())
def test_a_sum_is_the_same_for_all_joints_and_beside_others(drawn):
    kept, text, by_hand = drawn
    assert np.allclose(vector("x", text, NAMES, [kept] * 3, lookup), by_hand, rtol=1e-12, atol=1e-6)
    assert isclose(vector("x", f"0, {text}, 1", NAMES, [kept] * 3, lookup)[1], by_hand, rel_tol=1e-12, abs_tol=1e-6)


@pytest.mark.parametrize(
    "text", ["30deg + 10deg", "pi/2 - 10 deg", "2 * 30 deg", "sin(30 deg)", "-30 deg * 2", "(10 + 20) deg", "90 deg/2"]
)
def test_angles_are_those_of_the_formulas_everywhere(text):
    assert isclose(number("x", text, "rad"), plain_number(text), rel_tol=1e-15)


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        ("30deg + 10deg", [40] * 3),
        ("30 deg + 10 deg", [40] * 3),
        ("30 deg+10 deg", [40] * 3),
        ("pi/2 - 10 deg", [80] * 3),
        ("90 deg + 0.1", [90 + 18 / pi] * 3),
        ("theta + 10 deg", np.degrees(HELD["theta"]) + 10),
        ("theta[b] + 10deg", [np.degrees(0.2) + 10] * 3),
        ("0 30deg 0.5", [0, 30, 90 / pi]),
        ("0 10 deg + 5 deg 1 - 2 deg", [0, 15, 180 / pi - 2]),
        ("[10 20 1 + 29] deg", [10, 20, 30]),
        ("[10, 20, -30]deg", [10, 20, -30]),
        ("clip(theta, -10 deg, 10 deg)", np.minimum(np.degrees(HELD["theta"]), 10)),
        ("2 * (10 deg + 5 deg)", [30] * 3),
        ("(1/2) deg", [0.5] * 3),
        ("90 deg * sin(theta[a])", [90 * np.sin(0.1)] * 3),
        ("0.5 rev + 200 mrad - 1°", [180 + 36 / pi - 1] * 3),
    ],
)
def test_what_is_meant(text, degrees):
    assert np.allclose(np.degrees(typed(text)), degrees, rtol=1e-14, atol=1e-14)


def test_each_joint_reads_the_unit_as_its_own():
    assert typed("theta[a] + 5 cm 1 deg 1 m - 2 mm", ["m", "rad", "m"]).tolist() == [0.1 + 0.05, pi / 180, 1 - 0.002]
    assert number("x", "1 N m - 2 mN m + 3Nm", "N m") == 1.0 - 0.002 + 3.0
    assert number("x", "2 kg m^2 + 1 kg*m²", "kg m²") == 3.0
    assert number("x", "5 V*sin(30 deg)", "V") == pytest.approx(2.5, rel=1e-15)


UNCLEAR = [  # text, reason, expectation
    ("theta deg", "a unit behind no number", "a number before it, such as 30 deg"),
    ("theta[a] deg 0 0", "a unit behind no number", "a number before it, such as 30 deg"),
    ("0 pi deg 0", "a unit behind no number", "a number before it, such as 30 deg"),
    ("theta[a] * 2 deg", "a product of two values with units", "one of them to be a plain number"),
    ("2 deg * 3 deg", "a product of two values with units", "one of them to be a plain number"),
    ("(2 * theta) deg", "a product of two values with units", "one of them to be a plain number"),
    ("30 deg / theta[a]", "a product of two values with units", "one of them to be a plain number"),
    ("[k 1 2] deg", "a product of two values with units", "one of them to be a plain number"),
    (
        "1/2 deg",
        "it is not clear what the unit belongs to",
        "it behind a number or a bracket that nothing divides by or raises, such as (1/2) deg",
    ),
    (
        "1/(2) deg",
        "it is not clear what the unit belongs to",
        "it behind a number or a bracket that nothing divides by or raises, such as (1/2) deg",
    ),
    (
        "2**3 deg",
        "it is not clear what the unit belongs to",
        "it behind a number or a bracket that nothing divides by or raises, such as (1/2) deg",
    ),
    (
        "2 deg**2",
        "it is not clear what the unit belongs to",
        "it behind a number or a bracket that nothing divides by or raises, such as (1/2) deg",
    ),
    (
        "30 deg / 10 deg",
        "it is not clear what the unit belongs to",
        "it behind a number or a bracket that nothing divides by or raises, such as (1/2) deg",
    ),
    ("sqrt(4 deg)", "sqrt(…) of a value with a unit", "plain numbers in sqrt(…)"),
    ("10 deg + 5 cm", "unit 'cm' does not fit", "rad: rad, deg, °, mrad, rev"),
    ("sin(5 V)", "unit 'V' does not fit", "rad: rad, deg, °, mrad, rev"),
    ("30 deg deg", "a unit behind no number", "a number before it, such as 30 deg"),
    ("30 deg + deg 10", "2 values", "3 (a, b, c), or one for all joints"),
    ("10 20 5 + 30 deg", "only the last value is in deg", "the unit behind each of them, or [...] deg for all"),
    ("10 deg + spam", "unknown name in '10 deg + spam'", ""),
    ("10 deg + (1", "a bracket is not closed", ""),
    ("10 deg + + ", "", "a number or a formula such as 0.5, 30 deg or pi/2"),
]


@pytest.mark.parametrize(("text", "what", "expected"), UNCLEAR, ids=[text[:20] for text, *_ in UNCLEAR])
def test_what_could_mean_two_things_is_refused_in_one_line(text, what, expected):
    with pytest.raises(SessionError) as error:
        typed(text)
    assert error.value.place.startswith("theta")
    assert (error.value.what, error.value.expected) == (what, expected)
    assert "\n" not in str(error.value)
    assert "unit_" not in str(error.value)


def test_long_lines_of_units_are_soon_refused():
    for text in ("1 deg + " * 1000 + "1", "1" * 9000, "1 " * 4000, "(1) " * 2000, "((1) deg " * 900):
        with pytest.raises(SessionError):
            typed(text)


def test_split_tells_units_within_from_those_at_the_end():
    assert split("x", "0 0 0.05 + 1 cm") == [("0", ""), ("0", ""), ("0.05 + 1", "cm")]
    assert split("x", "1cm + 2 1N m") == [("1 cm + 2", ""), ("1", "N m")]
    assert split("x", "[1+2 3] mm") == [("(1+2)", "mm"), ("3", "mm")]


def test_in_a_session():
    session = Session()
    session.run("voltage = 3")
    session.run("voltage = voltage + 500 mV")
    assert session.state.u.tolist() == [3.5] * 6
    session.run("theta = 30deg + 10deg")
    session.run("theta[2] = theta[1] + 10deg")
    assert np.allclose(np.degrees(session.state.q), [40, 50, 40, 40, 40, 40], rtol=1e-14)
    session.run('payload 1 com="0 0 0.05 + 1 cm"')
    assert session.state.loaded.payload.com == (0.0, 0.0, 0.05 + 0.01)
    session.run('payload 1 com="[0 0 5 + 1] cm"')
    assert session.state.loaded.payload.com == pytest.approx((0.0, 0.0, 0.06), rel=1e-15)
    assert refused(session, "DACSampTimePeriod = TimeStep * 2 ms").what == "a product of two values with units"
    session.run("DACSampTimePeriod = 2 * TimeStep + 1 ms")
    assert session.state.dac_period == pytest.approx(0.003, rel=1e-15)

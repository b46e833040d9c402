"""Formulas that are typed: arithmetic and nothing else."""

from __future__ import annotations

import contextlib
from math import pi

import numpy as np
import pytest
from hypothesis import given, strategies as st

from armwright import scalar
from armwright.errors import ExpressionError
from armwright.expressions import FUNCTIONS, expression, number
from armwright.scalar import Symbol


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.5", 0.5),
        ("30 deg", pi / 6),
        ("-30deg", -pi / 6),
        ("pi/2", pi / 2),
        ("2*(1 + 3)**2 / 4", 8.0),
        ("1e-3", 1e-3),
        ("atan2(1, -1)", 0.75 * pi),
        ("clip(5, -1, 2)", 2.0),
        ("step(-1e-9) + step(0)", 1.0),
        ("(10 + 5) deg", pi / 12),
    ],
)
def test_values(text, value):
    assert number(text) == pytest.approx(value, rel=1e-15)


NO_REAL_NUMBERS = {
    "(-1)**0.5": "a power of a negative number",
    "abs((-8)**(1/3))": "a power of a negative number",
    "(-t)**0.5": "a power of a negative number",
    "1/(t - t)": "divides by zero",
    "0**-t": "divides by zero",
    "(t*1e200)**2": "too large",
}


@pytest.mark.parametrize(("text", "what"), NO_REAL_NUMBERS.items())
def test_a_value_that_is_no_real_number_is_refused(text, what):
    with pytest.raises(ExpressionError) as error:
        expression(text, ("t",))({"t": 0.25})
    assert (error.value.what, error.value.value) == (what, text)


@pytest.mark.parametrize("text", ["log(0)", "sqrt(-1)", "fmod(1, 0)", "1e308*10", "log(0) - log(0)", "1if(2)"])
def test_what_is_not_finite_is_refused_without_a_warning(text):
    with pytest.raises(ExpressionError):
        number(text)


ARITHMETIC = "numbers, + - * / **, brackets and functions such as sin(…)"
FORMULA = "a number or a formula such as 0.5, 30 deg or pi/2"


@pytest.mark.parametrize(
    ("text", "value", "expected"),
    [
        ("1 +", "1 +", FORMULA),
        ("", "", FORMULA),
        ("\x00", "\x00", FORMULA),
        ("'a'*3", "a", ""),
        ("True", True, ""),
        ("(1).real", "(1).real", ARITHMETIC),
        ("[1][0]", "[1][0]", ARITHMETIC),
        ("lambda: 1", "lambda: 1", ARITHMETIC),
        ("sin(x=1)", "sin(x=1)", ARITHMETIC),
        ("1 if 1 else 2", "1 if 1 else 2", ARITHMETIC),
        ("sin(1, 2)", "sin(1, 2)", "1 value for sin, not 2"),
        ("1/0", "1/0", "a finite number"),
        ("10**400", "10**400", "a finite number"),
        ("9**9**9**9", "9**9**9**9", "a finite number"),
        ("1" * 2000, "1" * 2000, "a formula of at most 1000"),
    ],
)
def test_what_is_not_arithmetic_is_refused(text, value, expected):
    with pytest.raises(ExpressionError) as error:
        number(text)
    assert (error.value.value, error.value.expected) == (value, expected)


@pytest.mark.parametrize(
    ("text", "name", "nearest"), [("sinn(1)", "sinn", "sin"), ("2*x", "x", ""), ("__import__('os')", "__import__", "")]
)
def test_unknown_names_are_told_with_those_that_exist(text, name, nearest):
    with pytest.raises(ExpressionError) as error:
        number(text)
    assert error.value.value == name
    assert set(FUNCTIONS) <= set(error.value.choices)
    assert nearest in str(error.value)


def test_brackets_too_deep_are_refused():
    with pytest.raises(ExpressionError):
        number("(" * 300 + "1" + ")" * 300)


@pytest.mark.study
@given(st.text(max_size=60))
def test_any_text_is_a_number_or_refused(text):
    with contextlib.suppress(ExpressionError):
        assert np.isfinite(number(text))


def test_variables_are_numbers_or_symbols():
    formula = expression("0.3*sin(2*pi*t) + t**2", ("t",))
    assert formula({"t": 0.25}) == pytest.approx(0.3 + 0.0625)
    assert isinstance(formula({"t": Symbol.named("t")}), Symbol)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_are_the_scalars(name):
    count, function = FUNCTIONS[name]
    values = [0.3, 0.7, 0.9][:count]
    text = f"{name}({', '.join(map(str, values))})"
    assert number(text) == pytest.approx(float(function(*values)))
    assert scalar.is_symbolic(expression(f"{name}({', '.join(['t'] * count)})", ("t",))({"t": Symbol.named("t")}))

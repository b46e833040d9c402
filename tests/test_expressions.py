"""Formulas that are typed: arithmetic and nothing else."""

from __future__ import annotations

import contextlib
from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("sinn(1)", "unknown function 'sinn'; did you mean sin"),
        ("2*x", "unknown name 'x'"),
        ("1 +", "expected a number or a formula"),
        ("'a'*3", "'a' is no number"),
        ("True", "True is no number"),
        ("__import__('os')", "unknown function '__import__'"),
        ("(1).real", "expected numbers"),
        ("[1][0]", "expected numbers"),
        ("lambda: 1", "expected numbers"),
        ("sin(1, 2)", "sin takes 1 value, not 2"),
        ("sin(x=1)", "expected numbers"),
        ("1/0", "expected a finite number"),
        ("10**400", "expected a finite number"),
        ("9**9**9**9", "expected a finite number"),
        ("", "expected a number"),
        ("1" * 2000, "2000 characters"),
        ("(" * 300 + "1" + ")" * 300, "expected a number|too deep|expected a simpler"),
        ("1 if 1 else 2", "expected numbers"),
        ("\x00", "expected a number"),
    ],
)
def test_what_is_not_arithmetic_is_refused(text, said):
    with pytest.raises(ExpressionError, match=said):
        number(text)


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

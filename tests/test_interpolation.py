"""Piecewise linear tables: NumPy's and SciPy's interpolation, the same for symbols, and the slope of the integral."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from armwright import scalar
from armwright.interpolation import piecewise_linear, piecewise_linear_integral
from armwright.program import interpret, trace

AT = np.array([-0.7, -0.2, 0.1, 1.3, 1.35])
VALUES = np.array([3.0, -1.0, 4.0, 4.0, -20.0])
X = np.concatenate([AT, np.random.default_rng(3).uniform(-2.0, 2.5, 200)])
CHOICES = ("constant", "linear")


def table(outside: str):
    """SciPy's interpolation of the table: a spline of degree 1, beyond the ends constant or continued."""
    spline = make_interp_spline(AT, VALUES, k=1)
    return spline if outside == "linear" else lambda x: spline(np.clip(x, AT[0], AT[-1]))


@pytest.mark.parametrize("outside", CHOICES)
def test_values_are_scipys(outside):
    # 1e-14 of the largest value
    assert piecewise_linear(X, AT, VALUES, outside) == pytest.approx(table(outside)(X), rel=0, abs=1e-11)


@pytest.mark.parametrize("outside", CHOICES)
def test_integral_is_scipys_and_its_slope_is_the_value(outside):
    inside = X[np.abs(X - 0.5 * (AT[0] + AT[-1])) <= 0.5 * (AT[-1] - AT[0])]
    integral = make_interp_spline(AT, VALUES, k=1).antiderivative()
    expected = integral(inside) - integral(AT[0])
    assert piecewise_linear_integral(inside, AT, VALUES, outside) == pytest.approx(expected, rel=0, abs=1e-12)
    off = X[np.abs(X[:, None] - AT).min(axis=1) > 1e-3]
    ends = [piecewise_linear_integral(off + step, AT, VALUES, outside) for step in (-1e-5, 1e-5)]
    assert (ends[1] - ends[0]) / 2e-5 == pytest.approx(table(outside)(off), rel=0, abs=1e-7)


@pytest.mark.parametrize("function", [piecewise_linear, piecewise_linear_integral])
@pytest.mark.parametrize("outside", CHOICES)
def test_traces_with_numbers_and_symbols_in_the_table(function, outside):
    constant = trace("f", lambda x: scalar.array([function(x[0], AT, VALUES, outside)]), {"x": (1,)})
    variable = trace(
        "f",
        lambda x, at, values: scalar.array([function(x[0], at, values, outside)]),
        {"x": (1,), "at": (5,), "y": (5,)},
    )
    expected = function(X, AT, VALUES, outside)[:, None]
    assert interpret(constant, X[:, None]) == pytest.approx(expected, rel=0, abs=1e-11)
    assert interpret(variable, X[:, None], AT, VALUES) == pytest.approx(expected, rel=0, abs=1e-11)


def test_two_operations_a_point():
    """And no branch: a table of a hundred points costs about two hundred operations."""
    at = np.linspace(0.0, 1.0, 100)
    program = trace("f", lambda x: scalar.array([piecewise_linear(x[0], at, at**3, "linear")]), {"x": (1,)})
    counts = program.operation_counts()
    assert counts["FMAX"] == 98
    assert set(counts) <= {"FMAX", "MUL", "ADD", "SUB", "CONST", "INPUT", "OUTPUT"}


def test_nan_stays():
    assert np.isnan(piecewise_linear(np.nan, AT, VALUES, "constant"))

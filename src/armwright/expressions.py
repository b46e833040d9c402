"""Formulas as text: `0.3*sin(2*pi*t)`, `30 deg`. Python's parser reads them; only arithmetic is evaluated."""

from __future__ import annotations

import ast
import operator
import re
import warnings
from collections.abc import Callable, Mapping
from math import isfinite, pi
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ExpressionError, check_known, shown
from armwright.scalar import Scalar

NAMES: dict[str, float] = {"pi": pi, "deg": pi / 180.0}
FUNCTIONS: dict[str, tuple[int, Callable[..., Any]]] = {
    **{
        name: (1, getattr(scalar, name))
        for name in ("sin", "cos", "tan", "sqrt", "exp", "log", "tanh", "abs", "sign", "floor")
    },
    **{name: (2, getattr(scalar, name)) for name in ("atan2", "hypot", "fmod", "minimum", "maximum")},
    "step": (1, lambda x: scalar.less_equal(0.0, x)),  # 0 before, 1 from 0 on
    "clip": (3, scalar.clip),
}
OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: lambda base, exponent: _power(base, exponent),
}
LONGEST = 1000  # characters
UNIT = re.compile(r"(?<=[\d.)])\s*deg\b")  # `30 deg` is 30 times a degree


def expression(text: str, variables: tuple[str, ...] = (), typed: str = "") -> Callable[[Mapping[str, Scalar]], Scalar]:
    """A formula as a function of its variables, numbers or symbols.

    Args:
        text: numbers, + - * / **, brackets, the names in `NAMES` and `variables`, and the functions in `FUNCTIONS`.
        variables: names that it may use.   typed: the formula as errors show it; "": the text.
    Returns:
        value: {name: value of each variable} → the formula's value; it raises an ExpressionError where that is no real number.
    Raises:
        ExpressionError: what was not understood, and the names that exist.
    """
    typed = typed or text
    if len(text) > LONGEST:
        raise ExpressionError(f"{len(text)} characters", value=typed, expected=f"a formula of at most {LONGEST}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of numbers that run into a word, which are refused below
            tree = ast.parse(UNIT.sub("*deg", text.strip()), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ExpressionError(value=typed, expected="a number or a formula such as 0.5, 30 deg or pi/2") from None
    try:
        _check(tree, typed, {*NAMES, *variables})
    except RecursionError:
        raise ExpressionError("too deep", value=typed, expected="a simpler formula") from None

    def value(values: Mapping[str, Scalar]) -> Scalar:
        try:
            with np.errstate(all="ignore"):  # NumPy's infinities and NaN are refused where they matter
                return _value(tree, {**NAMES, **values})
        except ZeroDivisionError:
            raise ExpressionError("divides by zero", value=typed, expected="a finite number") from None
        except OverflowError:
            raise ExpressionError("too large", value=typed, expected="a finite number") from None
        except _NotReal:
            raise ExpressionError("a power of a negative number", value=typed, expected="a real number") from None

    return value


class _NotReal(ArithmeticError):
    """A value that is complex."""


def _power(base: Scalar, exponent: Scalar) -> Scalar:
    """Of Python's floats too it is a real number, or an error."""
    value = base**exponent
    if isinstance(value, complex):
        raise _NotReal
    return value


def number(text: str) -> float:
    """The value of a formula without variables.

    Raises:
        ExpressionError: what was not understood, or a value that is not finite.
    """
    value = float(expression(text)({}))
    if not isfinite(value):
        raise ExpressionError(f"is {value}", value=text, expected="a finite number")
    return value


def _check(node: ast.expr, typed: str, names: set[str]) -> None:
    """Refuses everything that is no arithmetic on numbers, known names and functions."""
    here = f"in {shown(typed)}"
    if isinstance(node, ast.Constant):
        if isinstance(node.value, bool) or not isinstance(node.value, (int, float)):
            raise ExpressionError(f"no number {here}", value=node.value)
    elif isinstance(node, ast.Name):
        if node.id not in names:
            raise ExpressionError(f"unknown name {here}", value=node.id, choices=[*names, *FUNCTIONS])
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.UAdd, ast.USub)):
        _check(node.operand, typed, names)
    elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        _check(node.left, typed, names)
        _check(node.right, typed, names)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        check_known(ExpressionError, node.func.id, FUNCTIONS, f"unknown function {here}")
        count, _ = FUNCTIONS[node.func.id]
        if len(node.args) != count:
            expected = f"{count} value{'s' * (count > 1)} for {node.func.id}, not {len(node.args)}"
            raise ExpressionError(value=typed, expected=expected)
        for argument in node.args:
            _check(argument, typed, names)
    else:
        raise ExpressionError(value=typed, expected="numbers, + - * / **, brackets and functions such as sin(…)")


def _value(node: ast.expr, values: Mapping[str, Scalar]) -> Scalar:
    if isinstance(node, ast.Constant):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return values[node.id]
    if isinstance(node, ast.UnaryOp):
        inner = _value(node.operand, values)
        return -inner if isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.BinOp):
        return OPERATORS[type(node.op)](_value(node.left, values), _value(node.right, values))
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    return FUNCTIONS[node.func.id][1](*(_value(argument, values) for argument in node.args))

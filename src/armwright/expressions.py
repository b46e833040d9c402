"""Formulas that people type: `0.3*sin(2*pi*t)`, `30 deg`. Parsed by Python's own parser, and nothing but arithmetic is done."""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Mapping
from math import pi
from typing import Any

from armwright import scalar
from armwright.errors import ExpressionError, nearest
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
    ast.Pow: operator.pow,
}
LONGEST = 1000  # characters
UNIT = re.compile(r"(?<=[\d.)])\s*deg\b")  # `30 deg` is 30 times a degree


def expression(text: str, variables: tuple[str, ...] = ()) -> Callable[[Mapping[str, Scalar]], Scalar]:
    """A formula as a function of its variables, numbers or symbols.

    Args:
        text: numbers, + - * / **, brackets, the names in `NAMES` and `variables`, and the functions in `FUNCTIONS`.
        variables: names that it may use.
    Returns:
        value: {name: value of each variable} → the formula's value.
    Raises:
        ExpressionError: names what was not understood, and what there is.
    """
    if len(text) > LONGEST:
        raise ExpressionError(f"{text[:30]!r}…: {len(text)} characters; expected a formula of at most {LONGEST}")
    try:
        tree = ast.parse(UNIT.sub("*deg", text.strip()), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ExpressionError(f"{text!r}: expected a number or a formula such as 0.5, 30 deg or pi/2") from None
    known = {*NAMES, *variables}
    try:
        _check(tree, text, known)
    except RecursionError:
        raise ExpressionError(f"{text[:30]!r}…: too deep; expected a simpler formula") from None
    return lambda values: _value(tree, text, {**NAMES, **values})


def number(text: str) -> float:
    """The value of a formula without variables.

    Raises:
        ExpressionError: what was not understood, or a value that is not finite.
    """
    try:
        value = float(expression(text)({}))
    except (OverflowError, ZeroDivisionError):
        value = float("inf")
    if value - value != 0.0:
        raise ExpressionError(f"{text!r} is {value}: expected a finite number")
    return value


def _check(node: ast.expr, text: str, known: set[str]) -> None:
    if isinstance(node, ast.Constant):
        if isinstance(node.value, bool) or not isinstance(node.value, (int, float)):
            raise ExpressionError(f"{text!r}: {node.value!r} is no number")
    elif isinstance(node, ast.Name):
        if node.id not in known:
            raise ExpressionError(f"{text!r}: unknown name {node.id!r}; {nearest(node.id, [*known, *FUNCTIONS])}")
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.UAdd, ast.USub)):
        _check(node.operand, text, known)
    elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        _check(node.left, text, known)
        _check(node.right, text, known)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        if node.func.id not in FUNCTIONS:
            raise ExpressionError(f"{text!r}: unknown function {node.func.id!r}; {nearest(node.func.id, FUNCTIONS)}")
        count, _ = FUNCTIONS[node.func.id]
        if len(node.args) != count:
            raise ExpressionError(
                f"{text!r}: {node.func.id} takes {count} value{'s' * (count > 1)}, not {len(node.args)}"
            )
        for argument in node.args:
            _check(argument, text, known)
    else:
        raise ExpressionError(f"{text!r}: expected numbers, + - * / **, brackets and functions such as sin(…)")


def _value(node: ast.expr, text: str, values: Mapping[str, Scalar]) -> Scalar:
    if isinstance(node, ast.Constant):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return values[node.id]
    if isinstance(node, ast.UnaryOp):
        inner = _value(node.operand, text, values)
        return -inner if isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.BinOp):
        return OPERATORS[type(node.op)](_value(node.left, text, values), _value(node.right, text, values))
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    return FUNCTIONS[node.func.id][1](*(_value(argument, text, values) for argument in node.args))

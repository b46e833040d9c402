"""Formulas with units: `pi/2 - 10 deg`, `voltage + 500 mV`, `2 * 30 deg`.

A unit belongs to the number, or to the bracket, directly before it, in sums as well: `armwright.expressions` reads `10 deg` as
10 times a degree, and this reads every other unit in the same way. Products of two values with units are refused, and so are
units that something divides by or raises, because `TimeStep * 2 ms` and `1/2 deg` could each mean two things.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from math import pi
from typing import Any

import numpy as np

from armwright.errors import ExpressionError, SessionError
from armwright.expressions import LONGEST, expression

ANGLES = {"rad": 1.0, "deg": pi / 180.0, "°": pi / 180.0, "mrad": 1e-3, "rev": 2.0 * pi}
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


def _per(units: dict[str, float], behind: tuple[str, ...]) -> dict[str, float]:
    return {name + end: factor for name, factor in units.items() for end in behind}


ACCEPTED: dict[str, dict[str, float]] = {
    "rad": ANGLES,
    "m": LENGTHS,
    "rad/s": {**_per(ANGLES, ("/s",)), "rpm": pi / 30.0},
    "m/s": _per(LENGTHS, ("/s",)),
    "rad/s²": _per(ANGLES, ("/s²", "/s^2", "/s2")),
    "m/s²": _per(LENGTHS, ("/s²", "/s^2", "/s2")),
    "N m": {"N m": 1.0, "Nm": 1.0, "N*m": 1.0, "N·m": 1.0, "mN m": 1e-3, "mNm": 1e-3},
    "N": {"N": 1.0, "kN": 1e3, "mN": 1e-3},
    "V": {"V": 1.0, "mV": 1e-3},
    "A": {"A": 1.0, "mA": 1e-3},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "min": 60.0},
    "kg": {"kg": 1.0, "g": 1e-3},
    "kg m²": {"kg m²": 1.0, "kg m^2": 1.0, "kg m2": 1.0, "kg*m²": 1.0, "kg*m^2": 1.0},
}
"""Unit of a stored value → units that may be typed → factor to it."""

KNOWN = {name for names in ACCEPTED.values() for name in names}


INDEXED = re.compile(r"\b(?P<name>[A-Za-z_]\w*)\s*\[(?P<index>[^\[\]]*)\]")
NAME = re.compile(r"(?<![\w.])[A-Za-z_]\w*(?!\s*\()")
NUMBER = r"(?<![\w.])(?:\d[\d_]*(?:\.[\d_]*)?|\.\d[\d_]*)(?:[eE][+-]?\d+)?"
UNITS = "|".join(re.escape(name).replace(r"\ ", r"\s+") for name in sorted(KNOWN, key=len, reverse=True))
MEASURED = re.compile(rf"(?P<before>{NUMBER}|\))\s*(?P<unit>{UNITS})(?![\w°²^(])")
"""A number or the end of a bracket, and the unit behind it."""

ANGLE_FUNCTIONS = ("sin", "cos", "tan")  # take an angle, give a plain number
SUMMING = ("abs", "minimum", "maximum", "clip", "hypot", "fmod")  # take and give values of one unit

Lookup = Callable[[str, str | None], Any]
"""(name, index or None) → the value of a session's variable, or None where there is no such variable."""


class Formula:
    """A typed formula, and the values of its variables.

    Attributes:
        text: as it was typed.   plain: with stand-ins for components and units, as `armwright.expressions` takes it.
        variables: stand-ins and names → values.   units: stand-ins → the units that they stand for.
    """

    def __init__(self, place: str, text: str, lookup: Lookup):
        """Args:
            place: name of the value in errors.   text: the formula.   lookup: the variables that it may use.
        Raises:
            SessionError: a component of an unknown variable.
        """
        self.place, self.text, self.lookup = place, text, lookup
        self.variables: dict[str, Any] = {}
        self.units: dict[str, str] = {}
        plain = INDEXED.sub(self._component, text)
        self.plain = plain if len(plain) > LONGEST else self._without_units(plain)
        for name in dict.fromkeys(NAME.findall(self.plain)):
            if name not in self.units and name not in self.variables and (value := lookup(name, None)) is not None:
                self.variables[name] = value

    def value(self, unit: str) -> np.ndarray:
        """The formula's value in `unit`: a number, or (n,) of a variable that has one value a joint.

        Raises:
            SessionError: a unit that does not fit or belongs to no number, no formula, no real number.
        """
        factors = self._factors(unit) if self.units else {}
        try:
            with np.errstate(all="ignore"):
                values = {**self.variables, **factors}
                value = expression(self.plain, tuple(values), self.text)(values)
        except ExpressionError as error:
            raise SessionError.of(*error.within(self.place).problems) from None
        return np.asarray(value, dtype=float)

    def _error(self, what: str = "", expected: str = "") -> SessionError:
        return SessionError(what, place=self.place, value=self.text, expected=expected)

    def _component(self, match: re.Match[str]) -> str:
        """A stand-in for `theta[2]`, whose value is looked up."""
        value = self.lookup(match["name"], match["index"].strip())
        if value is None:
            raise SessionError("no such variable", place=self.place, value=match["name"])
        stand_in = f"{match['name']}_component_{len(self.variables)}"
        self.variables[stand_in] = value
        return stand_in

    def _without_units(self, text: str) -> str:
        """`2 * 30 deg` → `2 * (30*unit_0)`, `(10 + 20) deg` → `((10 + 20)*unit_0)`."""
        while match := MEASURED.search(text):
            stand_in = f"unit_{len(self.units)}"
            self.units[stand_in] = " ".join(match["unit"].split())
            begin = match.start() if match["before"] != ")" else _bracket_start(text, match.start())
            number = text[begin : match.end("before")]
            text = f"{text[:begin]}({number}*{stand_in}){text[match.end() :]}"
        return text

    def _factors(self, expected: str) -> dict[str, float]:
        """Factor of every unit to the unit that is expected where it stands."""
        factors: dict[str, float] = {}
        try:
            self._kind(ast.parse(self.plain.strip(), mode="eval").body, expected, factors)
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            return dict.fromkeys(self.units, 1.0)  # no formula: evaluating it reports the error
        return factors

    def _kind(self, node: ast.AST, expected: str, factors: dict[str, float]) -> str:
        """Kind of a part of the formula: a "plain" number, a "variable", or "measured" in a unit that is typed."""
        if isinstance(node, ast.Name):
            if node.id in self.units:
                factors[node.id] = self._factor(self.units[node.id], expected)
                return "measured"
            return "variable" if node.id in self.variables else "plain"
        if isinstance(node, ast.UnaryOp):
            return self._kind(node.operand, expected, factors)
        if isinstance(node, ast.BinOp):
            left, right = (self._kind(side, expected, factors) for side in (node.left, node.right))
            return self._kind_of(node.op, left, right)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            name = node.func.id
            inner = [self._kind(a, "rad" if name in ANGLE_FUNCTIONS else expected, factors) for a in node.args]
            if name in SUMMING:
                return _widest(*inner)
            if "measured" in inner and name not in ANGLE_FUNCTIONS:
                raise self._error(f"{name}(…) of a value with a unit", f"plain numbers in {name}(…)")
        return "plain"

    def _factor(self, unit: str, expected: str) -> float:
        """Factor from `unit` to the expected unit."""
        accepted = ACCEPTED.get(expected, {})
        if unit not in accepted:
            units = f": {', '.join(accepted)}" if accepted else ", without a unit"
            raise SessionError(
                f"unit {unit!r} does not fit", place=self.place, value=self.text, expected=f"{expected}{units}"
            )
        return accepted[unit]

    def _kind_of(self, op: ast.operator, left: str, right: str) -> str:
        if isinstance(op, ast.Pow) or (isinstance(op, ast.Div) and right == "measured"):
            if "measured" in (left, right):
                raise self._error(
                    "it is not clear what the unit belongs to",
                    "it behind a number or a bracket that nothing divides by or raises, such as (1/2) deg",
                )
        elif isinstance(op, (ast.Mult, ast.Div)) and "measured" in (left, right) and "plain" not in (left, right):
            raise self._error("a product of two values with units", "one of them to be a plain number")
        return _widest(left, right)


def _widest(*kinds: str) -> str:
    return next((kind for kind in ("measured", "variable") if kind in kinds), "plain")


def _bracket_start(text: str, end: int) -> int:
    """Start of the bracket that closes at `end`, with the name of its function."""
    depth, k = 0, end
    while k >= 0:
        depth += (text[k] == ")") - (text[k] == "(")
        if depth == 0:
            break
        k -= 1
    k = max(k, 0)
    while k > 0 and (text[k - 1].isalnum() or text[k - 1] == "_"):
        k -= 1
    return k

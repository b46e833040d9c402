"""Formulas with units: `pi/2 - 10 deg`, `voltage + 500 mV`, `2 * 30 deg`.

A unit belongs to the number, or to the bracket, directly before it, in sums as well: `armwright.expressions` reads `10 deg` as
10 times a degree, and this reads every other unit in the same way. What is a product of two units, or divides or raises one, is
refused, because `TimeStep * 2 ms` and `1/2 deg` say two things.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from armwright.errors import ExpressionError, SessionError
from armwright.expressions import LONGEST, expression
from armwright.session.units import KNOWN, factor

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
    """A formula that was typed, and the values of the variables in it.

    Attributes:
        text: as it was typed.   plain: with stand-ins for components and units, as `armwright.expressions` takes it.
        variables: stand-ins and names → values.   units: stand-ins → the units that they stand for.
    """

    def __init__(self, what: str, text: str, lookup: Lookup):
        """Args:
            what: what errors call it.   text: the formula.   lookup: the variables that it may use.
        Raises:
            SessionError: a component of what is no variable.
        """
        self.what, self.text, self.lookup = what, text, lookup
        self.variables: dict[str, Any] = {}
        self.units: dict[str, str] = {}
        plain = INDEXED.sub(self._component, text)
        self.plain = plain if len(plain) > LONGEST else self._without_units(plain)
        for name in dict.fromkeys(NAME.findall(self.plain)):
            if name not in self.units and name not in self.variables and (value := lookup(name, None)) is not None:
                self.variables[name] = value

    def value(self, expected: str) -> np.ndarray:
        """The formula's value in the unit `expected`: a number, or (n,) of a variable that is one value a joint.

        Raises:
            SessionError: a unit that does not fit or belongs to nothing, a formula that is none, no real number.
        """
        factors = self._factors(expected) if self.units else {}
        try:
            with np.errstate(all="ignore"):
                known = {**self.variables, **factors}
                value = expression(self.plain, tuple(known))(known)
        except ExpressionError as error:
            raise SessionError(f"{self.what}: {str(error).replace(repr(self.plain), repr(self.text))}") from None
        except ZeroDivisionError:
            raise SessionError(f"{self.what}: {self.text!r} divides by zero; expected a finite number") from None
        except OverflowError:
            raise SessionError(f"{self.what}: {self.text!r} is too large; expected a finite number") from None
        if np.iscomplexobj(value):
            raise SessionError(f"{self.what}: {self.text!r} is no real number")
        return np.asarray(value, dtype=float)

    def _component(self, match: re.Match[str]) -> str:
        value = self.lookup(match["name"], match["index"].strip())
        if value is None:
            raise SessionError(f"{self.what}: there is no variable {match['name']!r} to take {match[0]!r} of")
        stand_in = f"{match['name']}_component_{len(self.variables)}"
        self.variables[stand_in] = value
        return stand_in

    def _without_units(self, text: str) -> str:
        """`2 * 30 deg` → `2 * (30*unit_0)`, `(10 + 20) deg` → `((10 + 20)*unit_0)`."""
        while match := MEASURED.search(text):
            stand_in = f"unit_{len(self.units)}"
            self.units[stand_in] = " ".join(match["unit"].split())
            begin = match.start() if match["before"] != ")" else _opened(text, match.start())
            number = text[begin : match.end("before")]
            text = f"{text[:begin]}({number}*{stand_in}){text[match.end() :]}"
        return text

    def _factors(self, expected: str) -> dict[str, float]:
        """What every unit is worth in the unit that is expected where it stands."""
        factors: dict[str, float] = {}
        try:
            tree = ast.parse(self.plain.strip(), mode="eval").body
            self._kind(tree, expected, factors)
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            return dict.fromkeys(self.units, 1.0)  # no formula, as evaluating it will tell
        return factors

    def _kind(self, node: ast.AST, expected: str, factors: dict[str, float]) -> str:
        """Whether a part is a "plain" number, a "variable", or "measured" in a unit that is typed."""
        if isinstance(node, ast.Name):
            if node.id in self.units:
                factors[node.id] = factor(self.what, self.units[node.id], expected)
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
                raise SessionError(
                    f"{self.what}: {self.text!r}: {name}(…) takes plain numbers; expected none with a unit"
                )
        return "plain"

    def _kind_of(self, op: ast.operator, left: str, right: str) -> str:
        if isinstance(op, ast.Pow) or (isinstance(op, ast.Div) and right == "measured"):
            if "measured" in (left, right):
                raise SessionError(
                    f"{self.what}: {self.text!r}: it is not clear what the unit belongs to; expected it behind a number "
                    "or a bracket that nothing divides by or raises, such as (1/2) deg"
                )
        elif isinstance(op, (ast.Mult, ast.Div)) and "measured" in (left, right) and "plain" not in (left, right):
            raise SessionError(
                f"{self.what}: {self.text!r} is a product of two values with units; expected one of them to be a plain number"
            )
        return _widest(left, right)


def _widest(*kinds: str) -> str:
    return next((kind for kind in ("measured", "variable") if kind in kinds), "plain")


def _opened(text: str, end: int) -> int:
    """Where the bracket that closes at `end` begins, with the name of its function."""
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

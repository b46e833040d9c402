"""Values as they are typed: `0 0.5 30 deg pi/2`, one number for all joints, `[10 20 30] deg`, `2*theta`.

Values stand apart by blanks or commas. A sign with a blank on both sides is arithmetic (`1 - 2`), with one before it alone
begins the next value (`1 -2`). Formulas are those of `armwright.expressions`, with the session's variables as names.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from armwright.errors import ExpressionError, SessionError
from armwright.expressions import expression
from armwright.session.units import KNOWN, MOST_WORDS, factor

OPERATORS = ("+", "-", "*", "/", "**")
GLUED = re.compile(r"^(?P<number>.*[\d.)])(?P<unit>[A-Za-z°µ][^\d()]*(?:\^?2|²)?)$")
GROUP = re.compile(r"^\[(?P<inner>[^\[\]]*)\]\s*(?P<unit>.*)$")
INDEXED = re.compile(r"\b(?P<name>[A-Za-z_]\w*)\s*\[(?P<index>[^\[\]]*)\]")
NAME = re.compile(r"(?<![\w.])[A-Za-z_]\w*(?!\s*\()")
MOST = 10_000  # characters of a line of values

Lookup = Callable[[str, str | None], Any]
"""(name, index or None) → the value of a session's variable, or None where there is no such variable."""


def vector(what: str, text: str, names: Sequence[str], units: Sequence[str], lookup: Lookup) -> np.ndarray:
    """One number a joint, in that joint's unit.

    Args:
        what: what errors call it.   text: what was typed.   names: (n,) the joints.   units: (n,) their units.
        lookup: the variables that formulas may use.
    Returns:
        values: (n,).
    Raises:
        SessionError: too many or too few values, a unit that does not fit, a formula that is none, no finite number.
    """
    parts = split(what, text)
    if len(parts) not in (1, len(names)):
        expected = f"{len(names)} ({', '.join(names)}), or one for all joints" if len(names) > 1 else "1"
        raise SessionError(f"{what}: {len(parts)} value{'s' * (len(parts) != 1)}; expected {expected}")
    if len(parts) == 1:
        formula, unit = parts[0]
        values = _evaluated(what, formula, lookup)
        if np.ndim(values) and np.shape(values) != (len(names),):
            raise SessionError(f"{what}: {formula!r} holds {np.size(values)} values; expected {len(names)}")
        values = np.broadcast_to(values, (len(names),))
        factors = [factor(what, unit, own) if unit else 1.0 for own in units]
        return _finite(what, text, values * np.array(factors))
    values = [
        _scalar(what, formula, lookup) * (factor(f"{what}[{name}]", unit, own) if unit else 1.0)
        for (formula, unit), name, own in zip(parts, names, units, strict=True)
    ]
    return _finite(what, text, np.array(values))


def number(what: str, text: str, unit: str, lookup: Lookup | None = None) -> float:
    """One number in `unit`.

    Raises:
        SessionError: as `vector`.
    """
    parts = split(what, text)
    if len(parts) != 1:
        raise SessionError(f"{what}: {len(parts)} values in {text!r}; expected one number [{unit}]")
    formula, own = parts[0]
    value = _scalar(what, formula, lookup or (lambda name, index: None)) * (factor(what, own, unit) if own else 1.0)
    return float(_finite(what, text, np.array(value)))


def split(what: str, text: str) -> list[tuple[str, str]]:
    """(formula, unit or "") of every value.

    Raises:
        SessionError: nothing, brackets that do not close, a unit that stands alone, or one that only the last value has.
    """
    if len(text) > MOST:
        raise SessionError(f"{what}: {len(text)} characters; expected at most {MOST}")
    group = GROUP.match(text.strip())
    if group:
        unit = " ".join(group["unit"].split())
        if unit and unit not in KNOWN:
            raise SessionError(f"{what}: {unit!r} behind the bracket is no unit")
        inner = split(what, group["inner"])
        if unit and any(own for _, own in inner):
            raise SessionError(
                f"{what}: {text.strip()!r} has units inside and behind the bracket; expected one of them"
            )
        return [(formula, unit or own) for formula, own in inner]
    parts = _with_units(what, _joined(_chunks(what, text)))
    if not parts:
        raise SessionError(f"{what}: no value given")
    bare = [formula for formula, unit in parts[:-1] if not unit]
    if len(bare) == len(parts) - 1 and parts[-1][1] and any(_is_plain(formula) for formula in bare):
        unit = parts[-1][1]
        raise SessionError(
            f"{what}: only the last value is in {unit}; expected the unit behind each of them, or [...] {unit} for all"
        )
    return parts


def _is_plain(formula: str) -> bool:
    """Whether a value is a number other than 0, which might have been meant in the unit that stands at the end."""
    try:
        return float(formula) != 0.0
    except ValueError:
        return False


def _chunks(what: str, text: str) -> list[str]:
    """The text cut at blanks and commas that no bracket encloses."""
    chunks, depth, current = [], 0, ""
    for mark in text:
        depth += (mark in "([") - (mark in ")]")
        if depth < 0:
            raise SessionError(f"{what}: {text.strip()!r}: a bracket closes that none opened")
        if depth == 0 and (mark.isspace() or mark == ","):
            chunks.append(current)
            current = ""
        else:
            current += mark
    if depth:
        raise SessionError(f"{what}: {text.strip()!r}: a bracket is not closed")
    return [chunk for chunk in [*chunks, current] if chunk]


def _joined(chunks: list[str]) -> list[str]:
    """Chunks that arithmetic joins: `2 * pi`, `1 - 2`."""
    joined: list[str] = []
    waits = False
    for chunk in chunks:
        follows = joined and (waits or chunk in OPERATORS or chunk[0] in "*/")
        if follows:
            joined[-1] += " " + chunk
        else:
            joined.append(chunk)
        waits = chunk in OPERATORS or chunk[-1] in "+-*/"
    return joined


def _with_units(what: str, chunks: list[str]) -> list[tuple[str, str]]:
    parts: list[tuple[str, str]] = []
    k = 0
    while k < len(chunks):
        for words in range(MOST_WORDS, 0, -1):
            unit = " ".join(chunks[k : k + words])
            if unit in KNOWN:
                break
        else:
            formula, glued = _glued(chunks[k])
            parts.append((formula, glued))
            k += 1
            continue
        if (
            parts and parts[-1][1] and f"{parts[-1][1]} {unit}" in KNOWN
        ):  # `2N m`: the first half is glued to its number
            parts[-1] = parts[-1][0], f"{parts[-1][1]} {unit}"
        elif not parts or parts[-1][1]:
            raise SessionError(f"{what}: unit {unit!r} without a value before it")
        else:
            parts[-1] = parts[-1][0], unit
        k += len(unit.split())
    return parts


def _glued(chunk: str) -> tuple[str, str]:
    """`30deg` → ("30", "deg")."""
    match = GLUED.match(chunk)
    return (match["number"], match["unit"]) if match and match["unit"] in KNOWN else (chunk, "")


def _scalar(what: str, formula: str, lookup: Lookup) -> float:
    value = _evaluated(what, formula, lookup)
    if np.ndim(value):
        raise SessionError(f"{what}: {formula!r} holds {np.size(value)} values; expected one, such as {formula}[1]")
    return float(value)


def _evaluated(what: str, formula: str, lookup: Lookup) -> np.ndarray:
    values: dict[str, Any] = {}

    def component(match: re.Match[str]) -> str:
        value = lookup(match["name"], match["index"].strip())
        if value is None:
            raise SessionError(f"{what}: there is no variable {match['name']!r} to take {match[0]!r} of")
        stand_in = f"{match['name']}_component_{len(values)}"
        values[stand_in] = value
        return stand_in

    plain = INDEXED.sub(component, formula)
    for name in dict.fromkeys(NAME.findall(plain)):
        if name not in values and (value := lookup(name, None)) is not None:
            values[name] = value
    return _computed(what, formula, plain, values)


def _computed(what: str, formula: str, plain: str, values: Mapping[str, Any]) -> np.ndarray:
    try:
        with np.errstate(all="ignore"):
            value = expression(plain, tuple(values))(values)
    except ExpressionError as error:
        raise SessionError(f"{what}: {error}") from None
    except ZeroDivisionError:
        raise SessionError(f"{what}: {formula!r} divides by zero; expected a finite number") from None
    except OverflowError:
        raise SessionError(f"{what}: {formula!r} is too large; expected a finite number") from None
    if np.iscomplexobj(value):
        raise SessionError(f"{what}: {formula!r} is no real number")
    return np.asarray(value, dtype=float)


def _finite(what: str, text: str, values: np.ndarray) -> np.ndarray:
    if not np.isfinite(values).all():
        raise SessionError(f"{what}: {text.strip()!r} is not finite; expected finite numbers")
    return values

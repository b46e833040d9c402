"""Typed values: `0 0.5 30 deg pi/2`, one number for all joints, `[10 20 30] deg`, `2*theta`.

Blanks or commas separate values. A sign with a blank on both sides is arithmetic (`1 - 2`); with a blank only before it, it
begins the next value (`1 -2`). Each value is a formula of `armwright.session.formulas`, in which a unit belongs to its number.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from armwright.errors import SessionError
from armwright.session.formulas import KNOWN, MEASURED, Formula, Lookup

OPERATORS = ("+", "-", "*", "/", "**")
GROUP = re.compile(r"^\[(?P<inner>[^\[\]]*)\]\s*(?P<unit>.*)$")
BOND = "\ue000"  # keeps a number and its unit together while values are split at blanks; nobody types it
MOST = 10_000  # characters of a line of values


def vector(place: str, text: str, names: Sequence[str], units: Sequence[str], lookup: Lookup) -> np.ndarray:
    """One number for each joint, in that joint's unit.

    Args:
        place: name of the values in errors.   text: what was typed.   names: (n,) the joints.   units: (n,) their units.
        lookup: the variables that formulas may use.
    Returns:
        values: (n,).
    Raises:
        SessionError: too many or too few values, a unit that does not fit, no formula, no finite number.
    """
    parts = split(place, text)
    if len(parts) not in (1, len(names)):
        expected = f"{len(names)} ({', '.join(names)}), or one for all joints" if len(names) > 1 else "1"
        raise _wrong_count(place, text, len(parts), expected)
    if len(parts) > 1:
        joints = zip(parts, names, units, strict=True)
        values = [_scalar(f"{place}[{name}]", _joined(part), unit, lookup) for part, name, unit in joints]
        return _finite(place, text, np.array(values))
    formula = Formula(place, _joined(parts[0]), lookup)
    by_unit = {unit: formula.value(unit) for unit in dict.fromkeys(units)}
    for values in by_unit.values():
        if np.ndim(values) and np.shape(values) != (len(names),):
            raise _wrong_count(place, formula.text, np.size(values), str(len(names)))
    rows = [np.broadcast_to(by_unit[unit], (len(names),))[k] for k, unit in enumerate(units)]
    return _finite(place, text, np.array(rows))


def number(place: str, text: str, unit: str, lookup: Lookup | None = None) -> float:
    """One number in `unit`.

    Raises:
        SessionError: as `vector`.
    """
    parts = split(place, text)
    if len(parts) != 1:
        raise _wrong_count(place, text, len(parts), f"one number [{unit}]")
    value = _scalar(place, _joined(parts[0]), unit, lookup or (lambda name, index: None))
    return float(_finite(place, text, np.array(value)))


def _wrong_count(place: str, text: str, count: int, expected: str) -> SessionError:
    return SessionError(f"{count} value{'s' * (count != 1)}", place=place, value=text.strip(), expected=expected)


def split(place: str, text: str) -> list[tuple[str, str]]:
    """(formula, the unit at its end or "") of every value; units within a formula stay there.

    Raises:
        SessionError: nothing, brackets that do not close, a unit without a number, or one that only the last value has.
    """
    if len(text) > MOST:
        raise SessionError(f"{len(text)} characters", place=place, value=text, expected=f"at most {MOST}")
    group = GROUP.match(text.strip())
    if group:
        return _shared(place, text, group["inner"], " ".join(group["unit"].split()))
    bound = MEASURED.sub(lambda match: match["before"] + BOND + BOND.join(match["unit"].split()), text)
    chunks = [chunk.replace(BOND, " ") for chunk in _with_arithmetic(_chunks(place, bound))]
    _refuse_lone_units(place, chunks)
    parts = [_formula_and_unit(chunk) for chunk in chunks]
    if not parts:
        raise SessionError("no value given", place=place)
    bare = [formula for formula, unit in parts[:-1] if not unit and not MEASURED.search(formula)]
    # A number other than 0 may have been meant in the unit that stands at the end.
    if len(bare) == len(parts) - 1 and parts[-1][1] and any(_number(formula) for formula in bare):
        unit = parts[-1][1]
        expected = f"the unit behind each of them, or [...] {unit} for all"
        raise SessionError(f"only the last value is in {unit}", place=place, value=text.strip(), expected=expected)
    return parts


def _shared(place: str, text: str, inner: str, unit: str) -> list[tuple[str, str]]:
    """The values of `[10 20 30] deg`, each in brackets where it is a formula."""
    if unit and unit not in KNOWN:
        raise SessionError("no unit behind the bracket", place=place, value=unit, expected="a unit")
    parts = split(place, inner)
    if not unit:
        return parts
    if any(own or MEASURED.search(formula) for formula, own in parts):
        what = "units inside and behind the bracket"
        raise SessionError(what, place=place, value=text.strip(), expected="one of them")
    return [(formula if _number(formula) is not None else f"({formula})", unit) for formula, _ in parts]


def _joined(part: tuple[str, str]) -> str:
    """A formula and the unit at its end as they were typed."""
    return " ".join(part).rstrip()


def _formula_and_unit(text: str) -> tuple[str, str]:
    """`1 + 30 deg` → ("1 + 30", "deg")."""
    for match in MEASURED.finditer(text):
        if match.end() == len(text):
            return text[: match.end("before")], " ".join(match["unit"].split())
    return text, ""


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _chunks(place: str, text: str) -> list[str]:
    """The text split at blanks and commas outside of brackets."""
    chunks, depth, current = [], 0, ""
    for mark in text:
        depth += (mark in "([") - (mark in ")]")
        if depth < 0:
            break
        if depth == 0 and (mark.isspace() or mark == ","):
            chunks.append(current)
            current = ""
        else:
            current += mark
    if depth:
        what = "a bracket is not closed" if depth > 0 else "a bracket closes that none opened"
        raise SessionError(what, place=place, value=text.replace(BOND, " ").strip())
    return [chunk for chunk in [*chunks, current] if chunk]


def _with_arithmetic(chunks: list[str]) -> list[str]:
    """Chunks joined where arithmetic stands between them: `2 * pi`, `1 - 2`."""
    joined: list[str] = []
    is_open = False  # the chunk before ends in an operator
    for chunk in chunks:
        if joined and (is_open or chunk in OPERATORS or chunk[0] in "*/"):
            joined[-1] += " " + chunk
        else:
            joined.append(chunk)
        is_open = chunk in OPERATORS or chunk[-1] in "+-*/"
    return joined


def _refuse_lone_units(place: str, chunks: list[str]) -> None:
    """Refuses `deg`, `30 deg deg` and `theta deg`: units behind no number."""
    for k, chunk in enumerate(chunks):
        if chunk in KNOWN:
            before = chunks[k - 1] if k else ""
            value = f"{before} {chunk}".strip()
            raise SessionError(
                "a unit behind no number", place=place, value=value, expected=f"a number before it, such as 30 {chunk}"
            )


def _scalar(place: str, text: str, unit: str, lookup: Lookup) -> float:
    value = Formula(place, text, lookup).value(unit)
    if np.ndim(value):
        raise _wrong_count(place, text, np.size(value), f"one, such as {text}[1]")
    return float(value)


def _finite(place: str, text: str, values: np.ndarray) -> np.ndarray:
    if not np.isfinite(values).all():
        raise SessionError("not finite", place=place, value=text.strip(), expected="finite numbers")
    return values

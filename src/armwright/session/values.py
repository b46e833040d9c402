"""Values as they are typed: `0 0.5 30 deg pi/2`, one number for all joints, `[10 20 30] deg`, `2*theta`.

Values stand apart by blanks or commas. A sign with a blank on both sides is arithmetic (`1 - 2`), with one before it alone
begins the next value (`1 -2`). Each value is a formula of `armwright.session.formulas`, in which a unit belongs to its number.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from armwright.errors import SessionError
from armwright.session.formulas import MEASURED, Formula, Lookup
from armwright.session.units import KNOWN

OPERATORS = ("+", "-", "*", "/", "**")
GROUP = re.compile(r"^\[(?P<inner>[^\[\]]*)\]\s*(?P<unit>.*)$")
TIE = "\ue000"  # holds a number and its unit together while values are cut apart at blanks; nobody types it
MOST = 10_000  # characters of a line of values


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
        formula = Formula(what, _whole(parts[0]), lookup)
        by_unit = {unit: formula.value(unit) for unit in dict.fromkeys(units)}
        for values in by_unit.values():
            if np.ndim(values) and np.shape(values) != (len(names),):
                raise SessionError(f"{what}: {formula.text!r} holds {np.size(values)} values; expected {len(names)}")
        rows = [np.broadcast_to(by_unit[unit], (len(names),))[k] for k, unit in enumerate(units)]
        return _finite(what, text, np.array(rows))
    values = [
        _scalar(f"{what}[{name}]", _whole(part), own, lookup)
        for part, name, own in zip(parts, names, units, strict=True)
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
    value = _scalar(what, _whole(parts[0]), unit, lookup or (lambda name, index: None))
    return float(_finite(what, text, np.array(value)))


def split(what: str, text: str) -> list[tuple[str, str]]:
    """(formula, the unit at its end or "") of every value; units within a formula stay there.

    Raises:
        SessionError: nothing, brackets that do not close, a unit that stands alone, or one that only the last value has.
    """
    if len(text) > MOST:
        raise SessionError(f"{what}: {len(text)} characters; expected at most {MOST}")
    group = GROUP.match(text.strip())
    if group:
        return _shared(what, text, group["inner"], " ".join(group["unit"].split()))
    tied = MEASURED.sub(lambda match: match["before"] + TIE + TIE.join(match["unit"].split()), text)
    chunks = _joined(_chunks(what, tied))
    _refuse_lone_units(what, [chunk.replace(TIE, " ") for chunk in chunks])
    parts = [_ended(chunk.replace(TIE, " ")) for chunk in chunks]
    if not parts:
        raise SessionError(f"{what}: no value given")
    bare = [formula for formula, unit in parts[:-1] if not unit and not MEASURED.search(formula)]
    if len(bare) == len(parts) - 1 and parts[-1][1] and any(_is_plain(formula) for formula in bare):
        unit = parts[-1][1]
        raise SessionError(
            f"{what}: only the last value is in {unit}; expected the unit behind each of them, or [...] {unit} for all"
        )
    return parts


def _shared(what: str, text: str, inner: str, unit: str) -> list[tuple[str, str]]:
    """The values of `[10 20 30] deg`, each in brackets where it is a formula."""
    if unit and unit not in KNOWN:
        raise SessionError(f"{what}: {unit!r} behind the bracket is no unit")
    parts = split(what, inner)
    if not unit:
        return parts
    if any(own or MEASURED.search(formula) for formula, own in parts):
        raise SessionError(f"{what}: {text.strip()!r} has units inside and behind the bracket; expected one of them")
    return [(formula if _number(formula) is not None else f"({formula})", unit) for formula, _ in parts]


def _whole(part: tuple[str, str]) -> str:
    """A formula and the unit at its end as they were typed."""
    return " ".join(part).rstrip()


def _ended(text: str) -> tuple[str, str]:
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


def _is_plain(formula: str) -> bool:
    """Whether a value is a number other than 0, which might have been meant in the unit that stands at the end."""
    return bool(_number(formula))


def _chunks(what: str, text: str) -> list[str]:
    """The text cut at blanks and commas that no bracket encloses."""
    chunks, depth, current = [], 0, ""
    for mark in text:
        depth += (mark in "([") - (mark in ")]")
        if depth < 0:
            raise SessionError(f"{what}: {_untied(text)!r}: a bracket closes that none opened")
        if depth == 0 and (mark.isspace() or mark == ","):
            chunks.append(current)
            current = ""
        else:
            current += mark
    if depth:
        raise SessionError(f"{what}: {_untied(text)!r}: a bracket is not closed")
    return [chunk for chunk in [*chunks, current] if chunk]


def _untied(text: str) -> str:
    return text.replace(TIE, " ").strip()


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


def _refuse_lone_units(what: str, chunks: list[str]) -> None:
    """Refuses `deg`, `30 deg deg` and `theta deg`: units behind no number."""
    for k, chunk in enumerate(chunks):
        if chunk not in KNOWN:
            continue
        before = chunks[k - 1] if k else ""
        if not before or _ended(before)[1]:
            raise SessionError(f"{what}: unit {chunk!r} without a value before it")
        raise SessionError(
            f"{what}: '{before} {chunk}': the unit stands behind no number; expected it behind one, such as 30 {chunk}"
        )


def _scalar(what: str, text: str, unit: str, lookup: Lookup) -> float:
    value = Formula(what, text, lookup).value(unit)
    if np.ndim(value):
        raise SessionError(f"{what}: {text!r} holds {np.size(value)} values; expected one, such as {text}[1]")
    return float(value)


def _finite(what: str, text: str, values: np.ndarray) -> np.ndarray:
    if not np.isfinite(values).all():
        raise SessionError(f"{what}: {text.strip()!r} is not finite; expected finite numbers")
    return values

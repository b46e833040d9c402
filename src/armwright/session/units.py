"""Units that may be typed behind a value, and what each is in the unit that is meant."""

from __future__ import annotations

from math import pi

from armwright.errors import SessionError

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
"""The unit that a value is kept in → names that may be typed → factor."""

KNOWN = {name for names in ACCEPTED.values() for name in names}
MOST_WORDS = max(len(name.split()) for name in KNOWN)


def factor(what: str, unit: str, expected: str) -> float:
    """What a value in `unit` is multiplied by to be in `expected`.

    Raises:
        SessionError: a unit that does not fit; names those that do.
    """
    accepted = ACCEPTED.get(expected, {})
    if unit not in accepted:
        fitting = ", ".join(accepted) if accepted else "no unit"
        raise SessionError(f"{what}: {unit!r} does not fit; expected {expected}: {fitting}")
    return accepted[unit]

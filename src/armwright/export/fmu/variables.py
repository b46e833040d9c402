"""Variables of an FMU: one number each, named and described after its signal."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction

from armwright.kernels.c_syntax import identifier
from armwright.signals import Layout

#: Units of our signals by the SI units that they are made of: what FMI calls base units, and the factor to them.
SI = {
    "rad": {"rad": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "kg": {"kg": 1},
    "A": {"A": 1},
    "K": {"K": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Hz": {"s": -1},
}
POWERS = {"²": 2, "³": 3}
PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True)
class FmuVariable:
    """One scalar variable of an FMU.

    Attributes:
        name: structured, as `q.elbow`.   causality: "input", "output", "local", "parameter" or "independent".
        variability: "continuous", "discrete", "fixed" or "tunable".   unit: as our signals have it.   about: what it is.
        member, entry: of the model's struct, where its value is.   start: its value before anything is set; None: computed.
        derivative_of: name of the state whose derivative it is.   state: whether an integrator moves it.
    """

    name: str
    causality: str
    variability: str
    unit: str
    about: str
    member: str
    entry: int
    start: float | None = None
    derivative_of: str | None = None
    state: bool = False


def variables_of(
    layout: Layout,
    joints: Sequence[str],
    member: str,
    causality: str,
    variability: str,
    *,
    prefix: str = "",
    starts: Iterable[float] | None = None,
    about: str = "",
    states: bool = False,
) -> list[FmuVariable]:
    """Variables of all entries of a layout, in its order.

    Args:
        layout: of the vector.   joints: names of the arm's joints.   member: of the model's struct that holds the vector.
        causality, variability, states: of all of them.   prefix: of their names.   starts: (size,) values.
        about: what comes before each signal's own description.
    """
    rows, entry = [], 0
    values = [None] * layout.size if starts is None else [float(value) for value in starts]
    for signal in layout:
        labels = signal.labels if signal.joints is None else [joints[j] for j in signal.joints]
        if labels is None or len(labels) != signal.size:
            labels = [str(k) if signal.size > 1 else "" for k in range(signal.size)]
        for label, unit in zip(labels, signal.units, strict=True):
            name = ".".join(part for part in (prefix, signal.name, quoted(label)) if part)
            what = " ".join(part for part in (about, signal.about or signal.name) if part)
            text = f"{what}, {label}" if label else what
            rows.append(
                FmuVariable(
                    name, causality, variability, unit, text, identifier(member), entry, values[entry], state=states
                )
            )
            entry += 1
    return rows


def quoted(label: str) -> str:
    """A label as a part of a structured name: digits and letters as they are, anything else between apostrophes.

    A character that FMI does not allow there becomes its number, so that two names stay two.
    """
    if not label or PLAIN.fullmatch(label):
        return label
    if label.isdigit():
        return f"at{label}"
    plain = (each.isascii() and each.isprintable() and each not in "'\\" for each in label)
    word = "".join(each if kept else f"_{ord(each):x}" for each, kept in zip(label, plain, strict=True))
    return f"'{word}'"


def base_unit(unit: str) -> dict[str, int] | None:
    """Exponents of SI base units by name: `base_unit("N m")` → {"kg": 1, "m": 2, "s": -2}; None for an unknown unit."""
    if unit == "°C":
        return {"K": 1}
    total: dict[str, Fraction] = {}
    sign = 1
    for word in re.split(r"(\s+|/)", unit):
        if word == "/":
            sign = -1
        elif word.strip():
            power = POWERS.get(word[-1], 1)
            name = word[:-1] if word[-1] in POWERS else word
            if name == "1":
                continue
            if name not in SI:
                return None
            for base, exponent in SI[name].items():
                total[base] = total.get(base, Fraction(0)) + sign * power * exponent
    return {base: int(exponent) for base, exponent in total.items() if exponent}

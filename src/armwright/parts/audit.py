"""Sums that make up a link: the contribution of each section and each measurement to its mass properties.

Masses and tensors about the link's centre of mass, in its axes, add up down the table. They are rounded so that the printed
digits add up too: each is within one of its last digit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import floor

import numpy as np

from armwright.description.robot import Link
from armwright.parts.mass_properties import ENTRIES, WeighedLink, WeighedPart
from armwright.solids.moments import Moments

MASS_DECIMALS = 6
INERTIA_DECIMALS = 8


@dataclass(frozen=True)
class AuditRow:
    """A line of the audit, in the link's frame; numbers as text.

    Args:
        part, title: of the part.   name: of the section, or what was measured.   kind: "section", "hole" or "measured".
        shape, substance, volume: [cm³] of all copies, negative for holes.
        mass: [kg].   centre: (3,) [m].   inertia: (6,) [kg m²] xx, yy, zz, xy, xz, yz about the link's centre of mass.
    """

    part: str
    title: str
    name: str
    kind: str
    shape: str
    substance: str
    volume: str
    mass: str
    centre: tuple[str, ...]
    inertia: tuple[str, ...]


def audit(weighed: WeighedLink, link: Link) -> tuple[list[AuditRow], AuditRow]:
    """Every contribution to a link, and the total.

    Args:
        weighed: the link with its parts.   link: its record in the arm's database.
    Returns:
        rows: in the order of the file.   total: the database's own values, which the rows add up to.
    """
    com = np.array(link.com_m)
    contributions = [row for part in weighed.parts for row in _contributions(part)]
    masses = adding_up([moments.amount for _, moments in contributions], float(link.mass_kg), MASS_DECIMALS)
    tensors = [moments.tensor_about(com) for _, moments in contributions]
    wanted = link.inertia_kg_m2.matrix().astype(float)
    columns = [
        adding_up([tensor[place] for tensor in tensors], wanted[place], INERTIA_DECIMALS) for place in ENTRIES.values()
    ]
    rows = [
        AuditRow(*words, mass, _centre(moments), tuple(column[k] for column in columns))
        for k, ((words, moments), mass) in enumerate(zip(contributions, masses, strict=True))
    ]
    shown = (f"{wanted[place]:.{INERTIA_DECIMALS}f}" for place in ENTRIES.values())
    mass = f"{float(link.mass_kg):.{MASS_DECIMALS}f}"
    total = AuditRow("", "", link.name, "total", "", "", "", mass, tuple(f"{value:.6f}" for value in com), tuple(shown))
    return rows, total


def _contributions(part: WeighedPart) -> Iterator[tuple[tuple[str, str, str, str, str, str, str], Moments]]:
    """Texts and moments in the link's frame of a part's sections, then of what its measurements add or take away."""
    names = (part.part.name, part.part.title or "")
    for section in part.sections:
        record = section.section
        kind = "hole" if record.hole else "section"
        times = f" × {record.count}" if record.count > 1 else ""
        volume = f"{(-1e6 if record.hole else 1e6) * section.volume * record.count:.3f}"
        words = (*names, record.name + times, kind, record.solid.shape, section.substance, volume)
        yield words, section.moments.placed(part.placement)
    if part.overrides:
        difference = Moments(part.moments.matrix - part.computed.matrix)
        words = (*names, "; ".join(part.overrides), "measured", "", "", "")
        yield words, difference.placed(part.placement)


def _centre(moments: Moments) -> tuple[str, ...]:
    """Centre of a section as text; a correction without mass has none."""
    if abs(moments.amount) < 0.5 * 10**-MASS_DECIMALS:
        return ("", "", "")
    return tuple(f"{value + 0.0:.6f}" for value in np.round(moments.centre, 6))


def adding_up(values: Sequence[float], total: float, decimals: int) -> list[str]:
    """Numbers as text whose sum is the rounded total: rounded down, then up where most was lost (largest remainders)."""
    units = [value * 10**decimals for value in values]
    down = [floor(unit) for unit in units]
    missing = round(total * 10**decimals) - sum(down)
    order = sorted(range(len(values)), key=lambda k: down[k] - units[k])
    each, extra = divmod(missing, len(values)) if values else (0, 0)
    for place, k in enumerate(order):
        down[k] += each + (place < extra)
    return [f"{unit / 10**decimals:.{decimals}f}" for unit in down]

"""Sections that overlap, and holes outside of their part: at every point, the number of solids less holes must be 0 or 1.

Volumes are those of bodies with flat faces, intersected by manifold3d. A round body has `AROUND` sides and lacks 2π²/(3 AROUND²)
of its section, 0.04 %: a shaft may seem to overlap a bore of its size, turned differently, by half of that.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np

from armwright.errors import Problem
from armwright.parts.mass_properties import WeighedLink, WeighedPart, WeighedSection
from armwright.solids.manifold import manifold
from armwright.solids.surface import surface

if TYPE_CHECKING:
    from manifold3d import Manifold

SHARE = 0.01  # of a part's mass: a smaller overlap is not reported
AROUND = 128  # flat sides of what is round


class _Bodies:
    """Bodies in the link's frame, and the boxes around them."""

    def __init__(self, bodies: Iterable[Manifold]):
        self.bodies = list(bodies)
        self.boxes = np.array([body.bounding_box() for body in self.bodies]).reshape(-1, 2, 3)

    def near(self, room: Manifold, *but: Manifold) -> list[Manifold]:
        """Bodies whose boxes overlap the box of `room`, without those of `but`."""
        low, high = np.reshape(room.bounding_box(), (2, 3))
        meet = (np.minimum(self.boxes[:, 1], high) > np.maximum(self.boxes[:, 0], low)).all(axis=1)
        near = (self.bodies[k] for k in np.flatnonzero(meet))
        return [body for body in near if not any(body is other for other in but)]


@dataclass(frozen=True, eq=False)
class _Copies:
    """A section, and the bodies of its copies."""

    part: WeighedPart
    section: WeighedSection
    copies: _Bodies

    def __str__(self) -> str:
        return f"{self.part.part.name!r} {self.section.section.name!r}"


def overlaps(link: WeighedLink) -> list[Problem]:
    """Warnings about sections that overlap by more than 1 % of the mass of the lightest part concerned.

    Args:
        link: a weighed link; parts with `overlaps = "ok"` are left out.
    Returns:
        warnings: with the volume that is counted twice.
    """
    sections = [_copies(part, section) for part in link.parts for section in part.sections]
    solids = [each for each in sections if not each.section.section.hole]
    holes = [each for each in sections if each.section.section.hole]
    return [*_counted_twice(link, solids, holes), *_empty_holes(link, solids, holes)]


def _copies(part: WeighedPart, section: WeighedSection) -> _Copies:
    boundary = surface(section.section.solid, AROUND)
    body = manifold(np.asarray(boundary.vertices), np.asarray(boundary.faces))
    placements = [part.placement @ placement for placement in section.placements]
    return _Copies(part, section, _Bodies(body.transform(placement.matrix()[:3]) for placement in placements))


def _counted_twice(link: WeighedLink, solids: list[_Copies], holes: list[_Copies]) -> Iterator[Problem]:
    """Warnings about solids that overlap where no hole compensates it."""
    filled, empty = (_Bodies(body for each in sections for body in each.copies.bodies) for sections in (solids, holes))
    for one, two in combinations_with_replacement(solids, 2):
        if "ok" in (one.part.part.overlaps, two.part.part.overlaps):
            continue
        shared = [(a ^ b, a, b) for a in one.copies.bodies for b in two.copies.near(a, a)]
        density, times = min(one.section.density, two.section.density), 2 if one is two else 1  # that a pair is found
        least = min(one.part.computed.amount, two.part.computed.amount)
        if density * sum(room.volume() for room, _, _ in shared) / times <= SHARE * least:
            continue  # most pairs only touch
        counted = (_volume_not_below(room, filled.near(room, a, b), empty.near(room)) for room, a, b in shared)
        volume = sum(counted) / times
        mass = density * volume
        if mass > SHARE * least:
            pair = f"{one} and {two}" if one is not two else f"copies of {one}"
            what = f"{pair} overlap by {1e6 * volume:.3g} cm³, {mass:.3g} kg counted twice"
            yield _problem(link, what, mass / least)


def _empty_holes(link: WeighedLink, solids: list[_Copies], holes: list[_Copies]) -> Iterator[Problem]:
    """Warnings about holes that reach out of their part, or into each other."""
    for hole in holes:
        if hole.part.part.overlaps == "ok":
            continue
        filled, empty = (
            _Bodies(body for each in sections if each.part is hole.part for body in each.copies.bodies)
            for sections in (solids, holes)
        )
        volume = sum(_volume_not_below(body, empty.near(body, body), filled.near(body)) for body in hole.copies.bodies)
        mass, least = volume * hole.section.density, hole.part.computed.amount
        if mass > SHARE * least:
            what = f"hole {hole} takes {1e6 * volume:.3g} cm³ where its part has nothing, {mass:.3g} kg too much"
            yield _problem(link, what, mass / least)


def _problem(link: WeighedLink, what: str, share: float) -> Problem:
    accept = 'overlaps = "ok" in the part accepts it'
    return Problem(f"{what} ({100 * share:.3g} % of the part); {accept}", f"link {link.link.name!r}")


def _volume_not_below(room: Manifold, more: list[Manifold], fewer: list[Manifold]) -> float:
    """Volume [m³] of the points of a body that lie in at least as many of the first bodies as of the second.

    That is where, for some k, k or more of the first and no more than k of the second are.
    """
    from manifold3d import Manifold, OpType

    parts = [Manifold.batch_boolean([room, *fewer], OpType.Subtract)]
    if more:
        at_least, beyond = _levels(room, more), _levels(room, fewer)[2:]
        parts += [level - beyond[k] if k < len(beyond) else level for k, level in enumerate(at_least[1:])]
    return float(Manifold.batch_boolean(parts, OpType.Add).volume())


def _levels(room: Manifold, bodies: list[Manifold]) -> list[Manifold]:
    """Parts of `room` that lie in at least 0, 1, 2, … of the bodies."""
    levels = [room]
    for body in bodies:
        inside = [level ^ body for level in levels]
        levels = [room, *(above + new for above, new in zip(levels[1:], inside, strict=False)), inside[-1]]
    return levels

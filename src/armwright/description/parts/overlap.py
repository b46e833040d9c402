"""Sections that fill the same room, and holes in the air: at every point, solids less holes must be 0 or 1.

Boxes around the sections come first; where two boxes meet, the points of a fixed low-discrepancy sequence [Roberts2018] in the
smallest box that holds what they share are counted, so that every run gives the same volume.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from armwright.description.parts.containment import bounds, inside
from armwright.description.parts.weighing import WeighedLink, WeighedPart, WeighedSection
from armwright.description.solids.mesh import Mesh
from armwright.spatial import Placement

SHARE = 0.01  # of a part's mass: an overlap below it is not told
POINTS = 8192  # to find a volume to about a thousandth of the box
MESH_WORK = 20_000_000  # points times faces that a mesh is worth
STEP = np.array([0.8191725133961645, 0.6710436067037893, 0.5497004779019703])  # 1/g, 1/g², 1/g³ with g⁴ = g + 1


@dataclass(frozen=True, eq=False)
class _Copy:
    """One copy of a section, in the link's frame."""

    part: WeighedPart
    section: WeighedSection
    placement: Placement
    box: np.ndarray  # (2, 3) in the link's frame
    own_box: np.ndarray  # (2, 3) in the solid's

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Which points (n, 3) of the link's frame are inside."""
        local = (points - self.placement.position) @ self.placement.rotation
        return inside(self.section.section.solid, local)


def overlaps(link: WeighedLink) -> list[str]:
    """Warnings about sections that overlap by more than 1 % of the mass of the lightest part concerned.

    Args:
        link: a weighed link; parts with `overlaps = "ok"` are left out.
    Returns:
        warnings: a sentence each, with the volume.
    """
    copies = [copy for part in link.parts for copy in _copies(part)]
    solids = [copy for copy in copies if not copy.section.section.hole]
    holes = [copy for copy in copies if copy.section.section.hole]
    found: dict[tuple[int, int], tuple[_Copy, _Copy, float]] = {}
    for one, two in _near(solids):
        if _by_design(one, two):
            continue
        points, cell = _points(one, two)
        both = points[one.holds(points)]
        both = both[two.holds(both)]
        volume = cell * int((_count(both, solids, holes) >= 2).sum())
        key = (id(one.section), id(two.section))
        found[key] = (one, two, found[key][2] + volume if key in found else volume)
    warnings = []
    for one, two, volume in found.values():
        mass = volume * min(one.section.density, two.section.density)
        least = min(one.part.computed.amount, two.part.computed.amount)
        if mass > SHARE * least:
            pair = (
                f"{_called(one)} and {_called(two)}" if one.section is not two.section else f"copies of {_called(one)}"
            )
            warnings.append(
                f"link {link.link.name!r}: {pair} overlap by {_volume(volume)}, {mass:.3g} kg counted twice "
                f'({100 * mass / least:.3g} % of the part); overlaps = "ok" in the part accepts it'
            )
    return [*warnings, *_empty_holes(link, solids, holes)]


def _empty_holes(link: WeighedLink, solids: list[_Copy], holes: list[_Copy]) -> Iterator[str]:
    """Holes that reach out of what their part is made of, or into each other."""
    missing: dict[int, tuple[_Copy, float]] = {}
    for hole in holes:
        if hole.part.part.overlaps == "ok":
            continue
        own = [copy for copy in solids if copy.part is hole.part], [copy for copy in holes if copy.part is hole.part]
        points, cell = _points(hole, hole)
        within = points[hole.holds(points)]
        volume = cell * int((_count(within, *own) < 0).sum())
        before = missing[id(hole.section)][1] if id(hole.section) in missing else 0.0
        missing[id(hole.section)] = (hole, before + volume)
    for hole, volume in missing.values():
        mass, least = volume * hole.section.density, hole.part.computed.amount
        if mass > SHARE * least:
            yield (
                f"link {link.link.name!r}: hole {_called(hole)} takes {_volume(volume)} where its part has nothing, "
                f'{mass:.3g} kg too much ({100 * mass / least:.3g} % of the part); overlaps = "ok" in the part accepts it'
            )


def _copies(part: WeighedPart) -> Iterator[_Copy]:
    for section in part.sections:
        own = bounds(section.section.solid)
        corners = np.array(np.meshgrid(*own.T)).reshape(3, -1).T
        for placement in section.placements:
            placed = part.placement @ placement
            at = corners @ placed.rotation.T + placed.position
            yield _Copy(part, section, placed, np.array([at.min(axis=0), at.max(axis=0)]), own)


def _near(copies: list[_Copy]) -> Iterator[tuple[_Copy, _Copy]]:
    """Pairs whose boxes share room."""
    for one, two in combinations(copies, 2):
        if np.all(np.minimum(one.box[1], two.box[1]) > np.maximum(one.box[0], two.box[0])):
            yield one, two


def _by_design(one: _Copy, two: _Copy) -> bool:
    return "ok" in (one.part.part.overlaps, two.part.part.overlaps)


def _points(one: _Copy, two: _Copy) -> tuple[np.ndarray, float]:
    """Points (n, 3) in the link's frame that fill the smallest of three boxes around what two copies share, and the
    volume [m³] that each stands for.
    """
    shared = np.array([np.maximum(one.box[0], two.box[0]), np.minimum(one.box[1], two.box[1])])
    frames = [(shared, Placement.identity()), (one.own_box, one.placement), (two.own_box, two.placement)]
    box, frame = min(frames, key=lambda choice: np.prod(choice[0][1] - choice[0][0]))
    faces = [
        len(c.section.section.solid.surface().faces) for c in (one, two) if isinstance(c.section.section.solid, Mesh)
    ]
    count = POINTS if not faces else int(np.clip(MESH_WORK / sum(faces), 256, POINTS))
    size = box[1] - box[0]
    local = box[0] + size * np.mod(0.5 + np.outer(np.arange(1, count + 1), STEP), 1.0)
    return local @ frame.rotation.T + frame.position, float(np.prod(size)) / count


def _count(points: np.ndarray, solids: list[_Copy], holes: list[_Copy]) -> np.ndarray:
    """Solids less holes at each point."""
    count = np.zeros(len(points), dtype=int)
    if not len(points):
        return count
    low, high = points.min(axis=0), points.max(axis=0)
    for sign, copies in ((1, solids), (-1, holes)):
        for copy in copies:
            if np.all(copy.box[0] <= high) and np.all(low <= copy.box[1]):
                count += sign * copy.holds(points)
    return count


def _called(copy: _Copy) -> str:
    return f"{copy.part.part.name!r} {copy.section.section.name!r}"


def _volume(volume: float) -> str:
    return f"{1e6 * volume:.3g} cm³"

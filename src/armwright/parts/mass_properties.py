"""Mass properties of parts and links: section → part → link, by sums of moments that are moved from frame to frame.

Measurements of a part replace what its sections give, quantity by quantity, in this order:
weighed mass: the density and with it every moment is scaled;  centre of mass: the part is shifted, its tensor about the
centre stays;  tensor of inertia: taken as measured;  pendulum: the tensor changes as little as possible (Frobenius) so that
the moments about the measured axes are the measured ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.errors import DescriptionError
from armwright.parts.records import Part, PartsDatabase, PartsLink, Section
from armwright.solids.moments import Moments, total
from armwright.solids.visual import placement_of
from armwright.spatial import Placement

IMPOSSIBLE = 1e-9  # share of the largest eigenvalue of ∫ r rᵀ dm: a negative one beyond it is no rounding error

ENTRIES = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}  # of a tensor


@dataclass(frozen=True, eq=False)
class WeighedSection:
    """A section with all its copies. Holes have negative mass.

    Args:
        section: as written.   placements: of each copy in the part's frame.   substance: material or density, to show.
        density: [kg/m³].   material: where it has one.   volume: [m³] of one copy.   moments: of all, in the part's frame.
    """

    section: Section
    placements: tuple[Placement, ...]
    substance: str
    density: float
    material: Any
    volume: float
    moments: Moments


@dataclass(frozen=True, eq=False)
class WeighedPart:
    """A part: what its sections give, and what remains after measurements.

    Args:
        part: as written.   placement: of its frame in the link's.   sections: of it.
        computed, moments: before and after measurements override, in the part's frame.   overrides: a sentence each.
    """

    part: Part
    placement: Placement
    sections: tuple[WeighedSection, ...]
    computed: Moments
    moments: Moments
    overrides: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class WeighedLink:
    """A link. `moments` [kg, kg m, kg m²] are about the origin of the link's own frame, in its axes."""

    link: PartsLink
    parts: tuple[WeighedPart, ...]
    moments: Moments


def weigh(database: PartsDatabase) -> tuple[WeighedLink, ...]:
    """Mass properties of every link.

    Args:
        database: the parts.
    Returns:
        links: in the order of the file.
    Raises:
        DescriptionError: a solid of no volume, an open mesh, holes that take more than there is or what is not there, impossible
            measurements.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused
        return tuple(_weigh_link(database, link) for link in database.links)


def _weigh_link(database: PartsDatabase, link: PartsLink) -> WeighedLink:
    frame = placement_of(link.frame)
    try:
        parts = tuple(_weigh_part(database, part, frame @ placement_of(part)) for part in link.parts)
        moments = total(part.moments.placed(part.placement) for part in parts)
        _check_finite(moments)
    except DescriptionError as error:
        raise error.within(f"link {link.name!r}") from None
    return WeighedLink(link, parts, moments)


def _weigh_part(database: PartsDatabase, part: Part, placement: Placement) -> WeighedPart:
    try:
        sections = tuple(_weigh_section(database, part, section) for section in part.sections)
        _check_holes(sections)
        computed = total(section.moments for section in sections)
        if sections:
            _check_possible(computed, "its holes take away more than there is")
        moments, overrides = _overridden(part, computed)
        if overrides:
            _check_possible(moments, "no body can be as it was measured")
    except DescriptionError as error:
        raise error.within(f" part {part.name!r}") from None
    return WeighedPart(part, placement, sections, computed, moments, tuple(overrides))


def _weigh_section(database: PartsDatabase, part: Part, section: Section) -> WeighedSection:
    substance, density, material = database.substance(part, section)
    try:
        volume = section.solid.moments()
        if not (np.all(np.isfinite(volume.matrix)) and volume.amount > 0):
            raise DescriptionError(f"a volume of {volume.amount:g} m³", expected="a solid")
    except DescriptionError as error:
        raise error.within(f" section {section.name!r}") from None
    placements = tuple(section.placements())
    moments = total(volume.placed(placement) for placement in placements) * (-density if section.hole else density)
    return WeighedSection(section, placements, substance, density, material, volume.amount, moments)


def _check_holes(sections: tuple[WeighedSection, ...]) -> None:
    """Refuses holes in a material that their part has not, and those that do not name one of its several materials."""
    materials = {section.density: section.substance for section in sections if not section.section.hole}
    expected = f"material = ... or density_kg_per_m3 = ... of what it is in, {' or '.join(materials.values())}"
    for hole in (section for section in sections if section.section.hole):
        named = hole.section.material is not None or hole.section.density_kg_per_m3 is not None
        place = f" hole {hole.section.name!r}"
        if not materials:
            raise DescriptionError("the part has nothing to take it out of", place=place)
        if hole.density not in materials:
            what = f"takes out {hole.substance}, of which no section of the part is"
            raise DescriptionError(what, place=place, expected=expected)
        if not named and len(materials) > 1:
            what = "does not say which of the part's materials it takes out"
            raise DescriptionError(what, place=place, expected=expected)


def _check_finite(moments: Moments) -> None:
    if not np.all(np.isfinite(moments.matrix)):
        raise DescriptionError("its mass is not a finite number", expected="a robot's dimensions")


def _check_possible(moments: Moments, reason: str) -> None:
    """Refuses moments that no distribution of mass has."""
    _check_finite(moments)
    if moments.amount <= 0:
        raise DescriptionError(f"a mass of {moments.amount:.6g} kg: {reason}")
    about_centre = moments.placed(Placement(np.eye(3), -moments.centre)).matrix[:3, :3]
    eigenvalues = np.linalg.eigvalsh(about_centre)
    if eigenvalues[0] < -IMPOSSIBLE * max(eigenvalues[-1], 0.0) or eigenvalues[-1] < 0:
        fault = f"∫ r rᵀ dm about its centre of mass has the eigenvalue {eigenvalues[0]:.4g} kg m²"
        raise DescriptionError(f"{fault}: {reason}")


def _overridden(part: Part, moments: Moments) -> tuple[Moments, list[str]]:
    """Moments of a part after its measurements, and a sentence for each of them."""
    notes = []
    if part.weighed_mass_kg is not None:
        mass = float(part.weighed_mass_kg)
        note = f"weighed {mass:g} kg"
        if part.sections:
            ratio = mass / moments.amount
            note += f", computed {moments.amount:.6g} kg: densities and with them its tensor scaled by {ratio:.6g}"
            moments = moments * ratio
        else:
            moments = Moments.of(mass, np.zeros(3), np.zeros((3, 3)))
        notes.append(note)
    if part.measured_com_m is not None:
        com, computed = np.array(part.measured_com_m), moments.centre
        note = f"centre of mass measured at {_vector(com)} m"
        if part.sections:
            note += f", computed {_vector(computed)} m: shifted by {1000 * np.linalg.norm(com - computed):.3g} mm"
        notes.append(note)
        moments = moments.placed(Placement(np.eye(3), com - computed))
    if part.measured_inertia_kg_m2 is not None:
        tensor = part.measured_inertia_kg_m2.matrix().astype(float)
        computed = f", computed {_vector(np.diag(moments.tensor))}" if part.sections else ""
        notes.append(f"tensor of inertia measured, diagonal {_vector(np.diag(tensor))} kg m²{computed}")
        moments = Moments.of_tensor(moments.amount, moments.centre, tensor)
    if part.pendulums:
        tensor, sentences = _with_pendulums(part, moments)
        notes += sentences
        moments = Moments.of_tensor(moments.amount, moments.centre, tensor)
    return moments, notes


def _with_pendulums(part: Part, moments: Moments) -> tuple[np.ndarray, list[str]]:
    """Tensor about the centre of mass nearest to the computed one with the moments nᵀJn that pendulums measured."""
    mass, com, tensor = moments.amount, moments.centre, moments.tensor
    directions, changes, notes = [], [], []
    for pendulum in part.pendulums:
        axis = np.array(pendulum.axis)
        axis = axis / np.abs(axis).max()  # first: the square of a tiny entry would underflow
        axis = axis / np.linalg.norm(axis)
        arm = com - np.array(pendulum.through_m)
        distance = arm - axis * (arm @ axis)
        measured, steiner = float(pendulum.inertia_kg_m2), mass * float(distance @ distance)
        if measured <= steiner:
            expected = f"more than {steiner:.6g} kg m², which {mass:g} kg at {np.linalg.norm(distance):.4g} m from the axis have"
            place = f" pendulum about {_vector(axis)}"
            raise DescriptionError(place=place, value=measured, expected=expected)
        computed = float(axis @ tensor @ axis) + steiner
        notes.append(f"pendulum about {_vector(axis)}: {measured:g} kg m², computed {computed:.6g} kg m²")
        directions.append(np.outer(axis, axis).ravel())
        changes.append(measured - computed)
    rows = np.array(directions)
    if np.linalg.matrix_rank(rows) < len(rows):
        raise DescriptionError("pendulums about the same axes", expected="each direction once")
    return tensor + (np.linalg.pinv(rows) @ np.array(changes)).reshape(3, 3), notes


def _vector(values: np.ndarray) -> str:
    return f"[{', '.join(f'{value:.5g}' for value in values)}]"

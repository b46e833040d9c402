"""Mass properties of parts and links: section → part → link, by sums of moments that are moved from frame to frame.

What was measured of a part overrides what its sections say, quantity by quantity, in this order:
weighed mass: density and with it every moment is scaled;  centre of mass: the part is shifted, its tensor about the centre
kept;  tensor of inertia: taken as measured;  pendulum: the tensor changes as little as it can (Frobenius) so that the
moments about the measured axes are the measured ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.errors import DescriptionError
from armwright.parts.records import Part, PartsDatabase, PartsLink, Section
from armwright.solids.moments import Moments, total
from armwright.spatial import Placement

IMPOSSIBLE = 1e-9  # an eigenvalue of ∫ p pᵀ dm below minus this share of the largest is no rounding


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
    """A part: what its sections give, and what holds in the end.

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
    frame = link.construction_frame()
    parts = tuple(_weigh_part(database, link, part, frame @ part.placement()) for part in link.parts)
    moments = total(part.moments.placed(part.placement) for part in parts)
    if not np.all(np.isfinite(moments.matrix)):
        raise DescriptionError(f"link {link.name!r}: its mass is no finite number; expected a robot's dimensions")
    return WeighedLink(link, parts, moments)


def _weigh_part(database: PartsDatabase, link: PartsLink, part: Part, placement: Placement) -> WeighedPart:
    place = f"link {link.name!r} part {part.name!r}"
    sections = tuple(_weigh_section(database, part, section, place) for section in part.sections)
    _check_holes(part, sections, place)
    computed = total(section.moments for section in sections)
    if sections:
        _check(computed, place, "its holes take away more than there is")
    moments, overrides = _overridden(part, computed, place)
    if overrides:
        _check(moments, place, "no body can be as it was measured")
    return WeighedPart(part, placement, sections, computed, moments, tuple(overrides))


def _check_holes(part: Part, sections: tuple[WeighedSection, ...], place: str) -> None:
    """Refuses holes in what their part is not made of, and those that do not say in which of several materials they are."""
    made_of = {section.density: section.substance for section in sections if not section.section.hole}
    for hole in (section for section in sections if section.section.hole):
        named = hole.section.material is not None or hole.section.density_kg_per_m3 is not None
        if hole.density in made_of and (named or len(made_of) == 1):
            continue
        told = f"{place} hole {hole.section.name!r}"
        if not made_of:
            raise DescriptionError(f"{told}: the part has nothing to take it out of")
        known = " or ".join(made_of.values())
        if hole.density not in made_of:
            told += f" takes out {hole.substance}, of which no section of the part is"
        else:
            told += " does not say which of the part's materials it takes out"
        raise DescriptionError(f"{told}; expected material = ... or density_kg_per_m3 = ... of what it is in, {known}")


def _weigh_section(database: PartsDatabase, part: Part, section: Section, place: str) -> WeighedSection:
    substance, density, material = database.substance(part, section)
    try:
        volume = section.solid.moments()
    except DescriptionError as error:
        raise DescriptionError(f"{place} section {section.name!r}: {error}") from None
    if not (np.all(np.isfinite(volume.matrix)) and volume.amount > 0):
        raise DescriptionError(f"{place} section {section.name!r}: a volume of {volume.amount:g} m³; expected a solid")
    placements = tuple(section.placements())
    moments = total(volume.placed(placement) for placement in placements) * (-density if section.hole else density)
    return WeighedSection(section, placements, substance, density, material, volume.amount, moments)


def _check(moments: Moments, place: str, fault: str) -> None:
    """Refuses what no distribution of mass can be."""
    if not np.all(np.isfinite(moments.matrix)):
        raise DescriptionError(f"{place}: its mass is no finite number; expected a robot's dimensions")
    if moments.amount <= 0:
        raise DescriptionError(f"{place} has a mass of {moments.amount:.6g} kg: {fault}")
    about_centre = moments.placed(Placement(np.eye(3), -moments.centre)).matrix[:3, :3]
    eigenvalues = np.linalg.eigvalsh(about_centre)
    if eigenvalues[0] < -IMPOSSIBLE * max(eigenvalues[-1], 0.0) or eigenvalues[-1] < 0:
        raise DescriptionError(
            f"{place}: ∫ r rᵀ dm about its centre of mass has the eigenvalue {eigenvalues[0]:.4g} kg m²: {fault}"
        )


def _overridden(part: Part, moments: Moments, place: str) -> tuple[Moments, list[str]]:
    """The measured moments of a part, and what they replace."""
    told = []
    if part.weighed_mass_kg is not None:
        mass = float(part.weighed_mass_kg)
        if part.sections:
            ratio = mass / moments.amount
            told.append(
                f"weighed {mass:g} kg, computed {moments.amount:.6g} kg: densities and with them its tensor scaled by {ratio:.6g}"
            )
            moments = moments * ratio
        else:
            told.append(f"weighed {mass:g} kg")
            moments = Moments.of(mass, np.zeros(3), np.zeros((3, 3)))
    if part.measured_com_m is not None:
        com, was = np.array(part.measured_com_m), moments.centre
        shown = (
            f", computed {_vector(was)} m: shifted by {1000 * np.linalg.norm(com - was):.3g} mm"
            if part.sections
            else ""
        )
        told.append(f"centre of mass measured at {_vector(com)} m{shown}")
        moments = moments.placed(Placement(np.eye(3), com - was))
    if part.measured_inertia_kg_m2 is not None:
        tensor = part.measured_inertia_kg_m2.matrix().astype(float)
        was = f", computed {_vector(np.diag(moments.tensor))}" if part.sections else ""
        told.append(f"tensor of inertia measured, diagonal {_vector(np.diag(tensor))} kg m²{was}")
        moments = Moments.of_tensor(moments.amount, moments.centre, tensor)
    if part.pendulums:
        tensor, sentences = _swung(part, moments, place)
        told += sentences
        moments = Moments.of_tensor(moments.amount, moments.centre, tensor)
    return moments, told


def _swung(part: Part, moments: Moments, place: str) -> tuple[np.ndarray, list[str]]:
    """The tensor about the centre of mass nearest to the computed one with the moments nᵀJn that pendulums found."""
    mass, com, tensor = moments.amount, moments.centre, moments.tensor
    directions, wanted, told = [], [], []
    for pendulum in part.pendulums:
        axis = np.array(pendulum.axis)
        axis = axis / np.abs(axis).max()
        axis = axis / np.linalg.norm(axis)
        arm = com - np.array(pendulum.through_m)
        distance = arm - axis * (arm @ axis)
        found, steiner = float(pendulum.inertia_kg_m2), mass * float(distance @ distance)
        if found <= steiner:
            raise DescriptionError(
                f"{place}: pendulum about {_vector(axis)} gives {found:g} kg m², but {mass:g} kg at "
                f"{np.linalg.norm(distance):.4g} m from the axis have {steiner:.6g} kg m² already"
            )
        computed = float(axis @ tensor @ axis) + steiner
        told.append(f"pendulum about {_vector(axis)}: {found:g} kg m², computed {computed:.6g} kg m²")
        directions.append(np.outer(axis, axis).ravel())
        wanted.append(found - computed)
    rows = np.array(directions)
    if np.linalg.matrix_rank(rows) < len(rows):
        raise DescriptionError(f"{place}: pendulums about the same axes; expected each direction once")
    return tensor + (np.linalg.pinv(rows) @ np.array(wanted)).reshape(3, 3), told


def _vector(values: np.ndarray) -> str:
    return f"[{', '.join(f'{value:.5g}' for value in values)}]"

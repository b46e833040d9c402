"""Parts Database → Manipulator Database: mass properties in the links' frames, each with a source that names its sections."""

from __future__ import annotations

import os
from dataclasses import dataclass
from math import floor, log10
from pathlib import Path
from typing import Any

import numpy as np

from armwright.description.built_from import BuiltFrom, built_from
from armwright.description.paths import quantities
from armwright.description.robot import Link, RobotDescription
from armwright.description.toml_file import read_record
from armwright.errors import DescriptionError, Problem
from armwright.lint.plausibility import implausible_sections
from armwright.parts.mass_properties import ENTRIES, WeighedLink, WeighedSection, weigh
from armwright.parts.materials import common_materials
from armwright.parts.overlap import overlaps
from armwright.parts.records import PartsDatabase
from armwright.quantity import Source
from armwright.solids.mesh import Mesh
from armwright.solids.visual import Visual
from armwright.spatial import Placement, rpy_angles, snap
from armwright.validation import validated

DIGITS = 12  # of the largest entry; further digits depend on the order of the sum
TRUST = ("estimate", "cad", "drawing", "datasheet", "publication", "definition", "fit", "measurement")  # least first


@dataclass(frozen=True, eq=False, repr=False)
class PartsBuild:
    """An arm built from parts.

    Args:
        database: the parts.   links: weighed.   description: the arm.
        overrides: what measurements replaced.   warnings: probable mistakes; `description.remarks` has them as text.
    Example:
        >>> parts = aw.__path__[0] + "/robots/cmu-dd.parts.toml"
        >>> build = aw.robotfiles.write_parts(parts, "own.toml")
        >>> build
        <PartsBuild 'cmu-dd', 93.8349 kg, 6 links, 0 overrides, 0 warnings>
    """

    database: PartsDatabase
    links: tuple[WeighedLink, ...]
    description: RobotDescription
    overrides: tuple[Problem, ...]
    warnings: tuple[Problem, ...]

    def __repr__(self) -> str:
        arm, counts = self.description, {"links": self.links, "overrides": self.overrides, "warnings": self.warnings}
        return f"<PartsBuild {arm.name!r}, {arm.total_mass:.6g} kg, {', '.join(f'{len(v)} {k}' for k, v in counts.items())}>"


def build_parts(path: str | os.PathLike[str], folder: str | os.PathLike[str] | None = None) -> PartsBuild:
    """The arm that a parts file describes.

    Args:
        path: of the *.parts.toml file.   folder: where the arm's file will stand; None: beside the parts.
    Returns:
        build: the description with the weighed links behind it.
    Raises:
        DescriptionError: the file, or a part in it, is invalid.
    """
    path = Path(path)
    database = read_record(path, PartsDatabase)
    meshes = [
        s.solid.file for link in database.links for p in link.parts for s in p.sections if isinstance(s.solid, Mesh)
    ]
    try:
        return arm_of_parts(database, built_from(path, meshes, None if folder is None else Path(folder)))
    except DescriptionError as error:
        raise error.within(file=path) from None


def arm_of_parts(database: PartsDatabase, origin: BuiltFrom) -> PartsBuild:
    """The arm of a parts database that was read from a file.

    Raises:
        DescriptionError: a part that cannot be weighed, or an arm that does not hang together.
    """
    links = weigh(database)
    warnings = tuple(warning for link in links for warning in (*implausible_sections(link), *overlaps(link)))
    sources = dict(database.sources)
    records = []
    for link in links:
        key = _unused(f"sum-{link.link.name}", sources)
        sources[key] = _source(database, link, Path(origin.file).name)
        records.append(_link(link, key))
    shared = database.model_fields_set - {"sources", "materials", "links"}
    head = {name: getattr(database, name) for name in sorted(shared)}
    fields = {**head, "sources": sources, "built_from": origin, "links": tuple(records)}
    fields["remarks"] = tuple(map(str, warnings))
    description = validated(RobotDescription, fields)
    overrides = tuple(
        Problem(override, f"link {link.link.name!r} part {part.part.name!r}")
        for link in links
        for part in link.parts
        for override in part.overrides
    )
    return PartsBuild(database, links, description, overrides, warnings)


def _link(link: WeighedLink, source: str) -> Link:
    """Rounded to twelve digits, so that the same parts give the same file on every machine."""
    tensor = _rounded(link.moments.tensor)
    com = np.round(link.moments.centre, DIGITS) + 0.0
    fields: dict[str, Any] = {"source": source, "name": link.link.name, "mass_kg": _mass(link), "com_m": com.tolist()}
    fields["inertia_kg_m2"] = {name: float(tensor[place]) for name, place in ENTRIES.items()}
    return Link(**fields, visuals=_visuals(link))


def _mass(link: WeighedLink) -> Any:
    """The sum of the parts; its variance is that of the weighed ones, all others counting as exact."""
    mass = float(_rounded(np.array(link.moments.amount)))
    weighed = [part.part.weighed_mass_kg for part in link.parts]
    deviations = [float(np.max(mass.std)) for mass in weighed if mass is not None and mass.std is not None]
    std = float(_rounded(np.array(np.linalg.norm(deviations)))) if deviations else 0.0
    return {"value": mass, "std": std} if std else mass


def _rounded(values: np.ndarray) -> np.ndarray:
    largest = float(np.abs(values).max())
    return np.round(values, DIGITS - 1 - floor(log10(largest))) + 0.0 if largest else values + 0.0


def _visuals(link: WeighedLink) -> tuple[Visual, ...]:
    """Every copy of every section, as the solid that it is."""
    return tuple(
        _visual(f"{part.part.name} {section.section.name}", section, part.placement @ placement)
        for part in link.parts
        for section in part.sections
        for placement in section.placements
    )


def _visual(name: str, section: WeighedSection, placement: Placement) -> Visual:
    colour = section.material.colour if section.material is not None else None
    return Visual(
        name=name,
        solid=section.section.solid,
        xyz_m=(np.round(placement.position, 9) + 0.0).tolist(),  # type: ignore[arg-type]
        rpy_rad=(np.round(rpy_angles(snap(placement.rotation) + 0.0), 9) + 0.0).tolist(),  # type: ignore[arg-type]
        hole=section.section.hole,
        colour=colour,
    )


def _source(database: PartsDatabase, link: WeighedLink, file: str) -> Source:
    """Source that lists the sections that were summed; its kind is that of the least trusted number among them."""
    if not link.parts:
        return Source(kind="definition", text=f"no parts in {file}: massless")
    used = {source or database.source or "" for _, _, source in quantities(link.link)}
    kinds = {database.sources[key].kind if key in database.sources else key for key in used}
    substances: dict[str, float] = {}
    for section in (section for part in link.parts for section in part.sections):
        substances[section.substance] = section.density
        if section.material is not None:
            kinds.add(_kind(database, section))
    count = sum(section.section.count for part in link.parts for section in part.sections)
    names = ", ".join(" ".join(filter(None, (part.part.name, part.part.title))) for part in link.parts)
    densities = ", ".join(
        name if name.endswith("kg/m³") else f"{name} {rho:g} kg/m³" for name, rho in substances.items()
    )
    measured = ", ".join(part.part.name for part in link.parts if part.overrides)
    text = f"sum of {count} sections in {len(link.parts)} parts of {file}: {names}"
    text += f"; {densities}" if densities else ""
    text += f"; measured: {measured}" if measured else ""
    return Source(kind=min(kinds, key=TRUST.index), text=text)  # type: ignore[arg-type]


def _kind(database: PartsDatabase, section: WeighedSection) -> str:
    """The kind of source that a material's density has."""
    material = section.material
    own = section.substance in database.materials
    table = database.sources if own else common_materials().sources
    key = material.density_kg_per_m3.source or material.source or (database.source if own else None)
    return table[key].kind if key in table else str(key)


def _unused(key: str, taken: dict[str, Source]) -> str:
    while key in taken:
        key += "-parts"
    return key

"""Sections whose density or size looks like another unit's. Few false alarms."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armwright.errors import Problem
from armwright.parts.mass_properties import WeighedLink
from armwright.solids.mesh import Mesh

LIGHTEST, HEAVIEST = 23.0, 23_000.0  # [kg/m³]: osmium has 22.6 g/cm³, and the lightest foams less than 23 kg/m³
LONGEST = 10.0  # [m]


def doubtful_sections(link: WeighedLink) -> Iterator[Problem]:
    """Densities that would be a material's in g/cm³ or g/m³, and meshes that would be of a robot's size in millimetres.

    Args:
        link: a weighed link.
    Returns:
        warnings: one for each number that looks wrong.
    """
    for part in link.parts:
        for section in part.sections:
            place = f"link {link.link.name!r} part {part.part.name!r} section {section.section.name!r}"
            stated = f"a density of {section.density:g} kg/m³"
            if section.density < LIGHTEST:
                yield Problem(f"{stated}: g/cm³ for kg/m³?", place, expected=f"{1000 * section.density:g}")
            elif section.density > HEAVIEST:
                yield Problem(f"{stated}, more than any material's: g/m³ for kg/m³?", place)
            if isinstance(section.section.solid, Mesh):
                size = float(np.ptp(section.section.solid.surface().bounds, axis=0).max())
                if size > LONGEST:
                    yield Problem(f"a mesh of {size:.4g} m: millimetres for metres?", place, expected="scale = 0.001")

"""Masses and tensors against what a link looks like. Opens meshes, so it is asked for and never part of loading.

The hull is the convex hull of the link's visuals; U is the tensor of the link's mass spread evenly over it, about the link's
centre of mass. Real links are hollow, with motors at their ends, so I may differ from U by a small factor, not by
a large one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armwright.description.robot import Link, RobotDescription
from armwright.errors import DescriptionError
from armwright.lint.mass_properties import about_origin, is_fit
from armwright.solids.surface import surface
from armwright.spatial import parallel_axes

if TYPE_CHECKING:
    import trimesh

THIN, DENSE = 20.0, 20_000.0  # [kg/m³] of mass over the hull's volume: foam, tungsten
LARGER, SMALLER = 5.0, 0.02  # of U's trace: beyond is no body of that shape
ORIGIN_WORSE, ORIGIN_BETTER = 1.7, 1.35  # how far from U's trace as it is, how near as a tensor about the origin
LIGHTEST = 1e-3  # [kg]


def hull_doubts(robot: RobotDescription) -> list[str]:
    """Sentences about links whose density or tensor does not go with their visuals; none for links without.

    Args:
        robot: the description.
    Returns:
        doubts: among them meshes that cannot be opened.
    """
    found: list[str] = []
    closed: dict[str, list[str]] = {}
    for link in robot.links:
        if float(link.mass_kg) <= LIGHTEST or not link.visuals:
            continue
        try:
            hull = _hull(link)
        except DescriptionError as error:
            closed.setdefault(str(error), []).append(link.name)
            continue
        if hull is not None:
            found += [f"link {link.name}: {told}" for told in _of_link(link, hull, is_fit=is_fit(robot, link))]
    if closed:
        names = [name for names in closed.values() for name in names]
        found.append(f"the visuals of {', '.join(names)} are not looked at: {next(iter(closed))}")
    return found


def _of_link(link: Link, hull: trimesh.Trimesh, *, is_fit: bool) -> list[str]:
    mass, volume = float(link.mass_kg), float(hull.volume)
    told = []
    density = mass / volume
    if not THIN <= density <= DENSE:
        why = (
            "meshes in mm, or grams for kilograms?"
            if density > DENSE or density < THIN / 100
            else "a hull, not a body?"
        )
        told.append(f"{mass:.4g} kg in a hull of {volume:.3g} m³ are {density:.3g} kg/m³: {why}")
    if is_fit:
        return told
    com = np.array(link.com_m)
    spread = np.asarray(hull.moment_inertia) * density + parallel_axes(mass, com - np.asarray(hull.center_mass))
    tensor = link.inertia_kg_m2.matrix()
    size = float(np.trace(spread))  # the trace, 2 ∫ r² dm, does not mind how hull and body are turned
    ratio = float(np.trace(tensor)) / size
    moved = about_origin(mass, com, tensor)
    if moved is not None and ratio > ORIGIN_WORSE and 1 / ORIGIN_BETTER < float(np.trace(moved)) / size < ORIGIN_BETTER:
        told.append(
            f"its tensor is {ratio:.3g} times that of its shape, and fits it as one about the frame's origin: "
            "a tensor about the frame's origin, not about the centre of mass?"
        )
    elif ratio > LARGER:
        told.append(f"its tensor is {ratio:.3g} times that of its shape: {_units(ratio)}")
    elif ratio == 0:
        told.append("its tensor is 0, that of a point, and it looks like a body: one that was forgotten?")
    elif ratio < SMALLER:
        told.append(f"its tensor is {ratio:.3g} times that of its shape: {_units(1 / ratio)}")
    return told


def _units(factor: float) -> str:
    """The mistake in units that a factor between tensors looks like."""
    if factor > 2e5:
        return "millimetres for metres?"
    return "grams for kilograms?" if factor > 200 else "a placeholder, or another link's?"


def _hull(link: Link) -> trimesh.Trimesh | None:
    """Convex hull of a link's visuals in its frame; None where they are flat."""
    import trimesh

    clouds = [np.zeros((0, 3))]
    for visual in link.visuals:
        if not visual.hole:
            at = visual.placement()
            clouds.append(surface(visual.solid).vertices @ at.rotation.T + at.position)
    points = np.concatenate(clouds)
    if len(points) < 4 or np.linalg.matrix_rank(points - points.mean(axis=0), tol=1e-6) < 3:
        return None
    hull = trimesh.convex.convex_hull(points)
    return hull if hull.volume > 0 else None

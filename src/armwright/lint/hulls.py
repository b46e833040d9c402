"""Masses and tensors compared with a link's shape. It opens meshes, so it runs on request only, not on loading.

The hull is the convex hull of the link's visuals; U is the tensor of the link's mass spread evenly over it, about the link's
centre of mass. Real links are hollow, with motors at their ends, so I may differ from U by a small factor, not by
a large one.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from armwright.description.robot import Link, RobotDescription
from armwright.errors import DescriptionError, Problem
from armwright.lint.plausibility import ABOUT_ORIGIN, about_origin, is_fit
from armwright.solids.surface import surface
from armwright.spatial import parallel_axes

if TYPE_CHECKING:
    import trimesh

THIN, DENSE = 20.0, 20_000.0  # [kg/m³] of mass over the hull's volume: foam, tungsten
LARGER, SMALLER = 5.0, 0.02  # of U's trace: beyond is no body of that shape
ORIGIN_WORSE, ORIGIN_BETTER = 1.7, 1.35  # how far from U's trace as it is, how near as a tensor about the origin
LIGHTEST = 1e-3  # [kg]


def implausible_shapes(robot: RobotDescription) -> list[Problem]:
    """Links whose density or tensor does not go with their visuals; nothing about links without visuals.

    Args:
        robot: the description.
    Returns:
        findings: among them meshes that cannot be opened.
    """
    findings: list[Problem] = []
    unread: dict[str, list[str]] = {}
    for link in robot.links:
        if float(link.mass_kg) <= LIGHTEST or not link.visuals:
            continue
        try:
            hull = _hull(link)
        except DescriptionError as error:
            unread.setdefault(str(error), []).append(link.name)
            continue
        if hull is not None:
            problems = _of_link(link, hull, is_fit=is_fit(robot, link))
            findings += [problem.within(f"link {link.name!r}") for problem in problems]
    if unread:
        names = ", ".join(repr(name) for names in unread.values() for name in names)
        findings.append(Problem(f"the visuals are not looked at: {next(iter(unread))}", f"links {names}"))
    return findings


def _of_link(link: Link, hull: trimesh.Trimesh, *, is_fit: bool) -> Iterator[Problem]:
    mass, volume = float(link.mass_kg), float(hull.volume)
    density = mass / volume
    if not THIN <= density <= DENSE:
        in_wrong_unit = density > DENSE or density < THIN / 100
        why = "meshes in mm, or grams for kilograms?" if in_wrong_unit else "a hull, not a body?"
        yield Problem(f"in a hull of {volume:.3g} m³ these are {density:.3g} kg/m³: {why}", "mass_kg", mass)
    if is_fit:
        return
    com = np.array(link.com_m)
    spread = np.asarray(hull.moment_inertia) * density + parallel_axes(mass, com - np.asarray(hull.center_mass))
    tensor = link.inertia_kg_m2.matrix()
    size = float(np.trace(spread))  # the trace, 2 ∫ r² dm, does not mind how hull and body are turned
    ratio = float(np.trace(tensor)) / size
    moved = about_origin(mass, com, tensor)
    fits_origin = moved is not None and 1 / ORIGIN_BETTER < float(np.trace(moved)) / size < ORIGIN_BETTER
    if ratio > ORIGIN_WORSE and fits_origin:
        why = f"and fits it as one about the frame's origin: {ABOUT_ORIGIN}"
        yield Problem(f"{ratio:.3g} times the tensor of its shape, {why}", "inertia_kg_m2")
    elif ratio == 0:
        yield Problem("that of a point, and it looks like a body: one that was forgotten?", "inertia_kg_m2", 0.0)
    elif ratio > LARGER or ratio < SMALLER:
        yield Problem(f"{ratio:.3g} times the tensor of its shape: {_units(max(ratio, 1 / ratio))}", "inertia_kg_m2")


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

"""Which points lie inside a solid, and the box that holds it; in the solid's own frame."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np

from armwright.description.solids.mesh import Mesh
from armwright.description.solids.shapes import Box, Cone, Cylinder, Ellipsoid, Prism, SemiCylinder, Sphere, Tube
from armwright.description.solids.shells import winding_numbers


@singledispatch
def inside(solid: Any, points: np.ndarray) -> np.ndarray:
    """Which of the points (n, 3) [m] lie in the solid: (n,) of bool."""
    raise NotImplementedError(type(solid).__name__)


@singledispatch
def bounds(solid: Any) -> np.ndarray:
    """Lowest and highest corner of the solid (2, 3) [m]."""
    raise NotImplementedError(type(solid).__name__)


def _between(points: np.ndarray, length: Any) -> np.ndarray:
    return np.abs(points[:, 2]) <= float(length) / 2


def _from_axis(points: np.ndarray) -> np.ndarray:
    return np.hypot(points[:, 0], points[:, 1])


def _about(*half: Any) -> np.ndarray:
    size = np.array([float(value) for value in half])
    return np.array([-size, size])


@inside.register
def _(solid: Cylinder, points: np.ndarray) -> np.ndarray:
    return (_from_axis(points) <= float(solid.radius_m)) & _between(points, solid.length_m)


@bounds.register
def _(solid: Cylinder) -> np.ndarray:
    return _about(solid.radius_m, solid.radius_m, float(solid.length_m) / 2)


@inside.register
def _(solid: SemiCylinder, points: np.ndarray) -> np.ndarray:
    return (_from_axis(points) <= float(solid.radius_m)) & _between(points, solid.length_m) & (points[:, 1] >= 0)


@bounds.register
def _(solid: SemiCylinder) -> np.ndarray:
    box = _about(solid.radius_m, solid.radius_m, float(solid.length_m) / 2)
    box[0, 1] = 0.0
    return box


@inside.register
def _(solid: Box, points: np.ndarray) -> np.ndarray:
    return np.all(np.abs(points) <= np.array(solid.size_m) / 2, axis=1)


@bounds.register
def _(solid: Box) -> np.ndarray:
    return _about(*np.array(solid.size_m) / 2)


@inside.register
def _(solid: Sphere, points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points, axis=1) <= float(solid.radius_m)


@bounds.register
def _(solid: Sphere) -> np.ndarray:
    return _about(solid.radius_m, solid.radius_m, solid.radius_m)


@inside.register
def _(solid: Prism, points: np.ndarray) -> np.ndarray:
    """A ray along x crosses the outline an odd number of times."""
    a = np.array(solid.outline_m)
    x, y, crossings = points[:, 0], points[:, 1], np.zeros(len(points), dtype=int)
    for (x1, y1), (x2, y2) in zip(a, np.roll(a, -1, axis=0), strict=True):
        if y1 != y2:
            crossings += ((y1 <= y) != (y2 <= y)) & (x < x1 + (y - y1) * ((x2 - x1) / (y2 - y1)))
    return (crossings % 2 == 1) & _between(points, solid.length_m)


@bounds.register
def _(solid: Prism) -> np.ndarray:
    outline, z = np.array(solid.outline_m), float(solid.length_m) / 2
    return np.array([[*outline.min(axis=0), -z], [*outline.max(axis=0), z]])


@inside.register
def _(solid: Tube, points: np.ndarray) -> np.ndarray:
    radius = _from_axis(points)
    wall = (float(solid.inner_radius_m) <= radius) & (radius <= float(solid.outer_radius_m))
    return wall & _between(points, solid.length_m)


@bounds.register
def _(solid: Tube) -> np.ndarray:
    return _about(solid.outer_radius_m, solid.outer_radius_m, float(solid.length_m) / 2)


@inside.register
def _(solid: Cone, points: np.ndarray) -> np.ndarray:
    up = points[:, 2] / float(solid.length_m) + 0.5
    radius = (1 - up) * float(solid.bottom_radius_m) + up * float(solid.top_radius_m)
    return (_from_axis(points) <= radius) & _between(points, solid.length_m)


@bounds.register
def _(solid: Cone) -> np.ndarray:
    radius = max(float(solid.bottom_radius_m), float(solid.top_radius_m))
    return _about(radius, radius, float(solid.length_m) / 2)


@inside.register
def _(solid: Ellipsoid, points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points / np.array(solid.semi_axes_m), axis=1) <= 1


@bounds.register
def _(solid: Ellipsoid) -> np.ndarray:
    return _about(*np.array(solid.semi_axes_m))


@inside.register
def _(solid: Mesh, points: np.ndarray) -> np.ndarray:
    """Where the surface goes round the point."""
    return np.abs(winding_numbers(np.asarray(solid.surface().triangles), points)) > 0.5


@bounds.register
def _(solid: Mesh) -> np.ndarray:
    return np.array(solid.surface().bounds)

"""Surface of every kind of solid as triangles that face outward, in the solid's own frame.  [DawsonHaggerty2019]

Pictures, the audit's pictures, overlaps and hulls are computed from these triangles. A round solid becomes one with flat sides,
inscribed in it. Mass properties are not computed from them but in closed form (`shapes.py`).
"""

from __future__ import annotations

from math import log2, pi
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.solids.mesh import Mesh
from armwright.solids.shapes import Box, Cone, Cylinder, Ellipsoid, Prism, SemiCylinder, Sphere, Tube

if TYPE_CHECKING:
    import trimesh

AROUND = 36  # flat sides of what is round, enough for a picture


def surface(solid: Any, around: int = AROUND) -> trimesh.Trimesh:
    """Boundary of a solid [m], closed and facing outward; a mesh is as its file has it.

    Args:
        solid: one of `solids`.   around: flat sides of a full circle; an even number.
    Raises:
        DescriptionError: a mesh whose file is missing or cannot be read.
    """
    from trimesh import creation

    turns = np.linspace(0.0, 2 * pi, around, endpoint=False)
    circle = np.column_stack([np.cos(turns), np.sin(turns)])
    match solid:
        case Mesh():
            return solid.surface()
        case Box():
            return creation.box(extents=np.array(solid.size_m, dtype=float))
        case Sphere() | Ellipsoid():
            globe = creation.icosphere(subdivisions=round(log2(around / 5)))  # of 5 · 2ᵏ sides
            globe.vertices *= np.array(solid.radius_m if isinstance(solid, Sphere) else solid.semi_axes_m, dtype=float)
            return globe
        case Cylinder():
            return extruded([float(solid.radius_m) * circle], solid.length_m)
        case Cone():
            return extruded([circle], solid.length_m, float(solid.bottom_radius_m), float(solid.top_radius_m))
        case Tube():
            return extruded(
                [float(solid.outer_radius_m) * circle, float(solid.inner_radius_m) * circle], solid.length_m
            )
        case SemiCylinder():
            return extruded([float(solid.radius_m) * np.vstack([circle[: around // 2], [[-1.0, 0.0]]])], solid.length_m)
        case Prism():
            return extruded([np.array(solid.outline_m, dtype=float).reshape(-1, 2)], solid.length_m)
    raise NotImplementedError(type(solid).__name__)


def extruded(rings: list[np.ndarray], length: Any, bottom: float = 1.0, top: float = 1.0) -> trimesh.Trimesh:
    """Simple polygon in the x-y plane, with holes or without, extruded along z on both sides of it.  [Meisters1975]

    trimesh's `revolve`, `annulus` and `extrude_triangulation` are not used: they merge points nearer than 1e-8 m and drop thin
    triangles, so a disc of 0.1 m radius and 1 µm is left open.

    Args:
        rings: (k, 2) [m] corners in order, either way round: the outline, then each hole.   length: [m].
        bottom, top: factors of the polygon at its two ends; 0 for a point.
    """
    import trimesh
    from mapbox_earcut import triangulate_float64

    rings = [ring if (_area(ring) > 0) == (k == 0) else ring[::-1] for k, ring in enumerate(rings)]
    polygon, ends = np.vstack(rings), np.cumsum([len(ring) for ring in rings])
    lid = triangulate_float64(polygon, ends.astype(np.uint32)).reshape(-1, 3).astype(int)
    k, count = np.arange(len(polygon)), len(polygon)
    after = np.concatenate([np.roll(ring, -1) for ring in np.split(k, ends[:-1])])
    sides = [np.column_stack([k, after, after + count]), np.column_stack([k, after + count, k + count])]
    z = np.full((count, 1), float(length) / 2)
    vertices = np.vstack([np.hstack([bottom * polygon, -z]), np.hstack([top * polygon, z])])
    points = [0 if bottom == 0 else k, count + (0 if top == 0 else k)]  # an end that is a point is one vertex
    triangles = np.vstack([lid[:, ::-1], lid + count, *sides])
    triangles = np.concatenate([np.broadcast_to(end, count) for end in points])[triangles]
    sound = (np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)
    return trimesh.Trimesh(vertices, triangles[sound], process=False)


def _area(ring: np.ndarray) -> float:
    x, y = (ring - ring[0]).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2

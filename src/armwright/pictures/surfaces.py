"""The surface of every kind of solid as triangles that face outward, in the solid's own frame."""

from __future__ import annotations

from functools import singledispatch
from math import pi
from typing import Any

import numpy as np

from armwright.description.solids.mesh import Mesh
from armwright.description.solids.shapes import Box, Cone, Cylinder, Ellipsoid, Prism, SemiCylinder, Sphere, Tube

AROUND = 36  # flat sides of what is round


@singledispatch
def surface(solid: Any) -> Any:
    """The solid's boundary as a `trimesh.Trimesh` [m], closed and facing outward where the solid is.

    Args:
        solid: one of `description.solids`.
    Raises:
        DescriptionError: a mesh whose file is missing or cannot be read.
    """
    raise NotImplementedError(type(solid).__name__)


@surface.register
def _(solid: Cylinder) -> Any:
    from trimesh.creation import cylinder

    return cylinder(radius=float(solid.radius_m), height=float(solid.length_m), sections=AROUND)


@surface.register
def _(solid: Tube) -> Any:
    from trimesh.creation import annulus

    inner, outer = float(solid.inner_radius_m), float(solid.outer_radius_m)
    return annulus(r_min=inner, r_max=outer, height=float(solid.length_m), sections=AROUND)


@surface.register
def _(solid: Cone) -> Any:
    from trimesh.creation import revolve

    z, low, high = float(solid.length_m) / 2, float(solid.bottom_radius_m), float(solid.top_radius_m)
    profile = [[0.0, -z], *([[low, -z]] if low else []), *([[high, z]] if high else []), [0.0, z]]
    return revolve(np.array(profile), sections=AROUND)


@surface.register
def _(solid: Box) -> Any:
    from trimesh.creation import box

    return box(extents=np.array(solid.size_m, dtype=float))


@surface.register
def _(solid: Sphere) -> Any:
    return _globe(np.full(3, float(solid.radius_m)))


@surface.register
def _(solid: Ellipsoid) -> Any:
    return _globe(np.array(solid.semi_axes_m, dtype=float))


@surface.register
def _(solid: SemiCylinder) -> Any:
    turns = np.linspace(0.0, pi, AROUND // 2 + 1)
    return extruded(float(solid.radius_m) * np.column_stack([np.cos(turns), np.sin(turns)]), float(solid.length_m))


@surface.register
def _(solid: Prism) -> Any:
    return extruded(np.array(solid.outline_m, dtype=float).reshape(-1, 2), float(solid.length_m))


@surface.register
def _(solid: Mesh) -> Any:
    return solid.surface()


def _globe(semi_axes: np.ndarray) -> Any:
    from trimesh.creation import icosphere

    globe = icosphere(subdivisions=3)
    globe.vertices *= semi_axes
    return globe


def extruded(outline: np.ndarray, length: float) -> Any:
    """A simple polygon in the x-y plane, drawn out along z on both sides of it.

    Args:
        outline: (k, 2) [m] corners in order, either way round.   length: [m].
    Returns:
        mesh: a `trimesh.Trimesh`, closed, facing outward.
    """
    import trimesh

    if _area(outline) < 0:
        outline = outline[::-1]
    count = len(outline)
    low, high = (np.column_stack([outline, np.full(count, z)]) for z in (-length / 2, length / 2))
    k = np.arange(count)
    after = (k + 1) % count
    lid = ears(outline)
    sides = [np.column_stack([k, after, after + count]), np.column_stack([k, after + count, k + count])]
    return trimesh.Trimesh(np.vstack([low, high]), np.vstack([lid[:, ::-1], lid + count, *sides]))


def ears(outline: np.ndarray) -> np.ndarray:
    """A simple polygon as triangles, by clipping ears.  [Meisters1975]

    Args:
        outline: (k, 2) corners, counter-clockwise.
    Returns:
        triangles: (k - 2, 3) indices of corners, counter-clockwise.
    """
    left, found = list(range(len(outline))), []
    while len(left) > 3:
        best = max(range(len(left)), key=lambda k: _ear(outline, left, k))
        found.append([left[best - 1], left[best], left[(best + 1) % len(left)]])
        del left[best]
    return np.array([*found, left])


def _ear(outline: np.ndarray, left: list[int], k: int) -> tuple[bool, float]:
    """Whether corner k can be cut off, and how fat what is cut off would be."""
    corners = [left[k - 1], left[k], left[(k + 1) % len(left)]]
    a, b, c = outline[corners]
    twice = _cross(b - a, c - a)
    longest = max(float((p - q) @ (p - q)) for p, q in ((a, b), (b, c), (c, a)))
    rest = outline[[j for j in left if j not in corners]]
    sides = np.column_stack([_cross(q - p, rest - p) for p, q in ((a, b), (b, c), (c, a))])
    free = twice > 0 and not (sides >= 0).all(axis=1).any()
    return free, twice / longest if longest else 0.0


def _area(outline: np.ndarray) -> float:
    return float(_cross(outline, np.roll(outline, -1, axis=0)).sum()) / 2


def _cross(a: np.ndarray, b: np.ndarray) -> Any:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]

"""The faces of a solid as flat polygons, coarse but true enough to recognise it in a picture; in the solid's own frame."""

from __future__ import annotations

from functools import singledispatch
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np

from armwright.description.solids.mesh import Mesh
from armwright.description.solids.shapes import Box, Cone, Cylinder, Ellipsoid, Prism, SemiCylinder, Sphere, Tube

AROUND = 40  # corners of a circle
MOST_FACES = 4000  # of a mesh that is drawn

Faces = list[np.ndarray]


@singledispatch
def faces(solid: Any) -> Faces:
    """Polygons (k, 3) [m] that bound the solid."""
    raise NotImplementedError(type(solid).__name__)


def _circle(radius: float, angle: float = 2 * pi) -> np.ndarray:
    turns = np.linspace(0, angle, AROUND, endpoint=angle < 2 * pi)  # the last corner of a full circle is the first
    return radius * np.column_stack([np.cos(turns), np.sin(turns)])


def _at(outline: np.ndarray, z: float) -> np.ndarray:
    return np.column_stack([outline, np.full(len(outline), z)])


def _sides(bottom: np.ndarray, top: np.ndarray) -> Faces:
    after = np.roll(np.arange(len(bottom)), -1)
    return [np.array([bottom[k], bottom[j], top[j], top[k]]) for k, j in enumerate(after)]


def _extruded(outline: np.ndarray, length: Any) -> Faces:
    low, high = _at(outline, -float(length) / 2), _at(outline, float(length) / 2)
    return [low, high, *_sides(low, high)]


@faces.register
def _(solid: Cylinder) -> Faces:
    return _extruded(_circle(float(solid.radius_m)), solid.length_m)


@faces.register
def _(solid: SemiCylinder) -> Faces:
    return _extruded(_circle(float(solid.radius_m), pi), solid.length_m)


@faces.register
def _(solid: Prism) -> Faces:
    return _extruded(np.array(solid.outline_m), solid.length_m)


@faces.register
def _(solid: Box) -> Faces:
    x, y, z = np.array(solid.size_m) / 2
    return _extruded(np.array([[x, y], [-x, y], [-x, -y], [x, -y]]), 2 * z)


@faces.register
def _(solid: Tube) -> Faces:
    outer, inner = _circle(float(solid.outer_radius_m)), _circle(float(solid.inner_radius_m))
    z = float(solid.length_m) / 2
    rims = [face for end in (-z, z) for face in _sides(_at(inner, end), _at(outer, end))]
    return [*_sides(_at(outer, -z), _at(outer, z)), *_sides(_at(inner, -z), _at(inner, z)), *rims]


@faces.register
def _(solid: Cone) -> Faces:
    z = float(solid.length_m) / 2
    low, high = _at(_circle(float(solid.bottom_radius_m)), -z), _at(_circle(float(solid.top_radius_m)), z)
    return [low, high, *_sides(low, high)]


def _globe(axes: np.ndarray) -> Faces:
    rings = [_at(_circle(np.cos(angle)), np.sin(angle)) for angle in np.linspace(-pi / 2, pi / 2, AROUND // 2)]
    return [face * axes for low, high in pairwise(rings) for face in _sides(low, high)]


@faces.register
def _(solid: Sphere) -> Faces:
    return _globe(np.full(3, float(solid.radius_m)))


@faces.register
def _(solid: Ellipsoid) -> Faces:
    return _globe(np.array(solid.semi_axes_m))


@faces.register
def _(solid: Mesh) -> Faces:
    triangles = np.asarray(solid.surface().triangles)
    return list(triangles[:: 1 + len(triangles) // MOST_FACES])

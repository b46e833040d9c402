"""Solids as convex cells that fill them without overlap: what the cutting of holes needs to know of their insides."""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np

from armwright.description.solids.mesh import Mesh
from armwright.description.solids.shapes import Prism, Tube
from armwright.pictures.surfaces import AROUND, ears, surface
from armwright.spatial import Placement

DIGITS = 9  # to which planes of one flat face are the same [m]


@dataclass(frozen=True, eq=False)
class Cell:
    """A convex piece of a solid: points with  normals @ p <= offsets.

    Attributes:
        normals: (m, 3), outward.   offsets: (m,) [m].   inner: (m,) whether the plane parts the cell from a neighbour.
    """

    normals: np.ndarray
    offsets: np.ndarray
    inner: np.ndarray

    def placed(self, at: Placement) -> Cell:
        """The cell in the frame where its own stands."""
        normals = self.normals @ at.rotation.T
        return Cell(normals, self.offsets + normals @ at.position, self.inner)


@singledispatch
def cells(solid: Any) -> list[Cell]:
    """The cells of a solid in its own frame; by default the one that a convex solid is."""
    return [_hull(surface(solid))]


@cells.register
def _(solid: Mesh) -> list[Cell]:
    return [_hull(solid.surface().convex_hull)]  # as a hole it takes its hull, and of its own inside nothing is known


@cells.register
def _(solid: Prism) -> list[Cell]:
    outline = np.array(solid.outline_m, dtype=float).reshape(-1, 2)
    x, y = outline.T
    if (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() < 0:
        outline = outline[::-1]
    found = []
    for corners in ears(outline):
        after = np.roll(corners, -1)
        inner = (after - corners) % len(outline) != 1
        found.append(_column(outline[corners], inner, float(solid.length_m)))
    return found


@cells.register
def _(solid: Tube) -> list[Cell]:
    outer, bore = float(solid.outer_radius_m), float(solid.inner_radius_m)
    turns = np.linspace(0.0, 2 * pi, AROUND + 1)
    rim = np.column_stack([np.cos(turns), np.sin(turns)])
    sectors = (np.array([bore * a, outer * a, outer * b, bore * b]) for a, b in pairwise(rim))
    inner = np.array([True, False, True, False])
    return [_column(sector, inner, float(solid.length_m)) for sector in sectors]


def _column(corners: np.ndarray, inner: np.ndarray, length: float) -> Cell:
    """A convex polygon (k, 2), counter-clockwise, along z; `inner` of the side from each corner to the next."""
    along = np.roll(corners, -1, axis=0) - corners
    sides = np.column_stack([along[:, 1], -along[:, 0], np.zeros(len(along))])
    sides /= np.maximum(np.linalg.norm(sides, axis=1, keepdims=True), 1e-300)
    normals = np.vstack([sides, [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]])
    offsets = np.concatenate([np.einsum("ki,ki->k", sides[:, :2], corners), [length / 2, length / 2]])
    return Cell(normals, offsets, np.array([*inner, False, False]))


def _hull(mesh: Any) -> Cell:
    """The planes of a convex surface's faces, each once."""
    normals = np.asarray(mesh.face_normals)
    offsets = np.einsum("fi,fi->f", normals, np.asarray(mesh.triangles[:, 0]))
    _, once = np.unique(np.column_stack([normals, offsets]).round(DIGITS), axis=0, return_index=True)
    return Cell(normals[once], offsets[once], np.zeros(len(once), dtype=bool))

"""Holes cut out of solids: what is left of their faces, and the walls of the holes within them.

Every face is a convex polygon and every solid a few convex cells, so that a plane cuts exactly. Faces that lie in one plane
with a face of the hole go with it where they face the same way, and stay where solid and hole only touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armwright.pictures.cells import Cell

THIN = 1e-6  # [m]: what is nearer to a plane lies in it

Face = np.ndarray  # (k, 6): corners [m] of a flat convex polygon, counter-clockwise from outside, each with its normal


@dataclass(frozen=True, eq=False)
class Cuttable:
    """A solid as it is cut.

    Attributes:
        faces: of its surface.   cells: that fill it.
    """

    faces: list[Face]
    cells: list[Cell]

    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner (3,) [m]."""
        points = np.vstack(self.faces)[:, :3]
        return points.min(axis=0), points.max(axis=0)


def without(solid: Cuttable, holes: Sequence[Cuttable]) -> list[Face]:
    """The faces of a solid less its holes."""
    low, high = solid.box()
    holes = [h for h in holes if (low < h.box()[1] - THIN).all() and (h.box()[0] < high - THIN).all()]
    faces = solid.faces
    for hole in holes:
        for cell in hole.cells:
            faces = [piece for face in faces for piece in _outside(face, cell, same=False, opposite=True)]
    walls = []
    for j, hole in enumerate(holes):
        within = [piece for face in hole.faces for cell in solid.cells if (piece := _inside(face, cell)) is not None]
        for k, other in enumerate(holes):
            for cell in other.cells if other is not hole else ():
                within = [piece for face in within for piece in _outside(face, cell, same=j < k, opposite=False)]
        walls += [np.hstack([face[::-1, :3], -face[::-1, 3:]]) for face in within]
    return [*faces, *walls]


def _normal(face: Face) -> np.ndarray:
    """(3,), outward, of the polygon itself, by Newell's sum; not of unit length."""
    points = face[:, :3] - face[0, :3]
    return np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)


def _outside(face: Face, cell: Cell, *, same: bool, opposite: bool) -> list[Face]:
    """Pieces of a face outside a cell. In a plane of the cell it stays if it faces as that (`same`) or not (`opposite`)."""
    s = face[:, :3] @ cell.normals.T - cell.offsets
    flat = (np.abs(s) <= THIN).all(axis=0)
    if ((s >= -THIN).all(axis=0) & ~flat).any():
        return [face]
    for plane in np.flatnonzero(flat & ~cell.inner):
        if same if _normal(face) @ cell.normals[plane] > 0 else opposite:
            return [face]
    pieces: list[Face] = []
    rest: Face | None = face
    for plane in np.flatnonzero((s > THIN).any(axis=0)):
        beyond, rest = _split(rest, cell.normals[plane], cell.offsets[plane])
        pieces += [] if beyond is None else [beyond]
        if rest is None:
            return [face]  # whole, as nothing of it is inside
    return pieces


def _inside(face: Face, cell: Cell) -> Face | None:
    """The piece of a face inside a cell. In a plane between two cells it belongs to the one whose plane faces as it does."""
    s = face[:, :3] @ cell.normals.T - cell.offsets
    if (s >= -THIN).all(axis=0).any():
        flat = (np.abs(s) <= THIN).all(axis=0)
        outer = (s >= -THIN).all(axis=0) & ~(flat & cell.inner)
        if outer.any() or any(_normal(face) @ cell.normals[plane] < 0 for plane in np.flatnonzero(flat)):
            return None
    rest: Face | None = face
    for plane in np.flatnonzero((s > THIN).any(axis=0)):
        _, rest = _split(rest, cell.normals[plane], cell.offsets[plane])
        if rest is None:
            return None
    return rest


def _split(face: Face, normal: np.ndarray, offset: float) -> tuple[Face | None, Face | None]:
    """The pieces of a convex polygon beyond a plane and before it."""
    s = face[:, :3] @ normal - offset
    if (s <= THIN).all():
        return None, face
    if (s >= -THIN).all():
        return face, None
    beyond, before = [], []
    for k in range(len(face)):
        j = (k + 1) % len(face)
        if s[k] >= -THIN:
            beyond.append(face[k])
        if s[k] <= THIN:
            before.append(face[k])
        if abs(s[k]) > THIN and abs(s[j]) > THIN and s[k] * s[j] < 0:
            crossing = face[k] + s[k] / (s[k] - s[j]) * (face[j] - face[k])
            beyond.append(crossing)
            before.append(crossing)
    return np.array(beyond), np.array(before)

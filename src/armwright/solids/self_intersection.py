"""Faces of a mesh that cross each other: every edge is tested against every face near it. [Ericson2004]

Neither trimesh nor manifold3d finds crossings: manifold3d 3.5 accepts two boxes that pass through each other, and a box
twisted through itself, for which it gives half of the volume.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

LEAF = 48  # faces that are tested against each other pair by pair
DEPTH = 40  # halvings; beyond it faces lie on one spot
ROUNDING = 1e-13  # of the mesh's size: a distance below it is touching, not crossing


def crossing_faces(triangles: np.ndarray) -> tuple[int, int] | None:
    """Two faces (by number) of (n, 3, 3) that cross each other, or None.

    Faces may meet at corners and edges, and lie on each other; to cross, an edge of one must go through the inside of
    the other.
    """
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    size = float((high.max(axis=0) - low.min(axis=0)).max())
    for leaf in _leaves(np.arange(len(triangles)), low, high, DEPTH):
        i, j = np.triu_indices(len(leaf), 1)
        i, j = leaf[i], leaf[j]
        near = np.all((low[i] <= high[j]) & (low[j] <= high[i]), axis=1)
        i, j = i[near], j[near]
        hit = _pierces(triangles[i], triangles[j], size) | _pierces(triangles[j], triangles[i], size)
        if hit.any():
            first = int(np.argmax(hit))
            return int(i[first]), int(j[first])
    return None


def _leaves(faces: np.ndarray, low: np.ndarray, high: np.ndarray, depth: int) -> Iterator[np.ndarray]:
    """Small groups of faces, the leaves of a k-d tree: any two faces whose boxes meet share a group."""
    if len(faces) <= LEAF or depth == 0:
        yield faces
        return
    middles = low[faces] + high[faces]
    axis = int(np.argmax(np.ptp(middles, axis=0)))
    plane = float(np.median(middles[:, axis])) / 2
    left, right = faces[low[faces, axis] <= plane], faces[high[faces, axis] >= plane]
    if max(len(left), len(right)) > 0.9 * len(faces):
        yield faces  # nearly all lie across the plane: halving does not separate them
        return
    yield from _leaves(left, low, high, depth - 1)
    yield from _leaves(right, low, high, depth - 1)


def _volume(a: np.ndarray, b: np.ndarray, c: np.ndarray, seen_from: np.ndarray) -> np.ndarray:
    """Six times the signed volume of a tetrahedron; exactly 0 where a corner is seen from itself."""
    return np.einsum("ij,ij->i", a - seen_from, np.cross(b - seen_from, c - seen_from))


def _pierces(edges_of: np.ndarray, faces: np.ndarray, size: float) -> np.ndarray:
    """True for pairs (m, 3, 3) of which the first triangle has an edge through the inside of the second."""
    a, b, c = np.moveaxis(faces, 1, 0)
    span = np.maximum(np.ptp(faces, axis=1), np.ptp(edges_of, axis=1)).max(axis=1)
    least, crosses = ROUNDING * size * span * span, np.zeros(len(faces), dtype=bool)
    for k in range(3):
        p, q = edges_of[:, k], edges_of[:, (k + 1) % 3]
        above, below = _volume(a, b, c, p), _volume(a, b, c, q)
        turns = np.stack([_volume(q, a, b, p), _volume(q, b, c, p), _volume(q, c, a, p)])
        around = np.all(turns >= 0, axis=0) | np.all(turns <= 0, axis=0)  # 0: it hits the face's rim
        crosses |= around & (np.minimum(above, below) < -least) & (np.maximum(above, below) > least)
    return crosses

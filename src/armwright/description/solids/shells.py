"""The closed shells of a surface, and whether they nest as a solid's do: outside, material, cavity, material in the cavity.

The winding number of a surface about a point is its solid angle seen from there over 4π. Of a solid's surface it is 1 in the
material and 0 elsewhere, cavities included (-1 where all faces point inward); a point that counts twice has 2.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

SEEN = 8  # faces of a shell from which the others are looked at


def winding_numbers(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How often a closed surface (n, 3, 3) goes round each of the points (k, 3): (k,). [VanOosterom1983]"""
    angle = np.zeros(len(points))
    for k, point in enumerate(points):
        a, b, c = np.moveaxis(triangles - point, 1, 0)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        over = np.einsum("ij,ij->i", a, np.cross(b, c))
        under = (
            la * lb * lc
            + np.einsum("ij,ij->i", a, b) * lc
            + np.einsum("ij,ij->i", a, c) * lb
            + np.einsum("ij,ij->i", b, c) * la
        )
        angle[k] = 2 * np.arctan2(over, under).sum()
    return angle / (4 * np.pi)


def misplaced_shell(triangles: np.ndarray, adjacency: np.ndarray) -> tuple[np.ndarray, int] | None:
    """A shell that no solid has there: one that counts its inside twice, or takes away where nothing is.

    Args:
        triangles: (n, 3, 3) [m] of a closed surface whose faces do not cross.   adjacency: (m, 2) faces that share an edge.
    Returns:
        place, number: the middle of the shell (3,) [m] and the winding number within it, told for a surface whose largest
            shell points outward; None where all nest as they should.
    """
    from trimesh.graph import connected_component_labels

    labels = connected_component_labels(adjacency, node_count=len(triangles))
    shells = [triangles[labels == k] for k in range(int(labels.max()) + 1)]
    if len(shells) == 1:
        return None
    volumes = [_volume(shell) for shell in shells]
    outward = np.sign(volumes[int(np.argmax(np.abs(volumes)))])
    for k, shell in enumerate(shells):
        around = sum(_about(shell, other) for other in _others_around(shells, k))
        within = int(outward * (around + np.sign(volumes[k])))
        if within not in (0, 1):
            return shell.mean(axis=(0, 1)), within
    return None


def _others_around(shells: list[np.ndarray], k: int) -> Iterator[np.ndarray]:
    """The shells whose boxes hold that of shell k."""
    low, high = shells[k].min(axis=(0, 1)), shells[k].max(axis=(0, 1))
    for j, other in enumerate(shells):
        if j != k and np.all(other.min(axis=(0, 1)) <= low) and np.all(high <= other.max(axis=(0, 1))):
            yield other


def _about(shell: np.ndarray, other: np.ndarray) -> int:
    """The winding number of another shell about this one, from the face that is plainest on one side of it."""
    faces = shell[np.unique(np.linspace(0, len(shell) - 1, SEEN).astype(int))]
    seen = winding_numbers(other, faces.mean(axis=1))  # ±½ where the two touch
    return round(float(seen[int(np.argmax(np.abs(np.abs(seen) - 0.5)))]))


def _volume(triangles: np.ndarray) -> float:
    a, b, c = np.moveaxis(triangles - triangles.mean(axis=(0, 1)), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6

"""Plane polygons: a check that an outline is simple, and its area with first and second moments. [Steger1996]

No library has such a check: triangulators accept outlines that cross themselves and return something, and shapely, which
finds crossings, names a point and not the edges of the file that meet there.
"""

from __future__ import annotations

import numpy as np

MOST_POINTS = 2000  # every edge is compared with every other; for more points use a mesh


def why_not_simple(points: np.ndarray) -> str | None:
    """Reason why a closed outline (n, 2) does not bound one area; None if it does.

    Edges may share their common corner and nothing else: no crossing, no touching, no point twice.
    """
    n = len(points)
    if n < 3:
        return f"expected 3 or more points, not {n}"
    if n > MOST_POINTS:
        return f"expected at most {MOST_POINTS} points, not {n}; a mesh holds more"
    a = points - points.mean(axis=0)
    scale = np.abs(a).max()
    if not 0 < scale < np.inf:
        return "expected points that differ"
    a = a / scale
    b = np.roll(a, -1, axis=0)
    same = np.flatnonzero(np.all(a == b, axis=1))
    if len(same):
        return f"points {same[0] + 1} and {(same[0] + 1) % n + 1} are the same"
    for k in range(n):
        later = np.arange(k + 1, n)
        meets = _meet(a[k], b[k], a[later], b[later])
        neighbours = (later == k + 1) | ((later + 1) % n == k)
        for j in later[meets & ~neighbours]:
            return f"edge {k + 1} meets edge {j + 1}: expected an outline that does not cross or touch itself"
        after = (k + 1) % n
        back, on = a[k] - b[k], b[after] - b[k]
        if _cross(back, on) == 0 and back @ on > 0:
            return f"edge {after + 1} runs back along edge {k + 1}"
    if abs(polygon_moments(points)[2, 2]) == 0:
        return "expected an outline that bounds an area"
    return None


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]


def _meet(p: np.ndarray, q: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """True for those of the segments a…b (m, 2) that have a point in common with p…q."""
    d1, d2 = _cross(b - a, p - a), _cross(b - a, q - a)
    d3, d4 = _cross(q - p, a - p), _cross(q - p, b - p)
    low, high = np.minimum(a, b), np.maximum(a, b)
    boxes = np.all((np.minimum(p, q) <= high) & (low <= np.maximum(p, q)), axis=1)
    return boxes & (d1 * d2 <= 0) & (d3 * d4 <= 0)


def polygon_moments(points: np.ndarray) -> np.ndarray:
    """∫ p pᵀ dA with p = [x, y, 1] over the inside of an outline (n, 2) [m], whichever way it runs: (3, 3).

    Green's theorem, edge by edge, about the outline's mean so that a far origin costs no digits; then moved back.
    """
    middle = points.mean(axis=0)
    (x, y), (u, v) = (points - middle).T, (np.roll(points, -1, axis=0) - middle).T
    c = x * v - u * y
    area = c.sum() / 2
    first_x, first_y = (x + u) @ c / 6, (y + v) @ c / 6
    xx, yy = (x * x + x * u + u * u) @ c / 12, (y * y + y * v + v * v) @ c / 12
    xy = (x * v + 2 * x * y + 2 * u * v + u * y) @ c / 24
    moments = np.array([[xx, xy, first_x], [xy, yy, first_y], [first_x, first_y, area]])
    back = np.array([[1.0, 0.0, middle[0]], [0.0, 1.0, middle[1]], [0.0, 0.0, 1.0]])
    return np.copysign(1.0, area) * (back @ moments @ back.T)

"""Rasterisation of triangles: the visible triangle at every pixel, and the point on it, by a depth buffer in NumPy.

Every triangle is cut into rows of pixels, every row into pixels, and the nearest of all points at a pixel is kept. No library
serves here: trimesh's pictures and pyrender need OpenGL and a display, VTK is a hundred megabytes, and matplotlib sorts whole
triangles by depth, so that long ones hide those before them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NOTHING = -1  # the triangle at a pixel where there is none
AT_ONCE = 4_000_000  # points drawn at a time, at most


@dataclass(frozen=True, eq=False)
class Seen:
    """Visible triangle of every pixel.

    Attributes:
        triangle: (height, width) index, NOTHING for none.   nearness: (height, width), larger is nearer; -inf for nothing.
        weights: (height, width, 3) of the triangle's corners on the screen.
    """

    triangle: np.ndarray
    nearness: np.ndarray
    weights: np.ndarray


def raster(corners: np.ndarray, width: int, height: int) -> Seen:
    """Draws triangles.

    Args:
        corners: (t, 3, 3): x to the right and y down in pixels, nearness that is linear on the screen.
        width, height: of the screen in pixels.
    """
    nearness = np.full(width * height, -np.inf)
    triangle = np.full(width * height, NOTHING)
    doubled = _doubled_area(corners)
    names = np.flatnonzero((np.abs(doubled) > 1e-12) & np.isfinite(corners).all(axis=(1, 2)))
    names, y = _counted(names, *_centres(corners[names, :, 1].min(axis=1), corners[names, :, 1].max(axis=1), height))
    left, right, near_0, slope = _row(corners[names], doubled[names], y + 0.5)
    first, last = _centres(left, right, width)
    count = np.cumsum(np.maximum(last - first, 0))
    parts = np.searchsorted(count, np.arange(AT_ONCE, count[-1] if len(count) else 0, AT_ONCE))
    for rows in np.split(np.arange(len(names)), parts):
        rows, x = _counted(rows, first[rows], last[rows])
        near = near_0[rows] + slope[rows] * (x + 0.5)
        pixel = y[rows] * width + x
        np.maximum.at(nearness, pixel, near)
        won = near == nearness[pixel]
        triangle[pixel[won]] = names[rows[won]]
    weights = np.zeros((width * height, 3))
    lit = np.flatnonzero(triangle != NOTHING)
    y, x = np.divmod(lit, width)
    weights[lit] = _weights(corners[triangle[lit]], doubled[triangle[lit]], x + 0.5, y + 0.5)
    shape = (height, width)
    return Seen(triangle.reshape(shape), nearness.reshape(shape), weights.reshape(*shape, 3))


def _centres(low: np.ndarray, high: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """First pixel, and the one after the last, whose centres lie between two numbers."""
    first, last = (np.ceil(np.clip(edge, 0, count) - 0.5).astype(int) for edge in (low, high))
    return first, np.minimum(last, count)


def _counted(names: np.ndarray, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every name with each whole number from its first to before its last."""
    count = np.maximum(last - first, 0)
    begin = np.repeat(np.cumsum(count) - count, count)
    return np.repeat(names, count), np.repeat(first, count) + np.arange(count.sum()) - begin


def _row(corners: np.ndarray, doubled: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
    """Left and right end of triangles at a height, and their nearness at x = 0 with its slope.

    A point is inside where all three weights, which are linear in x, are positive.
    """
    at_zero = _weights(corners, doubled, np.zeros_like(y), y)
    p, q = np.roll(corners, -1, axis=1)[..., 1], np.roll(corners, -2, axis=1)[..., 1]
    slope = (p - q) / doubled[:, None]
    flat = slope == 0
    ends = -at_zero / np.where(flat, 1.0, slope)
    left = np.where(slope > 0, ends, np.where(flat & (at_zero < 0), np.inf, -np.inf)).max(axis=1)
    right = np.where(slope < 0, ends, np.inf).min(axis=1)
    near = corners[..., 2]
    return left, right, (at_zero * near).sum(axis=1), (slope * near).sum(axis=1)


def _doubled_area(corners: np.ndarray) -> np.ndarray:
    a, b, c = (corners[..., k, :2] for k in range(3))
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])


def _weights(corners: np.ndarray, doubled: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Barycentric coordinates (…, 3) of points in triangles."""
    a, b, c = (corners[..., k, :2] for k in range(3))

    def side(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        return (q[..., 0] - p[..., 0]) * (y - p[..., 1]) - (q[..., 1] - p[..., 1]) * (x - p[..., 0])

    return np.stack([side(b, c), side(c, a), side(a, b)], axis=-1) / doubled[..., None]

"""The depth buffer, against a pixel at a time."""

from __future__ import annotations

import numpy as np

from armwright.pictures.raster import NOTHING, raster

WIDTH, HEIGHT = 37, 29


def slowly(corners: np.ndarray) -> np.ndarray:
    """Number of the nearest triangle at each pixel, by trying all."""
    seen = np.full((HEIGHT, WIDTH), NOTHING)
    for y in range(HEIGHT):
        for x in range(WIDTH):
            nearest = -np.inf
            for k, triangle in enumerate(corners):
                system = np.vstack([triangle[:, :2].T, np.ones(3)])
                weights = np.linalg.solve(system, [x + 0.5, y + 0.5, 1.0])
                near = float(weights @ triangle[:, 2])
                if (weights >= 0).all() and near > nearest:
                    nearest, seen[y, x] = near, k
    return seen


def test_what_is_seen_is_nearest():
    """Random triangles, some beyond the screen."""
    corners = np.random.default_rng(4).uniform((-10, -10, 0), (WIDTH + 10, HEIGHT + 10, 1), (25, 3, 3))
    seen = raster(corners, WIDTH, HEIGHT)
    np.testing.assert_array_equal(seen.triangle, slowly(corners))
    lit = seen.triangle != NOTHING
    chosen = corners[seen.triangle[lit]]
    y, x = np.nonzero(lit)
    np.testing.assert_allclose(seen.weights[lit].sum(axis=1), 1.0)
    place = np.einsum("kc,kci->ki", seen.weights[lit], chosen)
    np.testing.assert_allclose(place, np.column_stack([x + 0.5, y + 0.5, seen.nearness[lit]]), atol=1e-6)


def test_nothing_to_see():
    for corners in (np.zeros((0, 3, 3)), np.zeros((2, 3, 3)), np.full((1, 3, 3), np.nan)):
        seen = raster(corners, WIDTH, HEIGHT)
        assert (seen.triangle == NOTHING).all()
        assert (seen.nearness == -np.inf).all()


def test_neighbours_leave_no_gap():
    """A square of two triangles covers every pixel inside."""
    square = np.array([[3.5, 3.5, 1], [30.5, 3.5, 1], [30.5, 20.5, 1], [3.5, 20.5, 1]], dtype=float)
    seen = raster(square[[[0, 1, 2], [0, 2, 3]]], WIDTH, HEIGHT)
    assert (seen.triangle[4:20, 4:30] != NOTHING).all()
    assert (seen.triangle != NOTHING).sum() <= 18 * 28

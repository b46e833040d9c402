"""Passes over sets of x: closed forms, and sets with holes against a search of all ways on a fine lattice."""

import numpy as np
import pytest

from armwright.trajectory.cartesian.speed_sets import SpeedTable, fastest_profile

S = np.linspace(0.0, 1.0, 41)
LEVELS = np.linspace(0.0, 4.0, 161)


def table(low, high, levels=LEVELS, s=S) -> SpeedTable:
    """Bounds of s̈ as functions of (s, x)."""
    x, grid = np.broadcast_to(levels, (len(s), len(levels))), s[:, None]
    return SpeedTable(x, *(np.broadcast_to(bound(grid, x), x.shape).astype(float) for bound in (low, high)), np.diff(s))


def test_constant_bounds_give_a_triangle() -> None:
    x = fastest_profile(table(lambda s, x: -3.0 + 0 * x, lambda s, x: 2.0 + 0 * x))
    np.testing.assert_allclose(x, np.minimum(4.0 * S, 6.0 * (1.0 - S)), atol=0.02)  # the corner is off the grid
    far = np.abs(S - 0.6) > 0.05
    np.testing.assert_allclose(x[far], np.minimum(4.0 * S, 6.0 * (1.0 - S))[far], atol=1e-9)


def test_linear_damping_gives_the_solution_of_its_equation() -> None:
    fine = np.linspace(0.0, 1.0, 2001)  # s̈ = 1 - x, so dx/ds = 2 (1 - x)
    x = fastest_profile(table(lambda s, x: -1e3 + 0 * x, lambda s, x: 1.0 - x, s=fine))
    inner = fine < 0.99
    np.testing.assert_allclose(x[inner], (1.0 - np.exp(-2.0 * fine))[inner], atol=2e-3)


def holes(s, x, bottom: float, top: float, beginning: float, end: float):
    """Less room the deeper x is within a hole: negative there, linear about its rim."""
    depth = np.minimum(np.minimum(x - bottom, top - x), 4.0 * np.minimum(s - beginning, end - s))
    return np.clip(-40.0 * depth, -4.0, 2.0)


@pytest.mark.parametrize(
    ("bottom", "top", "over"), [(0.5, 1.5, True), (1.0, 3.4, False), (0.8, 1.2, True), (2.0, 2.4, False)]
)
def test_a_hole_is_passed_above_where_that_can_be_reached_and_below_where_not(bottom, top, over) -> None:
    def room(s, x):
        return holes(s, x, bottom, top, 0.4, 0.6)

    bounds = table(lambda s, x: -room(s, x) - 0.2, lambda s, x: room(s, x) + 0.2)
    x = fastest_profile(bounds)
    assert (x[1:-1] > 0.0).all()
    middle = x[len(S) // 2]
    assert (middle > top - 0.05) if over else (middle < bottom + 0.05)
    best = _best_on_lattice(bounds)
    assert x.mean() >= best.mean() - 0.02
    assert np.abs(x - best).max() < 0.25


def _best_on_lattice(bounds: SpeedTable) -> np.ndarray:
    """Largest x at each grid point over all ways between levels that keep the bounds at both ends: sets go forward and back."""
    x, m = bounds.x[0], len(bounds.x)
    ways = []
    for k in range(m - 1):
        sdd = (x[None] - x[:, None]) / (2.0 * bounds.ds[k])
        from_here = (bounds.low[k][:, None] <= sdd) & (sdd <= bounds.high[k][:, None])
        ways.append(from_here & (bounds.low[k + 1] <= sdd) & (sdd <= bounds.high[k + 1]))
    start, end = (x == 0.0), [x == 0.0]
    for way in reversed(ways):
        end.insert(0, (way & end[0]).any(axis=1))
    best = np.zeros(m)
    for k in range(m - 1):
        start = (ways[k] & start[:, None]).any(axis=0) & end[k + 1]
        best[k + 1] = x[start].max()
    return best


def test_a_profile_that_cannot_leave_stays_at_rest() -> None:
    wall = table(lambda s, x: -1.0 + 0 * x, lambda s, x: np.where(np.abs(s - 0.5) < 0.1, -30.0 * x, 1.0))
    x = fastest_profile(wall)
    assert 0.3 < S[np.flatnonzero(x > 1e-9)[-1]] < 0.6
    assert not x[S > 0.6].any()

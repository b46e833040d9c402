"""Path speeds that friction forbids between lower and higher ones: limits are kept, and no way over them is faster."""

import numpy as np
import pytest

import armwright as aw
from armwright.trajectory.time_optimal.plan import grid_points
from armwright.trajectory.time_optimal.planner import Planner
from trajectory.path_problems import largest_use, random_problem

BEYOND = 4.0  # times the largest x of a plan: how far all others look
COARSE = 60  # grid points of dynamic programming


def forbidden(planner: Planner, x: np.ndarray) -> np.ndarray:
    """(m,) True at grid points that allow no s̈ at some of the x (j,), increasing, but some at lower and at higher ones."""
    low, high = planner.points.bounds(np.tile(x, (len(planner.s), 1)), planner.shares)
    allowed = low <= high
    above = np.flip(np.maximum.accumulate(np.flip(allowed, 1), axis=1), 1)
    return (np.maximum.accumulate(allowed, axis=1) & ~allowed & above).any(axis=1)


def by_dynamic_programming(planner: Planner, x: np.ndarray) -> float:
    """Duration [s] of the fastest motion from rest to rest over levels x (j,), increasing from 0, at the grid points:
    of all ways, whatever speeds are forbidden between them."""
    points, shares, v = planner.points, planner.shares, np.sqrt(x)
    low, high = points.bounds(np.tile(x, (len(planner.s), 1)), shares)
    slow = x <= points.largest_x(shares)[:, None]
    rest = np.where(x > 0.0, np.inf, 0.0)
    for k in range(len(planner.s) - 2, -1, -1):
        step = 2.0 * (planner.s[k + 1] - planner.s[k])
        u = (x - x[:, None]) / step
        kept = (u >= low[k][:, None]) & (u <= high[k][:, None]) & (u >= low[k + 1]) & (u <= high[k + 1])
        with np.errstate(divide="ignore"):
            times = np.where(kept & slow[k][:, None] & slow[k + 1], step / (v + v[:, None]), np.inf)
        rest = (times + rest).min(axis=1)
    return float(rest[0])


@pytest.mark.parametrize("seed", [8, 104, 232, 328])
@pytest.mark.sample(1)
def test_a_plan_keeps_its_limits_and_no_way_over_forbidden_speeds_is_faster(seed: int) -> None:
    arm, path, limits = random_problem(seed)
    motion = aw.trajectories.time_optimal(arm, path, limits, grid=300)
    assert largest_use(arm, motion, limits) <= 1.0 + 1e-6
    planner = Planner(aw.compile(arm), limits, path, grid_points(path, COARSE), (0.0, 0.0))
    x = BEYOND * motion.x.max() * np.linspace(0.0, 1.0, 700) ** 2
    assert forbidden(planner, x).any()
    assert motion.duration < 1.01 * by_dynamic_programming(planner, x)

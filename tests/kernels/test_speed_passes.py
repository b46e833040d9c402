"""Passes of two-variable linear programs: SciPy's linear programs cell by cell, and closed forms."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from armwright.kernels.speed_passes import CellLines, controllable, greedy

FAR = 1e6  # of u, for SciPy


def random_lines(seed: int, cells: int = 40, rows: int = 7) -> CellLines:
    """Lines that leave room about u = 0 at small x, some of them steep."""
    draw = np.random.default_rng(seed)
    size = 10.0 ** draw.uniform(-2.0, 4.0, (4, cells, rows)) * draw.choice([1.0, -1.0], (4, cells, rows))
    return CellLines(
        np.abs(size[0]), size[1], np.abs(size[2]), size[3], draw.uniform(0.2, 2.0, cells + 1), draw.uniform(0.1, 1.0, cells)
    )  # fmt: skip


def by_linprog(lines: CellLines, k: int, target: tuple[Any, Any], objective: tuple[float, float]) -> np.ndarray | None:
    """(x, u) of a cell with the least objective, by SciPy."""
    ones, step = np.ones(lines.upper.shape[1]), 2.0 * lines.steps[k]
    rows = np.concatenate(
        [
            np.stack([-lines.upper_slope[k], ones], 1),
            np.stack([-lines.lower_slope[k], -ones], 1),
            [[1.0, step], [-1.0, -step]],
        ]
    )
    most = np.concatenate([lines.upper[k], lines.lower[k], [target[1], -target[0]]])
    scale = np.abs(rows).max(axis=1)
    found = linprog(objective, rows / scale[:, None], most / scale, bounds=[(0.0, lines.cap[k]), (-FAR, FAR)])
    return found.x if found.status == 0 else None


@pytest.mark.parametrize("seed", range(6))
def test_controllable_sets_and_the_greedy_way_are_those_of_linear_programs(seed: int) -> None:
    lines = random_lines(seed)
    last = 0.1 * lines.cap[-1]
    low, high = controllable(lines, last)
    reached = np.flatnonzero(high >= 0.0)[0]
    for k in range(reached, len(lines.steps)):
        for sign, expected in ((-1.0, high[k]), (1.0, low[k])):
            found = by_linprog(lines, k, (low[k + 1], high[k + 1]), (sign, 0.0))
            assert found is not None
            assert expected == pytest.approx(found[0], rel=1e-6, abs=1e-7)
    if reached > 0:
        assert by_linprog(lines, reached - 1, (low[reached], high[reached]), (1.0, 0.0)) is None
        return
    x = greedy(lines, low, high, low[0])
    for k, step in enumerate(lines.steps):
        allowed = lines.upper[k] + lines.upper_slope[k] * x[k]
        assert x[k + 1] == pytest.approx(min(high[k + 1], x[k] + 2.0 * step * allowed.min()), rel=1e-9, abs=1e-9)
    assert x[-1] == pytest.approx(last)


def test_constant_limits_give_a_triangle_under_a_ceiling() -> None:
    s = np.linspace(0.0, 1.0, 101)
    ones = np.ones((100, 1))
    lines = CellLines(2.0 * ones, 0.0 * ones, 3.0 * ones, 0.0 * ones, np.full(101, 1.7), np.diff(s))
    low, high = controllable(lines, 0.0)
    np.testing.assert_allclose(high, np.minimum(6.0 * (1.0 - s), 1.7), atol=1e-12)
    np.testing.assert_array_equal(low, 0.0)
    x = greedy(lines, low, high, 0.0)
    expected = np.minimum(np.minimum(4.0 * s, 6.0 * (1.0 - s)), 1.7)
    corner = np.abs(s - 0.425) < 0.006
    np.testing.assert_allclose(x[~corner], expected[~corner], atol=1e-12)


def test_an_end_that_is_too_fast_has_no_set() -> None:
    ones = np.ones((5, 1))
    lines = CellLines(ones, 0.0 * ones, ones, 0.0 * ones, np.full(6, 9.0), np.full(5, 0.1))
    assert controllable(lines, 10.0)[1].max() == -1.0
    low, high = controllable(lines, 4.0)
    np.testing.assert_allclose(low, 4.0 - 0.2 * np.arange(5, -1, -1))
    np.testing.assert_allclose(high, 4.0 + 0.2 * np.arange(5, -1, -1))

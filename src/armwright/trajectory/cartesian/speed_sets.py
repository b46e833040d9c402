"""Fastest profile of squared path speeds x(s), by a backward and a forward pass over sets of x.

Between grid points s̈ is constant, so x is linear: y = x + 2 Δs s̈. A step from x to y is allowed if its s̈ is within the bounds of
both ends. The backward pass finds at every grid point the set of x from which the end is reached; the forward pass takes the
largest reachable x in these sets [PhamPham2018]. Bounds are any functions of x, tabulated at levels and linear between them, so
the sets may have holes: each is a union of intervals, one a cell between two levels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ROUNDING = 1e-12  # of the largest x
NOWHERE = 1e200  # bounds of an empty interval: (NOWHERE, -NOWHERE), finite so that they can be subtracted


@dataclass(frozen=True, eq=False)
class SpeedTable:
    """Bounds of s̈ over levels of x.

    Attributes:
        x: (m, j) levels at each grid point, increasing.   low, high: (m, j) bounds of s̈ there.
        ds: (m - 1,) distances of grid points.
    """

    x: np.ndarray
    low: np.ndarray
    high: np.ndarray
    ds: np.ndarray


def fastest_profile(table: SpeedTable) -> np.ndarray:
    """(m,) the largest x at every grid point that leads from rest to rest; 0 behind a point from which no way leads on."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        lines = _lines(table)
        return _forward(table, lines, *_controllable(table, lines))


def _lines(table: SpeedTable) -> tuple[np.ndarray, np.ndarray]:
    """Offset and factor (m - 1, 4, j - 1) of lines in x, by cell of the later grid point: two bound y above, two bound -y.

    Within a cell the bounds of s̈ are linear in y:  x ≥ y - 2 Δs high(y)  and  x ≤ y - 2 Δs low(y), here solved for y.
    """
    y, ds = table.x[1:], 2.0 * table.ds[:, None]
    lines = []
    for curve, sign in ((y - ds * table.high[1:], 1.0), (y - ds * table.low[1:], -1.0)):
        rise = np.diff(curve, axis=1)
        factor = np.diff(y, axis=1) / np.where(rise == 0.0, 1.0 / NOWHERE, rise)
        offset = y[:, :-1] - curve[:, :-1] * factor
        above = sign * rise >= 0.0
        lines.append(((above, offset, factor), (~above, -offset, -factor)))
    order = [side[k] for k in (0, 1) for side in lines]
    offsets = np.stack([np.where(used, offset, NOWHERE) for used, offset, _ in order], axis=1)
    return offsets, np.stack([np.where(used, factor, 0.0) for used, _, factor in order], axis=1)


def _controllable(table: SpeedTable, lines: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Sets of x from which the end is reached: lowest and highest x (m, j - 1) in every cell."""
    m, j = table.x.shape
    low, high = np.full((m, j - 1), NOWHERE), np.full((m, j - 1), -NOWHERE)
    cell = min(max(int(np.searchsorted(table.x[-1], 0.0, side="right")) - 1, 0), j - 2)
    low[-1, cell] = high[-1, cell] = 0.0
    ds = 2.0 * table.ds[:, None]
    lowest, highest = table.x[:-1] + ds * table.low[:-1], table.x[:-1] + ds * table.high[:-1]
    for k in range(m - 2, -1, -1):
        levels, cells = table.x[k], np.flatnonzero(low[k + 1] <= high[k + 1])
        if not len(cells):
            break
        cells = slice(cells[0], cells[-1] + 1)
        target = low[k + 1, cells], high[k + 1, cells]
        steps = lines[0][k, :, None, cells] + lines[1][k, :, None, cells] * levels[:, None]
        upper = np.minimum(np.minimum(steps[0], steps[1]), highest[k, :, None])
        lower = np.minimum(np.minimum(steps[2], steps[3]), -lowest[k, :, None])
        room = np.minimum(np.minimum(upper - target[0], target[1] + lower), upper + lower)
        inside = room.max(axis=1) >= 0.0
        low[k, inside[:-1]] = levels[:-1][inside[:-1]]
        high[k, inside[1:]] = levels[1:][inside[1:]]
        for cell in (inside[:-1] != inside[1:]).nonzero()[0]:
            both = [cell, cell + 1] if inside[cell] else [cell + 1, cell]
            share = _last_inside(steps[:, both], lowest[k, both], highest[k, both], target)
            edge = levels[both[0]] + share * (levels[both[1]] - levels[both[0]])
            (high if inside[cell] else low)[k, cell] = edge
    return low, high


def _last_inside(
    steps: np.ndarray, lowest: np.ndarray, highest: np.ndarray, target: tuple[np.ndarray, np.ndarray]
) -> float:
    """Share of the way from a level inside a set to its neighbour outside, up to which x is inside.

    By cell of y each condition is linear in x, so that its end is exact: a chord of all of them over the cell would lose some
    of the set at every step.

    Args:
        steps: (4, 2, c) the lines at both levels.   lowest, highest: (2,).   target: lowest and highest y (c,) of the set to
            reach, by cell.
    """
    cells = steps.shape[2]
    upper, lower = np.empty((2, 3, cells)), np.empty((2, 3, cells))
    upper[:, 0], upper[:, 1], upper[:, 2] = steps[0], steps[1], highest[:, None]
    lower[:, 0], lower[:, 1], lower[:, 2] = steps[2], steps[3], -lowest[:, None]
    room = np.concatenate(
        [(upper[:, :, None] + lower[:, None]).reshape(2, 9, cells), upper - target[0], target[1] + lower], axis=1
    )
    fall = room[0] - room[1]
    ends = room[0] / np.where(fall == 0.0, 1.0, fall)
    last = np.where(fall > 0.0, ends, 1.0).min(axis=0)
    first = np.where(fall < 0.0, ends, np.where((fall == 0.0) & (room[0] < 0.0), np.inf, 0.0)).max(axis=0)
    return float(np.clip(np.where(first <= last, last, 0.0).max(), 0.0, 1.0))


def _forward(table: SpeedTable, lines: tuple[np.ndarray, np.ndarray], low: np.ndarray, high: np.ndarray) -> np.ndarray:
    m = len(table.x)
    x = np.zeros(m)
    tolerance, bounds = ROUNDING * table.x.max(), (table.low, table.high)
    for k in range(m - 1):
        here, ds, levels = x[k], 2.0 * table.ds[k], table.x[k]
        cell = min(max(int(levels.searchsorted(here)) - 1, 0), levels.size - 2)
        part = min(max((here - levels[cell]) / (levels[cell + 1] - levels[cell]), 0.0), 1.0)
        lowest, highest = (here + ds * ((1.0 - part) * each[k, cell] + part * each[k, cell + 1]) for each in bounds)
        a, b, c, d = lines[0][k] + lines[1][k] * here
        upper, lower = np.minimum(np.minimum(a, b), highest), np.minimum(np.minimum(c, d), -lowest)
        above, below = np.minimum(upper, high[k + 1]), np.maximum(-lower, low[k + 1])
        room = above - below
        reached = above[room >= -tolerance]
        if len(reached):
            x[k + 1] = reached.max()
        else:  # an error of interpolation, which the check on a denser grid sees
            cell = int(room.argmax())
            x[k + 1] = min(max(0.5 * (above[cell] + below[cell]), low[k + 1, cell]), high[k + 1, cell])
        if max(x[k], x[k + 1]) <= tolerance or x[k + 1] < -tolerance:  # at rest, or no set to go on to
            break
        x[k + 1] = max(x[k + 1], 0.0)
    return x

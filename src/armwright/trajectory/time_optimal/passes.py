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
PARTS, DIVISIONS = np.linspace(0.0, 1.0, 17), 2  # of a cell in which a set ends
NOWHERE = 1e200  # bounds of an empty interval: (NOWHERE, -NOWHERE), finite so that they can be subtracted


@dataclass(frozen=True, eq=False)
class Table:
    """Bounds of s̈ over levels of x.

    Attributes:
        x: (m, j) levels at each grid point, increasing.   low, high: (m, j) bounds of s̈ there.
        ds: (m - 1,) distances of grid points.
    """

    x: np.ndarray
    low: np.ndarray
    high: np.ndarray
    ds: np.ndarray


@dataclass(frozen=True, eq=False)
class Profile:
    """Squared path speeds.

    Attributes:
        x: (m,).   highest_first: the largest x at the first grid point from which the end is reached.
        stuck: grid point from which the forward pass found no way on; None: it reached the end.
    """

    x: np.ndarray
    highest_first: float
    stuck: int | None = None


def fastest_profile(table: Table, first: float, last: float) -> Profile:
    """The largest x at every grid point that leads from x = first to x = last.

    Args:
        table: bounds at the grid points.   first, last: x at both ends.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        lines = _lines(table)
        return _forward(table, lines, *_controllable(table, lines, last), first)


def _lines(table: Table) -> tuple[np.ndarray, np.ndarray]:
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


def _reached(offset: np.ndarray, factor: np.ndarray, x, lowest, highest) -> tuple[np.ndarray, np.ndarray]:
    """Highest y and highest -y by cell that x leads to, as the lines and the bounds of x's own s̈ say."""
    a, b, c, d = offset + factor * x
    return np.minimum(np.minimum(a, b), highest), np.minimum(np.minimum(c, d), -lowest)


def _controllable(table: Table, lines: tuple[np.ndarray, np.ndarray], last: float) -> tuple[np.ndarray, np.ndarray]:
    """Sets of x from which the end is reached: lowest and highest x (m, j - 1) in every cell."""
    m, j = table.x.shape
    low, high = np.full((m, j - 1), NOWHERE), np.full((m, j - 1), -NOWHERE)
    cell = min(max(int(np.searchsorted(table.x[-1], last, side="right")) - 1, 0), j - 2)
    low[-1, cell] = high[-1, cell] = last
    ds = 2.0 * table.ds[:, None]
    lowest, highest = table.x[:-1] + ds * table.low[:-1], table.x[:-1] + ds * table.high[:-1]
    offsets, factors = (each[:, :, None] for each in lines)
    for k in range(m - 2, -1, -1):
        levels, target = table.x[k], (low[k + 1], high[k + 1])

        def room(x, least, most, k=k, target=target):
            upper, lower = _reached(offsets[k], factors[k], x[:, None], least[:, None], most[:, None])
            return np.minimum(np.minimum(upper + lower, upper - target[0]), target[1] + lower).max(axis=1)

        inside = room(levels, lowest[k], highest[k]) >= 0.0
        low[k] = np.where(inside[:-1], levels[:-1], NOWHERE)
        high[k] = np.where(inside[1:], levels[1:], -NOWHERE)
        for cell in np.flatnonzero(inside[:-1] != inside[1:]):
            first, then = (cell, cell + 1) if inside[cell] else (cell + 1, cell)
            ends = np.array([each[[first, then]] for each in (levels, lowest[k], highest[k])])
            edge = _edge(room, ends)
            (high if inside[cell] else low)[k, cell] = edge
    return low, high


def _edge(room, ends: np.ndarray) -> float:
    """x where `room` turns negative between a level inside a set and one outside; ends (3, 2): x, lowest and highest y of both.

    By division of the cell: `room` has kinks, so that a chord over the whole cell would lose some of the set at every step.
    """
    share = 0.0
    for _ in range(DIVISIONS):
        points = ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * PARTS
        rooms = room(*points)
        outside = rooms < 0.0
        i = max(int(outside.argmax()), 1) if outside.any() else len(PARTS) - 1
        ends = points[:, i - 1 : i + 1]
        share = min(max(rooms[i - 1] / max(rooms[i - 1] - rooms[i], 1.0 / NOWHERE), 0.0), 1.0)
    return float(ends[0, 0] + share * (ends[0, 1] - ends[0, 0]))


def _forward(
    table: Table, lines: tuple[np.ndarray, np.ndarray], low: np.ndarray, high: np.ndarray, first: float
) -> Profile:
    m = len(table.x)
    x = np.zeros(m)
    x[0], most = first, float(high[0].max())
    tolerance = ROUNDING * table.x.max()
    for k in range(m - 1):
        here, ds = x[k], 2.0 * table.ds[k]
        lowest, highest = (here + ds * np.interp(here, table.x[k], each) for each in (table.low[k], table.high[k]))
        upper, lower = _reached(lines[0][k], lines[1][k], here, lowest, highest)
        above, below = np.minimum(upper, high[k + 1]), np.maximum(-lower, low[k + 1])
        room = above - below
        reached = above[room >= -tolerance]
        if len(reached):
            x[k + 1] = reached.max()
        else:  # an error of interpolation, which the check on a denser grid sees
            cell = int(room.argmax())
            x[k + 1] = min(max(0.5 * (above[cell] + below[cell]), low[k + 1, cell]), high[k + 1, cell])
        if max(x[k], x[k + 1]) <= tolerance or x[k + 1] < -tolerance:  # at rest, or no set to go on to
            return Profile(x, most, stuck=k)
        x[k + 1] = max(x[k + 1], 0.0)
    return Profile(x, most)

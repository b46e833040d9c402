"""Limits of velocity and acceleration over whole cells of a path's grid, kept between grid points as well.

In a cell of length Δ the path acceleration u is constant, so that x = ṡ² goes evenly from x to x + 2 Δ u. On a cubic spline q' is
quadratic there and q'' linear, so q̈ = q' u + q'' x is quadratic in s and q̇² = q'² x of degree five. A polynomial stays within its
Bernstein coefficients, which are linear in (x, u): they are what the limits hold for. [PhamPham2018], [FaroukiRajan1987]
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armwright.kernels.speed_passes import CellLines, controllable, greedy
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.path import JointPath
from armwright.trajectory.time_optimal.feasibility import too_fast

FLAT = 1e-13  # of a joint's largest slope: below it the joint bounds x, not u
UNBOUNDED = 1e100  # finite, so that it can be multiplied by 0
PIECES = 48  # of the path between two of its breaks, at least: within 0.1 % of what 100 allow
BLOCK, BESIDE = 2048, 2  # cells computed at once; on either side of a cell, that its caps depend on
HALVINGS = 60  # of a path speed at the end that is too high
# of a joint's largest q' beside a grid point: what is taken for q' there where it is less, as for a cap of x
TURNING = 0.5


@dataclass(frozen=True, eq=False)
class WholeCells:
    """A path over a grid, cell by cell, with limits of velocity and acceleration.

    Attributes:
        s: (m,) grid, with the path's breaks.   slopes: (3, m - 1, n) Bernstein coefficients of q' in every cell.
        bends: (2, m - 1, n) q'' at both ends.   limits: of the joints.
    """

    s: np.ndarray
    slopes: np.ndarray
    bends: np.ndarray
    limits: MotionLimits

    @classmethod
    def of(cls, path: JointPath, limits: MotionLimits, grid: int) -> WholeCells:
        """Cells of a path: `grid` of them, about, and some between any two breaks."""
        ways = np.diff(path.breaks)
        pieces = np.maximum(np.ceil(ways * grid / path.length).astype(int), PIECES)
        numbers = np.concatenate([[0], np.cumsum(pieces)])
        s = np.interp(np.arange(numbers[-1] + 1), numbers, path.breaks)
        step = np.repeat(ways / pieces, pieces)[:, None]
        first, third = path.at(s)[1], path.derivative(s[:-1], 3)
        begin = path.derivative(s[:-1], 2)
        slopes = np.stack([first[:-1], first[:-1] + 0.5 * step * begin, first[1:]])
        return cls(s, slopes, np.stack([begin, begin + step * third]), limits)

    @cached_property
    def steps(self) -> np.ndarray:
        """(m - 1,) Δ of the cells."""
        return np.diff(self.s)

    def fastest(self, ends: tuple[float, float]) -> np.ndarray:
        """(m,) the largest ṡ² at every grid point that leads from one end to the other.

        Args:
            ends: ṡ² there.
        Raises:
            ScenarioError: a path speed at one end is too high, with the highest.
        """
        lines = self.lines()
        low, high = controllable(lines, ends[1])
        if 0.0 <= high[0] < ends[0]:
            raise too_fast(ends, 0, float(high[0]))
        if not low[0] <= ends[0] <= high[0]:
            below, above = 0.0, ends[1]
            for _ in range(HALVINGS):
                middle = 0.5 * (below + above)
                low, high = controllable(lines, middle)
                below, above = (middle, above) if low[0] <= ends[0] <= high[0] else (below, middle)
            raise too_fast(ends, 1, below)
        return greedy(lines, low, high, ends[0])

    def lines(self) -> CellLines:
        """Intersection of all limits in every cell."""
        limited = np.isfinite(self.limits.acceleration)
        most = np.tile(self.limits.acceleration[limited], 3)
        flat = np.tile(np.maximum(FLAT * np.abs(self.slopes[0]).max(axis=0)[limited], 1.0 / UNBOUNDED), 3)
        offset, slope, cap = np.empty((len(self.steps), len(most))), np.empty((len(self.steps), len(most))), []
        for first, last in self._blocks():
            part, k = self._part(first, last), slice(first, last)
            step, (d0, d1, d2), (e0, e1) = part.steps[:, None], part.slopes[..., limited], part.bends[..., limited]
            # the coefficients of q̈ are  a u + b x,  with x at the cell's beginning
            a = np.concatenate([d0, d1 + step * e0, d2 + 2.0 * step * e1], axis=1)
            b = np.concatenate([e0, 0.5 * (e0 + e1), e1], axis=1)
            a = np.where(np.abs(a) > flat, a, flat)
            offset[k], slope[k] = most / np.abs(a), -b / a
            before = min(first, BESIDE)
            cap.append(self._part(first - before, last + BESIDE).cap()[before : before + last - first])
        cap.append(self._part(max(len(self.steps) - BESIDE, 0), len(self.steps)).cap()[-1:])
        return CellLines(offset, slope, offset, slope, np.concatenate(cap), self.steps, mirrored=True)

    def _blocks(self) -> list[tuple[int, int]]:
        """First and last cells, the last excluded, of blocks that stay in the processor's cache."""
        return [(k, min(k + BLOCK, len(self.steps))) for k in range(0, len(self.steps), BLOCK)]

    def _part(self, first: int, last: int) -> WholeCells:
        """Some of the cells."""
        return WholeCells(self.s[first : last + 1], self.slopes[:, first:last], self.bends[:, first:last], self.limits)

    def cap(self) -> np.ndarray:
        """(m,) x at the grid points up to which no joint exceeds its velocity limit between them either.

        Under the caps (v / q')² at the grid points an even x between two of them may exceed the limit a little: by a factor,
        which is taken off both.
        """
        limited = np.isfinite(self.limits.velocity)
        cap = np.full(len(self.s), UNBOUNDED)
        if not limited.any():
            return cap
        most, slopes = self.limits.velocity[limited], np.abs(self.slopes[..., limited])
        largest = slopes.max(axis=0)
        here = np.concatenate([slopes[0], slopes[2, -1:]])
        here = np.maximum(here, TURNING * _larger_of_neighbours(largest))
        with np.errstate(divide="ignore"):
            cap = np.minimum((most / here).min(axis=1) ** 2, cap)
        factor = np.maximum((_squared_speeds(self.slopes[..., limited], cap) / most**2).max(axis=1), 1.0)
        return cap / _larger_of_neighbours(factor)

    def used(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """By quantity (m - 1, n) the largest part of its limit that each joint uses in a cell; of velocity an upper bound.

        Args:
            x: (m,) ṡ² at the grid points.
        """
        blocks = self._blocks()
        if len(blocks) > 1:
            parts = [self._part(*each).used(x[each[0] : each[1] + 1]) for each in blocks]
            return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        u = (np.diff(x) / (2.0 * self.steps))[:, None]
        (d0, d1, d2), (e0, e1), x0, x1 = self.slopes, self.bends, x[:-1, None], x[1:, None]
        b0, b1, b2 = d0 * u + e0 * x0, d1 * u + 0.5 * (e0 * x1 + e1 * x0), d2 * u + e1 * x1
        curve = b0 - 2.0 * b1 + b2
        with np.errstate(divide="ignore", invalid="ignore"):
            turns = (curve != 0.0) & (np.abs(b0 - b2) < np.abs(curve))  # between both ends
            inner = np.where(turns, b0 - (b0 - b1) ** 2 / curve, 0.0)
        accelerations = np.maximum(np.maximum(np.abs(b0), np.abs(b2)), np.abs(inner))
        speeds = np.sqrt(np.maximum(_squared_speeds(self.slopes, x), 0.0))
        return {"velocity": speeds / self.limits.velocity, "acceleration": accelerations / self.limits.acceleration}


def _larger_of_neighbours(cells: np.ndarray) -> np.ndarray:
    """(m, …) the larger value of the two cells beside each grid point; cells (m - 1, …)."""
    return np.maximum(np.concatenate([cells[:1], cells]), np.concatenate([cells, cells[-1:]]))


def _squared_speeds(slopes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Upper bound (m - 1, n) of q'² x in each cell: its largest Bernstein coefficient, of degree five."""
    (d0, d1, d2), x0, x1 = slopes, x[:-1, None], x[1:, None]
    squares = [d0 * d0, d0 * d1, (d0 * d2 + 2.0 * d1 * d1) / 3.0, d1 * d2, d2 * d2]
    most = np.maximum(squares[0] * x0, squares[4] * x1)
    for k in range(1, 5):
        most = np.maximum(most, ((5 - k) * squares[k] * x0 + k * squares[k - 1] * x1) / 5.0)
    return most

"""Distance over time between grid points with known squared path speeds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

NEWTON = 4  # iterations for a piece's duration: its error is squared by each
TURNED = 0.5  # of a piece's acceleration that may change to either side, and of its speed


@dataclass(frozen=True, eq=False)
class PathTiming:
    """s(t) with ṡ = √x at the grid points; within a piece s̈ is linear in time.

    A planner that lets s̈ jump at every grid point draws stairs where the active limit falls with speed. Here s̈ goes through the
    middle of each stair with the smaller of the slopes to the next stairs on both sides, and with none where these have
    different signs [VanLeer1979]: where s̈ is smooth it is continuous but for the square of the grid's distance, and where the
    active limit changes it still jumps.

    Attributes:
        s: (m,) grid.   x: (m,) ṡ² there.   ramps: one, or (m - 1,): where False, s̈ is constant.
        spans: (m - 1,) [s] durations of the pieces of a cubic spline s(t), whose s̈ is continuous; None: by the ramps.
    """

    s: np.ndarray
    x: np.ndarray
    ramps: bool | np.ndarray = True
    spans: np.ndarray | None = None

    def slowed(self, factor: float) -> PathTiming:
        """As slow: every duration times a factor."""
        spans = None if self.spans is None else factor * self.spans
        return replace(self, x=self.x / factor**2, spans=spans)

    @cached_property
    def speeds(self) -> np.ndarray:
        """(m,) ṡ at the grid points."""
        return np.sqrt(self.x)

    @cached_property
    def jerks(self) -> np.ndarray:
        """(m - 1,) s⃛ in each piece."""
        if self.spans is not None:
            mean = 0.5 * (self.speeds[:-1] + self.speeds[1:])
            return 12.0 * (mean * self.spans - np.diff(self.s)) / self.spans**3
        if not np.any(self.ramps):
            return np.zeros(len(self.s) - 1)
        v, ds = self.speeds, np.diff(self.s)
        times, sdd = 2.0 * ds / (v[:-1] + v[1:]), np.diff(self.x) / (2.0 * ds)
        slopes = 2.0 * np.diff(sdd) / (times[:-1] + times[1:])
        before, after = np.append(slopes[:1], slopes), np.append(slopes, slopes[-1:])  # the ends go on as they begin
        least = np.where(before * after > 0.0, np.sign(after) * np.minimum(np.abs(before), np.abs(after)), 0.0)
        at_ends = np.ones(len(ds), dtype=bool)
        at_ends[1:-1] = False  # from and to rest ṡ must not turn negative
        most = np.where(
            at_ends, 2.0 * TURNED * np.abs(sdd) / times, 8.0 * TURNED * np.minimum(v[:-1], v[1:]) / times**2
        )
        return np.where(self.ramps, np.clip(least, -most, most), 0.0)

    @cached_property
    def durations(self) -> np.ndarray:
        """(m - 1,) [s] of the pieces: the T near 2 Δs / (v₀ + v₁) with  Δs = (v₀ + v₁) T / 2 - s⃛ T³ / 12."""
        if self.spans is not None:
            return self.spans
        mean, ds = 0.5 * (self.speeds[:-1] + self.speeds[1:]), np.diff(self.s)
        times = ds / mean
        for _ in range(NEWTON):
            times = times - (mean * times - self.jerks * times**3 / 12.0 - ds) / (mean - 0.25 * self.jerks * times**2)
        return times

    @cached_property
    def accelerations(self) -> np.ndarray:
        """(m - 1,) s̈ at the beginning of each piece."""
        return np.diff(self.speeds) / self.durations - 0.5 * self.jerks * self.durations

    def at(self, pieces: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """s, ṡ and s̈ in pieces at times t [s] from the beginning of each; shapes as broadcast."""
        v, a, j = self.speeds[pieces], self.accelerations[pieces], self.jerks[pieces]
        s = self.s[pieces] + t * (v + t * (0.5 * a + t * (j / 6.0)))
        return np.minimum(s, self.s[pieces + 1]), np.maximum(v + t * (a + 0.5 * t * j), 0.0), a + t * j

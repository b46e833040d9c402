"""Motions of the joints along a path of the tool."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.scalar import Array, Scalar
from armwright.trajectory.cartesian.path import CartesianPath
from armwright.trajectory.cartesian.solve import ToolPathSolution
from armwright.trajectory.motion import Motion
from armwright.trajectory.piecewise import PiecewisePolynomial


@dataclass(frozen=True)
class SlowStretch:
    """A part of a path on which the requested speed exceeds a limit; `str` gives it as a sentence.

    Attributes:
        begin, end: s [m].   slower: factor by which the tool would have to be slower.   what: the limit, and what was needed.
    """

    begin: float
    end: float
    slower: float
    what: str

    def __str__(self) -> str:
        return f"s = {self.begin:.4g} … {self.end:.4g} m: {self.slower:.3g} times too fast, {self.what}"


@dataclass(frozen=True, eq=False, repr=False)
class CartesianMotion(Motion):
    """Motion of the joints along a path of the tool; made by `follow_path`.

    The way s(t) is piecewise of constant jerk; q = q(s), q̇ = q' ṡ, q̈ = q'' ṡ² + q' s̈.

    Attributes:
        solution: joint positions along the path.   profile: s(t) [m].
        slowed: factor by which the motion is slower than requested, where it is slowest.
        reasons: limits that asked for it, the hardest first.   stretches: where they did.
    """

    solution: ToolPathSolution
    profile: PiecewisePolynomial
    slowed: float
    reasons: tuple[str, ...] = ()
    stretches: tuple[SlowStretch, ...] = ()

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.solution.n

    @property
    def time(self) -> float:
        """Time of the beginning [s]."""
        return self.profile.time

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return self.profile.duration

    @property
    def path(self) -> CartesianPath:
        """Path of the tool."""
        return self.solution.path

    @property
    def breaks(self) -> np.ndarray:
        """(k,) [s] ends of the profile's segments, and times at which the tool passes the ends of the path's pieces."""
        return np.unique(np.concatenate([self.profile.knots, self.times(self.path.breaks)]))

    def times(self, s: Any) -> np.ndarray:
        """Times [s] (k,) at which the tool is at s (k,) [m], by halving."""
        s = np.asarray(s, dtype=float)
        low = np.full(len(s), self.time)
        high = np.full(len(s), self.time + self.duration)
        for _ in range(60):
            middle = 0.5 * (low + high)
            before = self.profile.at(middle)[0][:, 0] < s
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        return high

    def _at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        s, rate, change = (each[..., 0] for each in self.profile.at(times))
        q, first, second = self.solution.at(s)
        rate, change = rate[..., None], change[..., None]
        return q, first * rate, second * rate * rate + first * change

    def jerk(self, t: Any) -> np.ndarray:
        """q⁽³⁾ = d³q/ds³ ṡ³ + 3 q'' ṡ s̈ + q' s⁽³⁾, (k, n) [rad/s³ | m/s³], at times t (k,) [s]."""
        t = np.asarray(t, dtype=float)
        s, rate, change = (each[:, 0] for each in self.profile.at(t))
        _, first, second = self.solution.at(s)
        third, jerk = self.solution.third(s), self.profile.derivative().at(t)[2][:, 0]
        return third * rate[:, None] ** 3 + 3.0 * second * (rate * change)[:, None] + first * jerk[:, None]

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at a time t [s], a number.

        Raises:
            ScenarioError: a symbol; its hundreds of polynomials are sampled, not traced.
        """
        if scalar.is_symbolic(t):
            expected = "a number; in a loop it is sampled at every tick"
            raise ScenarioError("cannot be traced", place="CartesianMotion", expected=expected)
        return self.at(t)

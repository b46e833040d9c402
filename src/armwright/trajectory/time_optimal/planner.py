"""Rounds of a plan: bounds of s̈ over coarse levels of x, then over finer levels about the profile that was found; then limits
are shrunk where a denser grid exceeds them, and the plan is made again, until it holds.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from armwright.errors import ScenarioError
from armwright.kernels.compiled import CompiledArm
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.path import JointPath
from armwright.trajectory.time_optimal.constraints import PathLimits
from armwright.trajectory.time_optimal.passes import Profile, Table, fastest_profile

COARSE = np.unique(
    np.concatenate([np.linspace(0.0, 1.0, 49), np.geomspace(1e-4, 0.05, 24)])
)  # levels, of the largest √x
FINE = 16  # levels in a band
RAISED = 4.0  # times in x, of coarse levels that are too low
MOST = 1e50  # of a path acceleration, and of x
BANDS = (0.6, 0.2, 0.04, 0.01)  # half widths of the finer levels, of √x
FIRST_BAND = 2  # after the coarse levels
LEAST_BAND = 1e-3  # of a band, of the largest √x: where x is small
MOST_PASSES = 20  # over finer levels
REPEATS = 3  # over a band that the profile leaves, before a wider one
DENSER = 48  # times, of the grid that judges
NEAR = 0.5 ** np.arange(6, 12)  # of a piece: there friction that is smoothed comes up
WITHIN = np.concatenate([np.linspace(0.0, 1.0, DENSER + 1), NEAR, 1.0 - NEAR])  # of a piece: times that judge
KEPT = 5e-7  # of a limit: the largest excess of a plan that holds
SHRUNK = 1.05  # times the excess
ROUNDS = 12  # of shrinking
SLOWINGS = 100  # of the whole motion, of a plan that shrinking does not end
QUANTITIES = ("velocity", "acceleration", "torque", "voltage")


@dataclass(eq=False)
class Planner:
    """A plan in progress.

    Attributes:
        dyn: the compiled arm.   limits: of its joints.   path: q(s).   s: (m,) grid.   ends: x at the beginning and the end.
        shares: by quantity (m, n), the part of its limit that the plan may use at each grid point.
    """

    dyn: CompiledArm
    limits: MotionLimits
    path: JointPath
    s: np.ndarray
    ends: tuple[float, float]
    points: PathLimits = field(init=False)
    shares: dict[str, np.ndarray] = field(init=False)

    def __post_init__(self) -> None:
        self.points = PathLimits.at(self.dyn, self.limits, self.path, self.s)
        self.shares = {name: np.ones(self.points.q.shape) for name in QUANTITIES}

    def plan(self) -> tuple[Profile, dict[str, np.ndarray]]:
        """The fastest profile that keeps all limits on the judging grid, and what it uses of them (m - 1, n), by quantity.

        Raises:
            ScenarioError: no profile keeps the limits between grid points.
        """
        profile = self.fastest()
        for _ in range(ROUNDS):
            if profile.stuck is not None:
                return profile, {}
            used = self._used(profile.x)
            if _largest(used) <= 1.0 + KEPT:
                return profile, used
            self._shrink(used)
            wide_enough = [k for k, band in enumerate(BANDS) if band >= _largest(used) - 1.0]
            profile = self._refined(profile, wide_enough[-1] if wide_enough else 0)
        return self._slowed(profile)

    def fastest(self) -> Profile:
        """The fastest profile that keeps the limits, as far as they are shrunk, at grid points."""
        return self._refined(self._coarse(), FIRST_BAND)

    def _coarse(self) -> Profile:
        """The profile over levels of x from 0 up to the velocity limits, or as far as it reaches without."""
        cap = self.points.largest_x(self.shares)
        high = self.points.bounds(np.zeros((len(self.s), 1)), self.shares)[1]
        top = max(4.0 * float(np.median(np.clip(high, 0.0, MOST))) * self.path.length, *self.ends)
        while True:
            highest = np.minimum(cap, top)
            v = np.sqrt(highest)[:, None] * COARSE
            for x in self.ends:  # a level of constant speed, from which and to which a way leads
                if x > 0.0:
                    v[np.arange(len(v)), np.abs(v - np.sqrt(x)).argmin(axis=1)] = np.minimum(np.sqrt(x), v[:, -1])
            profile = self._pass(v * v)
            if profile.highest_first < self.ends[0]:
                return replace(profile, stuck=0)
            if top >= MOST or not ((profile.x > 0.9 * top) & (highest == top)).any():
                return profile
            top *= RAISED

    def _refined(self, profile: Profile, band: int) -> Profile:
        """The profile over finer levels about one, again where it leaves them; over wider levels where it finds no way there."""
        repeats = 0
        for _ in range(MOST_PASSES):
            if profile.stuck is not None:
                return profile
            found, left = self._fine(profile.x, BANDS[band])
            if found.stuck is not None:
                profile, band, repeats = (self._coarse() if band == 0 else profile), max(band - 1, 0), 0
                continue
            profile, repeats = found, (repeats + 1 if left else 0)
            if left:
                band = band if repeats % REPEATS else max(band - 1, 0)
            elif band == len(BANDS) - 1:
                break
            else:
                band += 1
        return profile

    def _fine(self, x: np.ndarray, band: float) -> tuple[Profile, bool]:
        """The profile over levels in a band about x, and True if it runs along an end of the band."""
        v, cap = np.sqrt(x), np.sqrt(self.points.largest_x(self.shares))
        least = LEAST_BAND * band * v.max()
        low = np.maximum(v * (1.0 - band) - least, 0.0)
        high = np.minimum(np.maximum(v * (1.0 + band), low + least), cap)
        low = np.minimum(low, (1.0 - band) * high)
        profile = self._pass((low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, FINE)) ** 2)
        if profile.stuck is not None:
            return profile, True
        v, cell = np.sqrt(profile.x), (high - low) / FINE
        return profile, bool((((v > high - cell) & (high < cap)) | ((v < low + cell) & (low > 0.0))).any())

    def _pass(self, x: np.ndarray) -> Profile:
        return fastest_profile(Table(x, *self.points.bounds(x, self.shares), np.diff(self.s)), *self.ends)

    def _used(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """By quantity (m - 1, n) the largest part of its limit that each joint uses between grid points."""
        s, x, sdd = between(self.s, x)
        points = PathLimits.at(self.dyn, self.limits, self.path, s.ravel())
        used = points.used(x.reshape(-1, 1), sdd.reshape(-1, 1))
        return {name: _peaks(np.abs(each).reshape(*s.shape, -1)) for name, each in used.items()}

    def _shrink(self, used: dict[str, np.ndarray]) -> None:
        """Takes the excess between two grid points off the limits at both."""
        for name, part in used.items():
            factor = 1.0 / (1.0 + SHRUNK * np.maximum(part - 1.0, 0.0))
            self.shares[name][:-1] *= factor
            self.shares[name][1:] *= factor

    def _slowed(self, profile: Profile) -> tuple[Profile, dict[str, np.ndarray]]:
        """The profile, made slower as a whole until it keeps the limits."""
        x, used = profile.x, self._used(profile.x)
        for _ in range(SLOWINGS):
            if _largest(used) <= 1.0 + KEPT or any(self.ends):
                break
            x = x / (1.0 + 2.0 * (_largest(used) - 1.0))
            used = self._used(x)
        if _largest(used) > 1.0 + KEPT:
            raise ScenarioError(
                f"limits are exceeded by {_largest(used) - 1.0:.2g} of them between grid points", place="grid",
                value=len(self.s), expected="more grid points",
            )  # fmt: skip
        return replace(profile, x=x), used


def _peaks(rows: np.ndarray) -> np.ndarray:
    """Largest value (m, n) over the times of each piece (m, k, n), by a parabola through three even times where they peak."""
    even = rows[:, : DENSER + 1]
    before, here, after = even[:, :-2], even[:, 1:-1], even[:, 2:]
    bend = 2.0 * here - before - after
    is_peak = (here >= before) & (here >= after) & (bend > 0.0)
    over = np.divide((after - before) ** 2, 8.0 * bend, out=np.zeros_like(here), where=is_peak)
    return np.maximum(rows.max(axis=1), (here + over).max(axis=1))


def _largest(used: dict[str, np.ndarray]) -> float:
    return max(float(each.max()) for each in used.values())


def between(s: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Path position, x and s̈, each (m - 1, k), at times spread over every piece, both ends included and denser near them."""
    begin, end = np.sqrt(x[:-1])[:, None], np.sqrt(x[1:])[:, None]
    ds = np.diff(s)[:, None]
    speed = begin + (end - begin) * WITHIN
    gone = ds * (begin + speed) * WITHIN / (begin + end)
    return s[:-1, None] + gone, speed * speed, np.broadcast_to((end**2 - begin**2) / (2.0 * ds), speed.shape)

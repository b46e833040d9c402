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
DENSER, CLOSE = 48, 192  # times, of the grids that judge: the second only where the first finds nothing
NEAR = 0.5 ** np.arange(6, 12)  # of a piece: there friction that is smoothed comes up
KEPT = 5e-7  # of a limit: the largest excess of a plan that holds
SHRUNK = 1.05  # times the excess
ROUNDS, SLOW = 16, 4  # of shrinking, and after how many of them the excess counts twice: then it falls too slowly
SLOWEST = 0.8  # of x: how far a plan that shrinking does not end is made slower as a whole
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
        if profile.stuck is not None:
            return profile, {}
        for count in range(ROUNDS):
            used = self._judged(profile.x)
            if _largest(used) <= 1.0 + KEPT:
                return profile, used
            self._shrink(used, SHRUNK * (1.0 + count / SLOW))
            wide_enough = [k for k, band in enumerate(BANDS) if band >= _largest(used) - 1.0]
            shrunk = self._refined(profile, wide_enough[-1] if wide_enough else 0)
            if shrunk.stuck is not None:  # limits so small that they no longer hold the arm
                break
            profile = shrunk
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

    def _judged(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """By quantity (m - 1, n) the largest part of its limit that each joint uses between grid points."""
        used = self._used(x, DENSER)
        return used if _largest(used) > 1.0 + KEPT else self._used(x, CLOSE)

    def _used(self, x: np.ndarray, denser: int) -> dict[str, np.ndarray]:
        """The same on a grid that is so many times denser."""
        s, x, sdd = between(self.s, x, denser)
        points = PathLimits.at(self.dyn, self.limits, self.path, s.ravel())
        used = points.used(x.reshape(-1, 1), sdd.reshape(-1, 1))
        return {name: _peaks(np.abs(each).reshape(*s.shape, -1), denser) for name, each in used.items()}

    def _shrink(self, used: dict[str, np.ndarray], times: float) -> None:
        """Takes the excess between two grid points, so many times, off the limits at both."""
        for name, part in used.items():
            factor = 1.0 / (1.0 + times * np.maximum(part - 1.0, 0.0))
            self.shares[name][:-1] *= factor
            self.shares[name][1:] *= factor

    def _slowed(self, profile: Profile) -> tuple[Profile, dict[str, np.ndarray]]:
        """The profile, made slower as a whole until it keeps the limits.

        Raises:
            ScenarioError: it does not, with the place, the joint and the excess.
        """
        used = self._judged(profile.x)
        for scale in np.linspace(1.0, SLOWEST, 9)[1:] if not any(self.ends) else ():
            slower = self._judged(scale * profile.x)
            if _largest(slower) <= 1.0 + KEPT:
                return replace(profile, x=scale * profile.x), slower
        name, rows = max(used.items(), key=lambda item: item[1].max())
        k, joint = np.unravel_index(int(rows.argmax()), rows.shape)
        raise ScenarioError(
            f"the {name} of {self.limits.names[joint]} exceeds its limit by {rows.max() - 1.0:.2g} of it from "
            f"s = {self.s[k]:.6g} to {self.s[k + 1]:.6g}, however the plan is made", place="grid", value=len(self.s),
            expected="more grid points, or a path that turns where the motors have more in hand",
        )  # fmt: skip


def _peaks(rows: np.ndarray, even: int) -> np.ndarray:
    """Largest value (m, n) over the times of each piece (m, k, n), by a parabola through three even times where they peak."""
    before, here, after = rows[:, : even - 1], rows[:, 1:even], rows[:, 2 : even + 1]
    bend = 2.0 * here - before - after
    is_peak = (here >= before) & (here >= after) & (bend > 0.0)
    over = np.divide((after - before) ** 2, 8.0 * bend, out=np.zeros_like(here), where=is_peak)
    return np.maximum(rows.max(axis=1), (here + over).max(axis=1))


def _largest(used: dict[str, np.ndarray]) -> float:
    return max(float(each.max()) for each in used.values())


def between(s: np.ndarray, x: np.ndarray, denser: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Path position, x and s̈, each (m - 1, k), at times spread over every piece, both ends included and denser near them."""
    within = np.concatenate([np.linspace(0.0, 1.0, denser + 1), NEAR, 1.0 - NEAR])
    begin, end = np.sqrt(x[:-1])[:, None], np.sqrt(x[1:])[:, None]
    ds = np.diff(s)[:, None]
    speed = begin + (end - begin) * within
    gone = ds * (begin + speed) * within / (begin + end)
    return s[:-1, None] + gone, speed * speed, np.broadcast_to((end**2 - begin**2) / (2.0 * ds), speed.shape)

"""Rounds of a plan: exact linear programs with the tangents of all limits at the profile before, until it no longer changes; then
limits are shrunk where a denser grid exceeds them, and the plan is made again, until it holds.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import maximum_filter1d

from armwright.errors import ScenarioError
from armwright.kernels.compiled import CompiledArm
from armwright.kernels.speed_passes import controllable, greedy
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.path import JointPath
from armwright.trajectory.time_optimal.constraints import TINY, PathLimits
from armwright.trajectory.time_optimal.timing import PathTiming

MOST = 1e50  # of a path acceleration, and of x
PASSES, DAMPED = 60, 12  # with new tangents, at most; after how many the next are taken halfway
SAME = 1e-6  # of the largest √x: a change up to which a profile has settled
CLOSE = 1e-2  # of the largest √x: a change up to which tangents are taken at the profile itself: they double its digits
FALLING = 0.25  # of √x: tangents are taken no lower, as those of friction near rest allow nothing
SETTLED = 1e-9  # of the largest √x: a change up to which tangents are not taken again
# times x, where tangents leave no way: friction's, taken at low speed, are on the safe side
SLOWER, SLOWINGS = 0.25, 16
AT_REST = 1e-12  # of the largest x
HALVINGS = 30  # of ṡ² at an end
LOOKED = np.linspace(0.0, 1.0, 9)  # of a piece's time, before …
EVEN, NEAR = np.linspace(0.0, 1.0, 25), 0.5 ** np.arange(6, 14)
JUDGED = np.unique([*EVEN, *NEAR, *(1.0 - NEAR)])  # of a piece's time: near its ends smoothed friction comes up
ZOOM, ZOOMS = np.linspace(0.0, 1.0, 11), 4  # between the neighbours of a peak, and how often
KEPT = 5e-7  # of a limit: the largest excess of a plan that holds
SHRUNK = 1.05  # times the excess
ROUNDS, SLOW = 20, 4  # of shrinking, and after how many of them the excess counts twice: then it falls too slowly
SPREAD = 4  # times as many pieces about it, in each round but the first two, off whose limits an excess is taken
FARTHEST = 16  # pieces about an excess, at most
LEVELLED = 6  # rounds after which a ramp that exceeds a limit is levelled
LOOSE = 1.05  # times a limit at grid points, at most, where the motion between them keeps it
SLOWEST = 0.2  # of x: what is taken off a whole plan at most where shrinking does not end, from twice the excess on
QUANTITIES = ("velocity", "acceleration", "torque", "voltage")


@dataclass(frozen=True, eq=False)
class Profile:
    """Squared path speeds.

    Attributes:
        x: (m,).   highest_first: the largest x at the first grid point from which the end is reached.
        stuck: grid point from which no way leads on; None: there is a way.
    """

    x: np.ndarray
    highest_first: float
    stuck: int | None = None


@dataclass(eq=False)
class Planner:
    """A plan in progress.

    Attributes:
        dyn: the compiled arm.   limits: of its joints.   path: q(s).   s: (m,) grid.   ends: x at the beginning and the end.
        shares: by quantity (m, n), the part of its limit that the plan may use at each grid point.
        levelled: (m - 1,) pieces in which s̈ is constant, for the so-many-th time at this place; 0: it is a ramp in time.
        least: [s] duration with the limits at grid points alone, once it is planned.
    """

    dyn: CompiledArm
    limits: MotionLimits
    path: JointPath
    s: np.ndarray
    ends: tuple[float, float]
    points: PathLimits = field(init=False)
    shares: dict[str, np.ndarray] = field(init=False)
    levelled: np.ndarray = field(init=False)
    least: float = field(init=False, default=np.inf)

    def __post_init__(self) -> None:
        self.points = PathLimits.at(self.dyn, self.limits, self.path, self.s)
        self.shares = {name: np.ones(self.points.q.shape) for name in QUANTITIES}
        self.levelled = np.zeros(len(self.s) - 1, dtype=int)

    @property
    def ramps(self) -> np.ndarray:
        """(m - 1,) pieces in which s̈ is a ramp in time; in the others it is constant."""
        return self.levelled == 0

    def plan(self) -> tuple[Profile, dict[str, np.ndarray]]:
        """The fastest profile within all limits on the judging grid, and its share of each limit (m - 1, n), by quantity.

        Raises:
            ScenarioError: no profile keeps the limits between grid points.
        """
        profile = self.fastest()
        if profile.stuck is not None:
            return profile, {}
        self.least = float(PathTiming(self.s, profile.x, self.ramps).durations.sum())
        self._loosen(self.judged(profile.x))
        loose = self._settled(profile.x)
        profile = profile if loose.stuck is not None else loose
        for count in range(ROUNDS):
            used = self.judged(profile.x)
            if largest(used) <= 1.0 + KEPT:
                return profile, used
            self._shrink(used, count)
            shrunk = self._settled(profile.x)
            if shrunk.stuck is not None:  # limits so small that they no longer hold the arm
                break
            profile = shrunk
        return self._slowed(profile)

    def fastest(self) -> Profile:
        """The fastest profile within the limits, as tightened so far, at grid points."""
        high = self.points.bounds(np.zeros((len(self.s), 1)), self.shares)[1]
        usual = float(np.median(np.clip(high, 0.0, MOST))) * self.path.length
        return self._settled(np.minimum(self.points.largest_x(self.shares), max(usual, *self.ends)))

    def highest_last(self) -> float:
        """The largest reachable x at the end."""
        below, above = 0.0, self.ends[1]
        for _ in range(HALVINGS):
            middle = 0.5 * (below + above)
            profile = replace(self, ends=(self.ends[0], middle)).fastest()
            below, above = (middle, above) if profile.stuck is None else (below, middle)
        return below

    def _settled(self, x: np.ndarray) -> Profile:
        """The fastest profile with tangents of the limits at itself, found from those at x (m,).

        Where all limits are convex in x it is the optimum, and each pass doubles the digits that are right. Where two profiles
        follow from the tangents at each other, the slower one is taken: what it exceeds is found by judging it.
        """
        slowings, profile, earlier = 0, Profile(x, -1.0, stuck=0), np.zeros(len(x))
        tangents, taken = (np.zeros((len(x), 0)),) * 3, np.full(len(x), np.inf)  # and the √x at which
        for count in range(PASSES):
            tangents, taken = self._tangents(x, tangents, taken)
            lines = self.points.lines(self.s, tangents, self.shares)
            low, high = controllable(lines, self.ends[1])
            if high[0] < 0.0:
                slowings += 1
                if slowings > SLOWINGS:
                    return Profile(x, -1.0, stuck=int((high < 0.0).sum()) - 1)
                x = SLOWER * x
                continue
            found = greedy(lines, low, high, min(max(self.ends[0], low[0]), high[0]))
            v, before = np.sqrt(found), np.sqrt(x)
            rests = np.maximum(found[:-1], found[1:]) <= AT_REST * found.max()
            stuck = int(rests.argmax()) if rests.any() else None
            last, profile = profile, Profile(found, float(high[0]), stuck if low[0] <= self.ends[0] <= high[0] else 0)
            change = np.abs(v - before).max()
            if change <= SAME * v.max():
                break
            if np.abs(v - earlier).max() <= SAME * v.max():
                return min(profile, last, key=lambda each: (each.stuck is not None, each.x.sum()))
            near = v if count < DAMPED or change <= CLOSE * v.max() else 0.5 * (v + before)
            inner = np.maximum(near[1:-1], FALLING * before[1:-1])
            earlier, x = before, np.concatenate([near[:1], inner, near[-1:]]) ** 2
        return profile

    def _tangents(
        self, x: np.ndarray, before: tuple[np.ndarray, ...], taken: np.ndarray
    ) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
        """Tangents of the limits at x (m,) and √x; those before where √x is what it was then, but for a thousandth of `SAME`."""
        v = np.sqrt(x)
        k = np.flatnonzero(~(np.abs(v - taken) <= SETTLED * v.max()))
        if not len(k):
            return before, taken
        shares = {name: each[k] for name, each in self.shares.items()}
        found = self.points.of_points(k).tangents(x[k], shares, TINY * x.max())
        if len(k) == len(x):
            return found, v
        tangents = tuple(each.copy() for each in before)
        for each, rows in zip(tangents, found, strict=True):
            each[k] = rows
        taken = taken.copy()
        taken[k] = v[k]
        return tangents, taken

    def judged(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """By quantity (m - 1, n) the largest part of its limit that each joint uses between grid points.

        At first at few times of every piece, then at many; where that finds no excess, closer and closer about every peak that
        may be one.
        """
        timing, pieces, rows = PathTiming(self.s, x, self.ramps), np.arange(len(x) - 1), np.zeros(0)
        for parts in (LOOKED, JUDGED):
            rows = self._used(timing, pieces, np.broadcast_to(parts, (len(pieces), len(parts))))
            if rows.max() > 1.0 + KEPT:
                break
        most = rows.max(axis=1)
        if most.max() <= 1.0 + KEPT:
            before, here, after = rows[:, :-2], rows[:, 1:-1], rows[:, 2:]
            reach = here + np.maximum(np.abs(here - before), np.abs(here - after))
            piece, k, column = np.nonzero((here >= before) & (here >= after) & (reach > 1.0 + KEPT))
            low, high = JUDGED[k], JUDGED[k + 2]
            for _ in range(ZOOMS if len(piece) else 0):
                parts = low[:, None] + (high - low)[:, None] * ZOOM
                values = self._used(timing, piece, parts)[np.arange(len(piece)), :, column]
                np.maximum.at(most, (piece, column), values.max(axis=1))
                k = values.argmax(axis=1).clip(1, len(ZOOM) - 2)
                low, high = (parts[np.arange(len(piece)), k + side] for side in (-1, 1))
        return dict(zip(self.shares, np.split(most, len(self.shares), axis=1), strict=True))

    def _used(self, timing: PathTiming, pieces: np.ndarray, parts: np.ndarray) -> np.ndarray:
        """Parts of limits (p, k, quantities × n) that are used in pieces (p,) after parts (p, k) of their times."""
        s, speed, sdd = timing.at(pieces[:, None], parts * timing.durations[pieces, None])
        points = PathLimits.at(self.dyn, self.limits, self.path, s.ravel())
        used = points.used(speed.reshape(-1, 1) ** 2, sdd.reshape(-1, 1))
        none = np.zeros((*s.shape, self.limits.n))
        return np.concatenate(
            [np.abs(used[name]).reshape(none.shape) if name in used else none for name in self.shares], axis=2
        )

    def _loosen(self, used: dict[str, np.ndarray]) -> None:
        """Gives back at grid points what the motion leaves of a limit that it is nearly at in both pieces beside them.

        The passes hold limits at both ends of stairs of s̈, the motion goes through their middles.
        """
        for name, part in used.items():
            left = np.where(part > 1.0 / LOOSE, 1.0 / np.maximum(part, 1.0 / LOOSE), 1.0).clip(1.0, None)
            self.shares[name][1:-1] *= np.minimum(left[:-1], left[1:])
            self.shares[name][0] *= left[0]
            self.shares[name][-1] *= left[-1]

    def _shrink(self, used: dict[str, np.ndarray], count: int) -> None:
        """Takes the excess between two grid points off the limits at both, in later rounds also off those near them.

        A lower share bends s̈ beside it, so that the next piece may exceed: an excess can wander along the grid, piece by piece.
        Where ramps exceed again, they become constants, which both ends of their pieces allow.
        """
        times, reach = SHRUNK * (1.0 + count / SLOW), min(SPREAD ** max(count - 1, 0), FARTHEST)
        exceeds = np.max([part.max(axis=1) for part in used.values()], axis=0) > 1.0 + KEPT
        level = self._level(exceeds & self.ramps) if count >= LEVELLED else np.zeros_like(exceeds)
        for name, part in used.items():
            self.shares[name][:-1][level] = np.minimum(self.shares[name][:-1][level], 1.0)
            self.shares[name][1:][level] = np.minimum(self.shares[name][1:][level], 1.0)
            excess = np.where(level[:, None], 0.0, np.maximum(part - 1.0, 0.0))
            excess = maximum_filter1d(excess, 2 * reach - 1, axis=0, mode="nearest")
            factor = 1.0 / (1.0 + times * excess)
            self.shares[name][:-1] *= factor
            self.shares[name][1:] *= factor

    def _level(self, pieces: np.ndarray) -> np.ndarray:
        """Levels the ramps of pieces (m - 1,) and of others about them, the farther the more often; True where it did."""
        times = np.zeros_like(self.levelled)
        for k in np.flatnonzero(pieces):
            before = int(self.levelled[max(k - 1, 0) : k + 2].max())
            reach = SPREAD**before - 1
            times[max(k - reach, 0) : k + reach + 1] = before + 1
        new = (times > 0) & self.ramps
        self.levelled = np.maximum(self.levelled, times)
        return new

    def _slowed(self, profile: Profile) -> tuple[Profile, dict[str, np.ndarray]]:
        """The profile, made slower as a whole until it keeps the limits.

        Raises:
            ScenarioError: it does not, with the place, the joint and the excess.
        """
        used = self.judged(profile.x)
        if largest(used) <= 1.0 + KEPT:
            return profile, used
        least = min(2.0 * (largest(used) - 1.0), SLOWEST)  # speeds go as √x
        for less in np.geomspace(least, SLOWEST, 9) if not any(self.ends) else ():
            scale = 1.0 - less
            slower = self.judged(scale * profile.x)
            if largest(slower) <= 1.0 + KEPT:
                return replace(profile, x=scale * profile.x), slower
        name, rows = max(used.items(), key=lambda item: item[1].max())
        k, joint = np.unravel_index(int(rows.argmax()), rows.shape)
        raise ScenarioError(
            f"the {name} of {self.limits.names[joint]} exceeds its limit by {rows.max() - 1.0:.2g} of it from "
            f"s = {self.s[k]:.6g} to {self.s[k + 1]:.6g}, however the plan is made", place="grid", value=len(self.s),
            expected="more grid points, or a path that turns where the motors have more in hand",
        )  # fmt: skip


def largest(used: dict[str, np.ndarray]) -> float:
    """The largest part of any limit."""
    return max(float(each.max()) for each in used.values())

"""Path timing of the tool: the requested speed, reduced on the stretches that a limit requires.

Under a ceiling of ṡ, by the tool's and the joints' speeds, the fastest ṡ² with bounded accelerations is found as for time-optimal
motions. Its mean over a moving window of time is smooth: with s̈ that jumps by Δ the window δ makes jerks of Δ / δ. Where that
motion exceeds a limit, the ceiling and the accelerations are lowered thereabouts, and the way is planned again.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armwright.trajectory.cartesian.solve import ToolPathSolution
from armwright.trajectory.cartesian.speed_sets import SpeedTable, fastest_profile
from armwright.trajectory.cartesian.uses import MARGIN, ROUNDED, uses_of
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.piecewise import PiecewisePolynomial

GRID = 400  # points of a run
LEVELS = np.linspace(0.0, 1.0, 25)  # of the largest ṡ
UNBOUNDED = 1e100
ROUNDS, NEAR = 15, 1e-3  # of lowering; of a limit: an excess that is taken off the whole motion in the end
USUAL = 75.0  # [%] of a way on which joints keep their limits of jerk by that of ṡ alone
LOWERED = 1.1  # power of the factor by which a motion is too fast
SAME = 1e-12  # of a duration: knots this near to each other are one
WINDOWS = 20  # tries for the shortest window that keeps the jerk


@dataclass(frozen=True)
class Pace:
    """Requested speed [m/s], acceleration [m/s²] and jerk [m/s³] of ṡ on a run; for a turn in place in rad."""

    speed: float
    acceleration: float
    jerk: float


@dataclass(eq=False)
class _Run:
    """A run between two stops: its grid, the limits there, and how far they are lowered."""

    s: np.ndarray  # (m,) from 0 on
    first: np.ndarray  # (m, n) q'
    second: np.ndarray
    tool: list[tuple[np.ndarray, np.ndarray, float]]  # (m, 3) first and second derivative of the pose, and the limit
    ceiling: np.ndarray  # (m,) of ṡ
    jerk: float  # of ṡ
    pace: Pace
    window: float = 0.0  # [s] of the mean; never shorter than before, so that lower accelerations have lower jerks
    speeds: np.ndarray = field(init=False)  # (m,) shares of the ceiling and of the accelerations
    accelerations: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.speeds, self.accelerations = np.ones(len(self.s)), np.ones(len(self.s))

    def fastest(self, limits: MotionLimits) -> np.ndarray:
        """(m,) the largest ṡ² from rest to rest under the ceiling."""
        x = (self.speeds * self.ceiling)[:, None] ** 2 * LEVELS**2
        low, high = self._bounds(x, limits.acceleration)
        return fastest_profile(SpeedTable(x, low, high, np.diff(self.s)))

    def _bounds(self, x: np.ndarray, most: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest s̈ (m, j) at x (m, j): of the way, of the joints and of the tool."""
        share = self.accelerations[:, None]
        high = np.broadcast_to(self.pace.acceleration * share, x.shape)
        low = -high
        for first, second, limit in zip(self.first.T, self.second.T, most, strict=True):
            if not np.isfinite(limit):
                continue
            slope = np.where(np.abs(first) * UNBOUNDED > limit, first, limit / UNBOUNDED)[:, None]
            ends = (-limit * share - second[:, None] * x) / slope, (limit * share - second[:, None] * x) / slope
            low, high = np.maximum(low, np.minimum(*ends)), np.minimum(high, np.maximum(*ends))
        for first, second, limit in self.tool:  # |p' s̈ + p'' x| ≤ a
            square, mixed = (first * first).sum(axis=1)[:, None], (first * second).sum(axis=1)[:, None] * x
            rest = (second * second).sum(axis=1)[:, None] * x * x - (limit * share) ** 2
            root = np.sqrt(np.maximum(mixed * mixed - square * rest, 0.0))
            safe = np.maximum(square, 1.0 / UNBOUNDED)
            low = np.maximum(low, np.where(square > 0.0, (-mixed - root) / safe, -UNBOUNDED))
            high = np.minimum(high, np.where(square > 0.0, (-mixed + root) / safe, UNBOUNDED))
        beyond = np.maximum(low, -UNBOUNDED) > np.minimum(high, UNBOUNDED)  # above what the passes can brake from
        return np.where(beyond, UNBOUNDED, low), np.where(beyond, -UNBOUNDED, high)

    def lower(self, times: np.ndarray, t: np.ndarray, slower: np.ndarray, dynamic: np.ndarray, window: float) -> None:
        """Lowers the ceiling and the accelerations at grid points whose motion, over the window behind them, is too fast.

        Args:
            times: (m,) [s] at the grid points, before the mean is taken.   t: (k,) [s] of the motion, increasing.
            slower, dynamic: (k,) factors by which it is too fast for all limits, and for those of accelerations and jerks.
        """
        before, after = np.append(times[:1], times[:-1]), np.append(times[1:], times[-1:])
        begins, ends = np.searchsorted(t, before), np.searchsorted(t, after + window, side="right")
        for k, rows in enumerate(map(slice, begins, ends)):
            self.speeds[k] /= max(1.0, slower[rows].max(initial=1.0)) ** LOWERED
            self.accelerations[k] /= max(1.0, dynamic[rows].max(initial=1.0)) ** (2.0 * LOWERED)


def locally_slowed(
    solution: ToolPathSolution, limits: MotionLimits, values: dict[str, float], paces: list[Pace], time: float
) -> tuple[PiecewisePolynomial, float]:
    """s(t) of all runs, as fast as requested within the limits, and the overall factor by which it is slower.

    Args:
        solution: joint positions along the path.   limits: velocity, acceleration and jerk of the joints.
        values: by name the tool's limits [m/s², rad/s, rad/s²]; infinite: none.   paces: of every run.
        time: [s] of the beginning.
    """
    runs = [_run(solution, limits, values, k, pace) for k, pace in enumerate(paces)]
    starts = [begin for begin, _ in solution.path.runs]
    rounds = 0
    while True:
        ways = [_smoothed(run.s, run.fastest(limits), run.jerk, run.window) for run in runs]
        begins = time + np.cumsum([0.0, *(way.duration for way, _, _ in ways)])
        profile = _joined([way for way, _, _ in ways], begins, starts)
        uses = uses_of(solution, profile, limits, values, rounds=0)
        slower, rounds = uses.slower, rounds + 1
        if slower.max() <= 1.0 + NEAR or rounds == ROUNDS:
            break
        dynamic = np.max([np.zeros(len(slower)), *(c.slower for c in uses.columns if c.power > 1)], axis=0)
        for run, (_, times, window), begin in zip(runs, ways, begins[:-1], strict=True):
            run.window = window
            run.lower(times, uses.t - begin, slower, dynamic, window)
    most = float(uses_of(solution, profile, limits, values).slower.max())
    if most <= 1.0 + ROUNDED:
        return profile, 1.0
    return profile.scaled(most * (1.0 + MARGIN)), most


def _run(solution: ToolPathSolution, limits: MotionLimits, values: dict[str, float], k: int, pace: Pace) -> _Run:
    """The grid of a run and the limits there."""
    begin, end = solution.path.runs[k]
    breaks = solution.path.breaks
    s = np.union1d(np.linspace(0.0, end - begin, GRID), breaks[(breaks > begin) & (breaks < end)] - begin)
    _, first, second = solution.runs[k].at(s)
    third = np.abs(solution.runs[k].derivative(s, 3))
    points = solution.twists(begin + s, solution.path.points(np.nextafter(begin + s, np.inf)))
    with np.errstate(divide="ignore"):
        ceilings = [
            np.full(len(s), pace.speed),
            (limits.velocity / np.abs(first)).min(axis=1),
            np.sqrt((limits.acceleration / np.abs(second)).min(axis=1)),
            np.cbrt((limits.jerk / third).min(axis=1)),
        ]
        parts = [(slice(0, 3), "acceleration"), (slice(3, 6), "angular_acceleration")]
        ceilings.append(values["angular_speed"] / np.linalg.norm(points.first[:, 3:], axis=1))
        tool = [
            (points.first[:, axes], points.second[:, axes], values[name])
            for axes, name in parts
            if np.isfinite(values[name])
        ]
        ceilings += [np.sqrt(limit / np.linalg.norm(bend, axis=1)) for _, bend, limit in tool]
    usual = np.percentile(np.abs(first), USUAL, axis=0)  # on the other part of the way accelerations are lowered for it
    with np.errstate(divide="ignore"):
        jerk = min(pace.jerk, float((limits.jerk / usual).min()))
    return _Run(s, first, second, tool, np.min(ceilings, axis=0), jerk, pace)


def _smoothed(
    s: np.ndarray, x: np.ndarray, jerk: float, window: float
) -> tuple[PiecewisePolynomial, np.ndarray, float]:
    """The mean of s over a moving window of time, the times (m,) at the grid points before it is taken, and the window [s].

    The window is the shortest that keeps the jerk, or the given one if that is longer. s(t) has constant s̈ between grid points;
    its mean from t - δ to t has constant jerk between the times at them and those a window later.
    """
    v, ds = np.sqrt(x), np.diff(s)
    times = np.concatenate([[0.0], np.cumsum(2.0 * ds / (v[:-1] + v[1:]))])
    sdd = np.concatenate([[0.0], np.diff(x) / (2.0 * ds), [0.0]])

    def state(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """s, ṡ and s̈ just after times t."""
        piece = np.searchsorted(times, t, side="right")
        k = np.maximum(piece - 1, 0)
        passed, a = np.where(piece > 0, t - times[k], 0.0), sdd[piece]
        return s[k] + passed * (v[k] + 0.5 * passed * a), v[k] + passed * a, a

    def mean(window: float) -> tuple[np.ndarray, ...]:
        """Knots and the mean's ṡ and s̈ just after them; s⃛ between them, by middles, which rounding moves over no knot."""
        knots = np.unique(np.concatenate([times, times + window]))
        knots = knots[np.append(True, np.diff(knots) > SAME * knots[-1])]
        middles = 0.5 * (knots[:-1] + knots[1:])
        (s, v, _), (s_past, v_past, _) = state(knots), state(knots - window)
        rate = state(middles)[2] - state(middles - window)[2]
        return knots, (s - s_past) / window, (v - v_past) / window, rate / window

    window = max(window, float(np.abs(sdd).max() / jerk))
    for _ in range(WINDOWS):
        most = float(np.abs(mean(window)[3]).max())
        if most <= jerk * (1.0 + ROUNDED):
            break
        window *= most / jerk * (1.0 + MARGIN)
    knots, speed, acceleration, rate = mean(window)
    h = np.diff(knots)
    speed, acceleration = speed[:-1], acceleration[:-1]
    gone = np.concatenate([[0.0], np.cumsum(h * (speed + h * (0.5 * acceleration + h * rate / 6.0)))])
    rows = np.stack([gone[:-1], speed, 0.5 * acceleration, rate / 6.0], axis=-1)[:, None]
    return PiecewisePolynomial(knots, rows), times, window


def _joined(ways: list[PiecewisePolynomial], begins: np.ndarray, starts: list[float]) -> PiecewisePolynomial:
    """Ways behind each other, that begin at times (k,) [s] and places [m]."""
    knots, rows = [begins[:1]], []
    for way, begin, start in zip(ways, begins[:-1], starts, strict=True):
        coefficients = way.coefficients.copy()
        coefficients[:, :, 0] += start
        knots.append(begin + way.knots[1:])
        rows.append(coefficients)
    return PiecewisePolynomial(np.concatenate(knots), np.concatenate(rows))

"""Fastest motions along a path within limits of jerk as well:  q⃛ = q' s⃛ + 3 q'' ṡ s̈ + q''' ṡ³.

s(t) is a cubic spline, C², through fixed places of the path. Unknown are the durations of its pieces, and ṡ and s̈ at the places.
The limits hold for the coefficients, in Bernstein's basis, of the polynomials through q̇, q̈ and q⃛ at both ends of each piece, so
that little is left to exceed them between. Limits of torque and voltage are tangents in ṡ² at the places, taken again at what was
found. An interior-point method finds a local optimum; a moving average of the fastest motion without a limit of jerk, over a
window of time, is the start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from scipy.interpolate import PPoly, make_interp_spline

from armwright.errors import ScenarioError
from armwright.kernels.compiled import CompiledArm
from armwright.trajectory.interior_point import Combined, Terms, iterates
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.path import JointPath
from armwright.trajectory.time_optimal.path_use import OF_MOTORS, ORDERS, PathUse
from armwright.trajectory.time_optimal.timing import PathTiming

PIECES, FEWEST = 24, 6  # between two breaks of the path on average; between any two breaks
ALONG, LEAST = 40.0, (160, 400)  # pieces within the moving average; of a path at least, by how short that is
WINDOWS = np.geomspace(2e-3, 2.9, 14)  # of the duration: lengths of the moving average
FASTEST = 4.0  # times the start's largest ṡ
BARRIERS = (0.2, 0.9), (0.1, 0.3)  # the first, by the part that the start takes longer than the fastest
FALL = 0.8  # of barriers: lower ones save steps where it goes well, and cost many where it does not
FIRST, STEPS = 12, 45  # steps at least and at most
LAST, SETTLED = 3, 3e-4  # steps, and the part of the duration that they change at most where the search ends
SMOOTH, EXACT = 5e-3, 1e-3  # of s̈ that may jump before the spline is made, and before what that exceeds lowers limits
LEFT, ENOUGH = 1e-3, 2e-4  # of limits before the first step; part of the duration that is not looked for
CONVEX = 0.02  # least added curvature, in parts
REPAIRS = 6  # of what exceeds limits between places
TANGENTS, LOWER = 10, 0.02  # of torques and voltages: how often they are taken, and the first barrier in later rounds
SHRUNK, GOOD = 1.05, 1.01  # times the excess; times the duration of what keeps limits at places alone
CHANGED = 1e-3  # of the duration, by new tangents: less is not looked for
BESIDE, FAR = 0.02, -1e6  # of a piece; of a limit, in place of a lower one where there is none
THIRD = 1.0 / 3.0


def has_jerk_limits(path: JointPath, limits: MotionLimits) -> bool:
    """True if the jerk of a joint that moves is limited."""
    return bool(np.isfinite(limits.jerk[np.ptp(path.waypoints, axis=0) > 0.0]).any())


def jerk_limited(
    path: JointPath, limits: MotionLimits, fastest: PathTiming, dyn: CompiledArm | None = None
) -> tuple[PathTiming, dict[str, np.ndarray]]:
    """The fastest s(t) that was found within all limits, from rest to rest with s̈ = 0.

    Args:
        path: C².   limits: of the joints.   fastest: without a limit of jerk.
        dyn: the compiled arm; None where neither torques nor voltages are limited.
    Returns:
        timing: its s̈ is continuous, and 0 at both ends.
        used: by quantity (m - 1, n) the largest part of its limit that each joint uses in a piece.
    Raises:
        ScenarioError: nothing was found.
    """
    second = float(fastest.durations.sum())  # the unit of time, for limits of any size
    with np.errstate(all="ignore"):  # numbers that are not finite end the search
        timing, used = _planned(PathUse.of(path, limits, dyn, second), fastest.slowed(1.0 / second))
    if not np.isfinite(timing.durations).all() or max(float(each.max()) for each in used.values()) > 1.0:
        raise _nothing_found()
    return timing.slowed(second), used


def _nothing_found() -> ScenarioError:
    expected = "other limits, or jerk = inf"
    return ScenarioError("no motion within the limits of jerk was found", place="limits.jerk", expected=expected)


def _planned(use: PathUse, fastest: PathTiming) -> tuple[PathTiming, dict[str, np.ndarray]]:
    """As `jerk_limited`, with times near 1.

    Where torques matter, turns are among the places, as dry friction jumps there. Where that ends in nothing good, places are
    twice as many, and turns are not among them.
    """
    tried: list[PathTiming] = []
    for with_turns, finer in ((False, 1),) if use.dyn is None else ((True, 1), (True, 2), (False, 1)):
        best, least = _found(use, fastest, with_turns, finer)
        tried.append(best)
        if best.durations.sum() < GOOD * least:
            break
    return use.kept(min(tried, key=lambda each: each.durations.sum()))


def _found(use: PathUse, fastest: PathTiming, with_turns: bool, finer: int) -> tuple[PathTiming, float]:
    """A motion that keeps the limits at some times of every piece, and the duration of the one that does so at places."""
    s, start = _start(use, fastest, with_turns, finer)
    if not np.isfinite(start).all():  # slower motions take more torque than there is
        raise _nothing_found()
    problem = SpeedProblem.of(use.path, use.limits, s, start)
    y, best = problem.within(problem.unknowns(start)), use.within(_through(s, start[:-1, 0]))
    far = float(start[:-1, 0].sum() / fastest.durations.sum()) - 1.0
    barrier = float(np.interp(far, *BARRIERS))
    if use.dyn is None:
        spans = problem.unit / _optimised(problem, y, barrier)[problem.rates]
        least = float(spans.sum())
    else:
        spans, least = _within_torques(use, problem, s, y, barrier)
    for _ in range(REPAIRS):
        found = _through(s, spans)
        best = min(best, use.within(found), key=lambda each: each.durations.sum())
        if best.durations.sum() < (1.0 + ENOUGH) * spans.sum():
            break
        spans = spans * use.locally_slower(use.sampled(found))
    return best, least


def _within_torques(
    use: PathUse, problem: SpeedProblem, s: np.ndarray, y: np.ndarray, barrier: float
) -> tuple[np.ndarray, float]:
    """Durations (m - 1,) of pieces within tangents of torques and voltages, taken again at what was found, and their least sum.

    What a motion exceeds between places is taken off the limits at both.
    """
    best, fastest, before, least = problem.unit / y[problem.rates], np.inf, np.inf, np.inf
    shares = {name: np.ones((len(s), use.path.n)) for name in OF_MOTORS}
    for count in range(TANGENTS):
        limited, start = problem.with_torques(use, s, problem.within(y) if count else y, shares)
        if not np.isfinite(1.0 / start[problem.rates]).all():  # limits so small that they no longer hold the arm
            break
        y = _optimised(limited, start, min(barrier, LOWER) if count else barrier)
        found = _through(s, problem.unit / y[problem.rates])
        kept, whole = float(use.within(found).durations.sum()), float(found.durations.sum())
        is_settled, before, least = before - whole < CHANGED * whole, whole, min(least, whole)
        if kept < fastest:
            best, fastest = found.durations, kept
        if is_settled and kept < (1.0 + ENOUGH) * whole:
            break
        if limited.jumps(y) > EXACT:  # these it exceeds most
            continue
        excess = {name: (part - 1.0).clip(0.0) for name, part in use.by_name(use.peaks(found)).items()}
        problem = problem.within_less(excess)
        for name in shares.keys() & excess.keys():
            factor = 1.0 / (1.0 + SHRUNK * excess[name])
            shares[name][:-1] *= factor
            shares[name][1:] *= factor
    return best, least


def _optimised(problem: SpeedProblem, first: np.ndarray, barrier: float) -> np.ndarray:
    """Unknowns after the last step of the interior-point method."""
    y, sums = first, []
    for y in islice(iterates(problem, first, barrier, FALL, CONVEX), STEPS):
        sums.append(float((1.0 / y[problem.rates]).sum()))
        is_settled = len(sums) > FIRST and abs(sums[-1] - sums[-1 - LAST]) <= SETTLED * sums[-1]
        if is_settled and problem.jumps(y) < SMOOTH:
            break
    return y


@dataclass(frozen=True, eq=False)
class SpeedProblem:
    """Limits in the pieces, in units of time and of s in which pieces are about 1 long, for `interior_point`.

    Unknown are the rate x = 1 / T of the piece after each place, and ṡ = v and s̈ = a there. A piece of length d with w and b at
    its end has a constant s⃛ where  (a + b) / 2 = x (w - v)  and  6 d x² - 3 x (v + w) + (b - a) / 2 = 0.

    Attributes:
        way: (m - 1,) d.
        rows: by quantity q', q'' and q''' over its limit, each (2, n, m - 1) at the beginnings and the ends of pieces.
        limited_joints: by quantity (n,) those that have a limit; the others are left out of the rows.
        fastest: (m,) largest ṡ.   size: of s̈.   unit: [s].   length: of s.
        torques: a, b and c (r, p) of limits  a s̈ + b ṡ² ≤ c  beside places, in parts of the largest c, and the numbers (p,) of
            the rates there.
    """

    way: np.ndarray
    rows: dict[str, tuple[np.ndarray, ...]]
    limited_joints: dict[str, np.ndarray]
    fastest: np.ndarray
    size: float
    unit: float
    length: float
    torques: tuple[np.ndarray, ...] = ()
    band: int = 5

    @classmethod
    def of(cls, path: JointPath, limits: MotionLimits, s: np.ndarray, start: np.ndarray) -> SpeedProblem:
        """The problem at places s (m,) from a start (m, 3): durations, ṡ and s̈."""
        unit, length = float(start[:-1, 0].mean()), float(np.diff(s).mean())
        _, first, second = path.at(s)
        third = path.derivative(0.5 * (s[:-1] + s[1:]), 3)
        both = [np.stack([each[:-1].T, each[1:].T]) for each in (first, second)] + [np.stack([third.T, third.T])]
        rows, joints = {}, {name: np.isfinite(getattr(limits, name)) for name in ORDERS}
        for name, order in ORDERS.items():
            most, limited = getattr(limits, name), joints[name]
            scale = length ** np.arange(1, 4)[:, None] / unit**order / most[limited]
            rows[name] = tuple(by[:, None] * each[:, limited] for by, each in zip(scale, both, strict=True))
        with np.errstate(divide="ignore"):
            fastest = (limits.velocity / np.abs(first)).min(axis=1)
        fastest = np.minimum(fastest, FASTEST * start[:, 1].max()) * unit / length
        size = float(np.abs(start[:, 2]).mean()) * unit**2 / length
        return cls(np.diff(s) / length, rows, joints, fastest, size, unit, length)

    def unknowns(self, start: np.ndarray) -> np.ndarray:
        """The unknowns from a start (m, 3)."""
        unit, length = self.unit, self.length
        return np.stack(
            [unit / start[:, 0], start[:, 1] * unit / length, start[:, 2] * unit**2 / length], axis=1
        ).ravel()

    def within(self, y: np.ndarray) -> np.ndarray:
        """Unknowns, as much slower as a whole as keeps all limits with a little left."""
        factor = max(float(np.abs(each.value / each.most).max()) ** (1.0 / order) for order, each in self._terms(y))
        return self.slower(y, max(factor * (1.0 + LEFT), 1.0))

    def within_less(self, excess: dict[str, np.ndarray]) -> SpeedProblem:
        """With limits of velocity, acceleration and jerk lowered in the pieces (m - 1, n) where a motion exceeds them."""
        more = {name: 1.0 + SHRUNK * excess[name].T[self.limited_joints[name]] for name in self.rows}
        return replace(self, rows={name: tuple(each * more[name] for each in rows) for name, rows in self.rows.items()})

    def with_torques(
        self, use: PathUse, s: np.ndarray, y: np.ndarray, shares: dict[str, np.ndarray]
    ) -> tuple[SpeedProblem, np.ndarray]:
        """With tangents of torques and voltages at unknowns, which are made slower as a whole until they keep shares (m, n)."""
        # on either side of a place, as near to it as the sign of dry friction is that of the piece
        piece = np.diff(s)
        k = np.tile(np.arange(1, len(s) - 1), 2)
        s = np.concatenate([s[1:-1] - BESIDE * piece[:-1], s[1:-1] + BESIDE * piece[1:]])
        rate = self.length / self.unit
        speed, sdd, none = rate * y[1::3][k], rate / self.unit * y[2::3][k], np.zeros_like(s)
        shares = {name: each[k] for name, each in shares.items()}
        factor = max(use.slowing(s, speed, sdd, none, none[:, None], shares=shares) * (1.0 + LEFT), 1.0)
        a, b, c = use.lines(s, speed / factor, shares)
        size = np.abs(c).max(axis=1, keepdims=True)
        torques = a / size * rate / self.unit, b / size * rate**2, c / size, 3 * k
        return replace(self, torques=torques), self.slower(y, factor)

    def slower(self, y: np.ndarray, factor: float) -> np.ndarray:
        """Unknowns of the motion that takes as much longer."""
        return y / np.tile([factor, factor, factor**2], len(y) // 3)

    def jumps(self, y: np.ndarray) -> float:
        """Largest part of s̈ by which an equation is not met."""
        return max(float(np.abs(each.value).max()) for each in self.zero(y))

    @property
    def rates(self) -> np.ndarray:
        """(m - 1,) numbers of the rates; a speed and an acceleration follow each."""
        return 3 * np.arange(len(self.way))

    @property
    def pinned(self) -> np.ndarray:
        """Numbers of speeds and accelerations at both ends, and of the rate after the last place."""
        last = 3 * len(self.way)
        return np.array([1, 2, last, last + 1, last + 2])

    def typical(self, y: np.ndarray) -> np.ndarray:
        """Mean sizes of rates, speeds and accelerations, for each of them."""
        return np.tile(np.abs(y.reshape(-1, 3)).mean(axis=0), len(y) // 3)

    def _pieces(self, y: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Numbers and values of x, v, a, w and b, each (m - 1,)."""
        at = [self.rates + k for k in (0, 1, 2, 4, 5)]
        return at, [y[each] for each in at]

    def zero(self, y: np.ndarray) -> list[Terms]:
        """Both equations of every piece."""
        numbers, (x, v, a, w, b) = self._pieces(y)
        d, half, at, unit = self.way, np.full_like(x, 0.5), tuple(each[:, None] for each in numbers), 1.0 / self.size

        def terms(value: np.ndarray, first: tuple[np.ndarray, ...], second: dict) -> Terms:
            return Terms(unit * value[:, None], at, tuple(unit * each[:, None] for each in first), second)

        mean = terms(0.5 * (a + b) - x * (w - v), (v - w, x, half, -x, half), {(0, 1): unit, (0, 3): -unit})
        curves = {(0, 0): 12.0 * unit * d[:, None], (0, 1): -3.0 * unit, (0, 3): -3.0 * unit}
        change = 6.0 * d * x * x - 3.0 * x * (v + w) + 0.5 * (b - a)
        return [mean, terms(change, (12.0 * d * x - 3.0 * (v + w), -3.0 * x, -half, -3.0 * x, half), curves)]

    def limited(self, y: np.ndarray) -> list[Combined]:
        """Bernstein coefficients of q̇, q̈ and q⃛ in every piece; ṡ and tangents of torques at the places between both ends."""
        found = [each for _, each in self._terms(y)]
        if self.torques:
            a, b, c, at = self.torques
            v, sdd = y[at + 1], y[at + 2]
            first, second = ({1: 2.0 * v}, {0: 1.0}), {(0, 0): {1: 2.0}}
            found.append(Combined((a, b), (sdd, v * v), (at + 1, at + 2), first, second, c, FAR))
        return found

    def _terms(self, y: np.ndarray) -> list[tuple[int, Combined]]:
        """Limited terms, each with the power of time in them."""
        at, (x, v, a, w, b) = self._pieces(y)
        one = np.ones((1, len(x) - 1))
        found = [(1, Combined((one,), (v[1:],), (at[1][1:],), ({0: 1.0},), {}, self.fastest[1:-1], 0.0))]
        for end, numbers, values in ((0, (0, 1, 2, 4), (x, v, a, b)), (1, (0, 3, 4, 2), (x, w, b, a))):
            numbers = tuple(at[k] for k in numbers)
            for name, terms in KINDS:
                if self.limited_joints[name].any():
                    rows = tuple(each[end] for each in self.rows[name])
                    found.append((ORDERS[name], terms(rows, numbers, *values, 1.0 - 2.0 * end)))
        return found


Rows = tuple[np.ndarray, ...]
Numbers = tuple[np.ndarray, ...]  # of the unknowns x; p = ṡ and c = s̈ at one end of a piece; e = s̈ at the other


def _velocity(
    rows: Rows, numbers: Numbers, x: np.ndarray, p: np.ndarray, c: np.ndarray, _: np.ndarray, sign: float
) -> Combined:
    """q̇ ± T q̈ / 3  with  q̈ = q' c + q'' p²."""
    h = sign * THIRD / x
    values = (p + h * c, h * p * p)
    first = ({0: -h * c / x, 1: -values[1] / x}, {0: 1.0, 1: 2.0 * h * p}, {0: h})
    second = {
        (0, 0): {0: 2.0 * h * c / x**2, 1: 2.0 * values[1] / x**2}, (0, 1): {1: -2.0 * h * p / x}, (0, 2): {0: -h / x},
        (1, 1): {1: 2.0 * h},
    }  # fmt: skip
    return Combined(rows[:2], values, numbers[:3], first, second)


def _acceleration(
    rows: Rows, numbers: Numbers, _x: np.ndarray, p: np.ndarray, c: np.ndarray, _e: np.ndarray, _s: float
) -> Combined:
    """q̈ = q' c + q'' p²."""
    return Combined(rows[:2], (c, p * p), numbers[1:3], ({1: 2.0 * p}, {0: 1.0}), {(0, 0): {1: 2.0}})


def _inner(
    rows: Rows, numbers: Numbers, x: np.ndarray, p: np.ndarray, c: np.ndarray, e: np.ndarray, sign: float
) -> Combined:
    """q̈ ± T q⃛ / 3  with  q⃛ = ± q' x (e - c) + 3 q'' p c + q''' p³."""
    h = sign * THIRD / x
    slope, cube = 3.0 * h * p, h * p**3
    values = (c + THIRD * (e - c), p * p + slope * c, cube)
    first = (
        {1: -slope * c / x, 2: -cube / x}, {1: 2.0 * p + 3.0 * h * c, 2: 3.0 * h * p * p}, {0: 1.0 - THIRD, 1: slope}, {0: THIRD},
    )  # fmt: skip
    second = {
        (0, 0): {1: 2.0 * slope * c / x**2, 2: 2.0 * cube / x**2}, (0, 1): {1: -3.0 * h * c / x, 2: -3.0 * h * p * p / x},
        (0, 2): {1: -slope / x}, (1, 1): {1: 2.0, 2: 6.0 * h * p}, (1, 2): {1: 3.0 * h},
    }  # fmt: skip
    return Combined(rows, values, numbers, first, second)


def _jerk(
    rows: Rows, numbers: Numbers, x: np.ndarray, p: np.ndarray, c: np.ndarray, e: np.ndarray, sign: float
) -> Combined:
    """q⃛ = ± q' x (e - c) + 3 q'' p c + q''' p³."""
    values = (sign * x * (e - c), 3.0 * p * c, p**3)
    first = ({0: sign * (e - c)}, {1: 3.0 * c, 2: 3.0 * p * p}, {0: -sign * x, 1: 3.0 * p}, {0: sign * x})
    second = {(0, 2): {0: -sign}, (0, 3): {0: sign}, (1, 1): {2: 6.0 * p}, (1, 2): {1: 3.0}}
    return Combined(rows, values, numbers, first, second)


KINDS = (("velocity", _velocity), ("acceleration", _acceleration), ("acceleration", _inner), ("jerk", _jerk))


def _start(use: PathUse, fastest: PathTiming, with_turns: bool, finer: int) -> tuple[np.ndarray, np.ndarray]:
    """Places s (m,), and durations of the pieces after them, ṡ and s̈ there (m, 3), of the shortest moving average within limits.

    The places are even in time between any two breaks of the path, where q''' jumps.
    """
    path, whole = use.path, float(fastest.durations.sum())
    times = np.concatenate([[0.0], np.cumsum(fastest.durations)])
    moving = np.stack([fastest.jerks / 6.0, 0.5 * fastest.accelerations, fastest.speeds[:-1], fastest.s[:-1]])
    at_rest = np.zeros((4, 1)), np.array([[0.0], [0.0], [0.0], [path.length]])
    position = PPoly(
        np.concatenate([at_rest[0], moving, at_rest[1]], axis=1), np.concatenate([[-4.0 * whole], times, [5.0 * whole]])
    )
    chain = [position.antiderivative(), position, position.derivative(), position.derivative(2)]

    def averaged(t: np.ndarray, window: float) -> list[np.ndarray]:
        return [(each(t + 0.5 * window) - each(t - 0.5 * window)) / window for each in chain]

    def duration(window: float) -> tuple[float, float, float]:
        # in the middle of even parts: at a place itself rounding may take s̈ from either side
        t = (np.arange(len(times)) + 0.5) / len(times) * (whole + window) - 0.5 * window
        s, speed, sdd, jerk = averaged(t, window)
        factor = use.slowing(s, speed, sdd, jerk, path.derivative(s, 3))
        return factor * (whole + window), window, factor

    _, window, factor = min(duration(whole * float(part)) for part in WINDOWS)
    t = np.linspace(-0.5 * window, whole + 0.5 * window, 4 * len(times))
    passed = averaged(t, window)[0]
    passes = np.interp(path.breaks, passed, t)
    share = np.diff(passes) / (passes[-1] - passes[0])
    least = np.clip(ALONG * whole / window, *LEAST)
    pieces = np.maximum(np.ceil(finer * max(PIECES * len(share), least) * share).astype(int), FEWEST)
    numbers = np.concatenate([[0], np.cumsum(pieces)])
    places = np.interp(np.arange(numbers[-1] + 1), numbers, passes)
    turns = np.interp(path.turns, passed, t)
    nearest = np.searchsorted(0.5 * (places[1:] + places[:-1]), turns)
    own = ~np.isin(nearest, numbers) & (np.diff(nearest, prepend=-1) > 0) & with_turns
    places[nearest[own]] = turns[own]
    s, speed, sdd, _ = averaged(places, window)
    s[numbers], s[nearest[own]] = path.breaks, path.turns[own]
    speed[[0, -1]] = sdd[[0, -1]] = 0.0
    return s, np.stack([np.append(factor * np.diff(places), 1.0), speed / factor, sdd / factor**2], axis=1)


def _through(s: np.ndarray, spans: np.ndarray) -> PathTiming:
    """The cubic spline s(t) with pieces of these durations (m - 1,), with ṡ = s̈ = 0 at both ends.

    It does not pass through the second place and the last but one: both move a little.
    """
    times = np.concatenate([[0.0], np.cumsum(spans)])
    through = np.delete(np.arange(len(s)), [1, len(s) - 2])
    knots, rest = (
        np.concatenate([times[:1], times[:1], times[:1], times, times[-1:], times[-1:], times[-1:]]),
        [(1, 0.0), (2, 0.0)],
    )
    spline = make_interp_spline(times[through], s[through], k=3, t=knots, bc_type=(rest, rest))
    s = s.copy()
    s[[1, -2]] = spline(times[[1, -2]])
    speed = np.append(np.append(0.0, spline(times[1:-1], 1)), 0.0)
    return PathTiming(s, np.maximum(speed, 0.0) ** 2, spans=spans)

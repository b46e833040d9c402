"""Motions through or near waypoints: splines with optimised knot times, a path by reachability, or parabolic blends."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError, check_known
from armwright.trajectory.knot_times import blend_intervals
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.path import JointPath
from armwright.trajectory.piecewise import PiecewiseMotion, PiecewisePolynomial
from armwright.trajectory.poses import check_limits, check_number
from armwright.trajectory.splines import CURVES, optimised_spline, spline
from armwright.trajectory.time_optimal.jerk_limited import has_jerk_limits, jerk_limited
from armwright.trajectory.time_optimal.motion import PathMotion
from armwright.trajectory.time_optimal.timing import PathTiming
from armwright.trajectory.time_optimal.whole_cells import WholeCells

CHOICES = ("fastest", *CURVES, "time_optimal", "parabolic")
FASTER = 0.98  # of the cubic spline's duration: jumps of acceleration are not worth less
CELLS = 100  # of a path with constant s̈ each, at least; between two waypoints 48
MANY = 300  # waypoints: a path within limits of jerk takes longer than a second to plan through more
COINCIDENT = 1e-12  # [rad | m] between waypoints that are one, by their size
KEPT = 1.0 + 1e-9  # share of a limit that rounding may use


@dataclass(frozen=True, eq=False)
class Waypoints(PiecewiseMotion):
    """Motion from the first waypoint to the last along a curve, by default as fast as the limits allow.

    | `curve`           | between waypoints             | continuous | at both ends                                     |
    |-------------------|-------------------------------|------------|--------------------------------------------------|
    | "fastest"         | as "time_optimal" or "cubic"  | as theirs  | rest; q̈ jumps there                              |
    | "time_optimal"    | a path, as fast as possible   | q, q̇       | rest; q̈ jumps there, and between                 |
    |                   | with a limit of jerk          | q, q̇, q̈    | rest, q̈ = 0                                      |
    | "cubic"           | third degree                  | q, q̇, q̈    | rest; q̈ jumps there                              |
    | "natural_cubic"   | third degree                  | q, q̇, q̈    | q̈ = 0; it begins and ends moving                 |
    | "quintic"         | fifth degree                  | up to q⁽⁴⁾ | rest, q̈ = 0                                      |
    | "natural_quintic" | fifth degree                  | up to q⁽⁴⁾ | q⁽³⁾ = q⁽⁴⁾ = 0; it begins and ends moving       |
    | "parabolic"       | straight lines, rounded off   | q, q̇       | rest; it passes inner waypoints at a distance    |

    "time_optimal" goes along the natural cubic spline over √|Δq| between waypoints [Lee1989], C², at the largest path speed
    within limits of velocity and acceleration [PhamPham2018], and of jerk: then q̈ is continuous, in a local optimum. "fastest" is
    that where it is more than 2 % faster than the cubic spline, without a `duration` that the spline can keep, without `times`,
    and through 300 waypoints at most where jerk is limited. Else it is the cubic spline. `curve` then says which.

    All but parabolic blends pass through all waypoints and may swing out between them; what leaves the limits of position is
    refused, with the joint and how far. Parabolic blends never leave the polygon's corners outwards, see `parabolic_blends`.

    Args:
        points: (k, n) [rad | m], two or more.
        limits: velocity, acceleration, jerk (not of parabolic blends), position; infinite ones do not count.
            None: `times` are needed, and no limit is kept.
        curve: as above.   times: (k,) [s] of the waypoints, from the first on, not of "time_optimal"; None: by the limits.
        duration: [s]; None: the shortest that was found.   time: [s] of the beginning; with `times` it is theirs.
    Attributes:
        passes: (k,) [s] times at the waypoints; of parabolic blends in the middle of each.
    Raises:
        ScenarioError: what are no waypoints, coincident ones, times that do not increase, limits that are exceeded or that
            bound nothing; names the waypoint, the joint and the numbers.
    Example:
        >>> points = [[0.0, 0.0], [0.5, -0.5], [1.0, 0.0]]
        >>> move = aw.trajectories.Waypoints(points, times=[0.0, 1.0, 2.0])
        >>> move.at([0.5, 1.0])[0].round(3)
        array([[ 0.156, -0.25 ],
               [ 0.5  , -0.5  ]])
    """

    points: Any
    limits: MotionLimits | None = None
    curve: Literal["fastest", "cubic", "natural_cubic", "quintic", "natural_quintic", "time_optimal", "parabolic"] = (
        "fastest"
    )
    times: Any = None
    duration: Any = None
    time: float = 0.0
    passes: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        points = _checked_points(self.points)
        check_known(ScenarioError, self.curve, CHOICES, "unknown", place="Waypoints.curve")
        if self.curve == "natural_quintic" and len(points) < 3:
            what, expected = "a natural quintic through two", "three or more, or another curve"
            raise ScenarioError(what, place="Waypoints.points", expected=expected)
        check_number("Waypoints", "time", self.time)
        if self.limits is not None:
            check_limits("Waypoints", self.limits)
            if points.shape[1] != self.limits.n:
                what = f"waypoints of {points.shape[1]} joints"
                raise ScenarioError(what, place="Waypoints.points", expected=f"{self.limits.n}, as limits has")
            self.limits.check_position("Waypoints.points", points)
        found = self._by_limits(points) if self.times is None else self._by_times(points)
        for name in ("curve", "passes"):
            object.__setattr__(self, name, getattr(found, name))
        object.__setattr__(self, "time", found.polynomial.time)
        object.__setattr__(self, "duration", found.polynomial.duration)
        self.set_polynomial(found.polynomial)
        if self.limits is not None and (error := _overswing_error(found, self.limits)) is not None:
            raise error

    def _by_limits(self, points: np.ndarray) -> _Found:
        """The fastest motion that was found, or one slowed to the given duration."""
        limits, moving = self.limits, np.ptp(points, axis=0) > 0.0
        if limits is None:
            raise ScenarioError("missing", place="Waypoints.limits", expected="limits, or times of the waypoints")
        bounds = [limits.velocity, limits.acceleration] + [limits.jerk] * (self.curve != "parabolic")
        if self.curve in ("parabolic", "time_optimal"):
            limits.required("acceleration", moving=moving)
        free = np.isinf(bounds).all(axis=0) & moving
        if free.any():
            names = ", ".join(limits.names[k] for k in np.flatnonzero(free))
            raise ScenarioError(f"nothing limits {names}", place="Waypoints.limits", expected="limits, or times")
        if self.duration is not None:
            check_number("Waypoints", "duration", self.duration, above=0.0)
        if self.curve == "parabolic":
            lengths = parabolic_lengths(points, limits)
            found = _blended(points, lengths, blend_durations(points, lengths, limits.acceleration))
        elif self.curve == "time_optimal":
            found = _along_path(points, limits)
        elif self.curve == "fastest":
            found = self._fastest(points, limits)
        else:
            found = _Found.spline(self.curve, optimised_spline(self.curve, points, limits))
        if self.duration is not None:
            shortest = found.polynomial.duration
            if self.duration < shortest * (1.0 - 1e-12):
                expected = f"{shortest:.6g} s or more, the shortest that was found within the limits"
                raise ScenarioError(place="Waypoints.duration", value=self.duration, expected=expected)
            found = found.scaled(self.duration / shortest)
        return found.delayed(float(self.time))

    def _fastest(self, points: np.ndarray, limits: MotionLimits) -> _Found:
        """The cubic spline, or the path where it is faster; see the class."""
        moving = np.ptp(points, axis=0) > 0.0
        cubic = _Found.spline("cubic", optimised_spline("cubic", points, limits))
        if np.isinf(limits.acceleration[moving]).any():
            return cubic
        is_within, longest = _overswing_error(cubic, limits) is None, cubic.polynomial.duration
        if is_within and self.duration is not None and longest <= self.duration:
            return cubic
        if is_within and len(points) > MANY and np.isfinite(limits.jerk[moving]).any():
            return cubic
        path = _along_path(points, limits)
        is_faster = path.polynomial.duration < FASTER * longest
        return path if (is_faster or not is_within) and _overswing_error(path, limits) is None else cubic

    def _by_times(self, points: np.ndarray) -> _Found:
        """The curve with the user's times, which must keep the limits."""
        times = _checked_times(self.times, len(points))
        if self.duration is not None:
            raise ScenarioError("with times", place="Waypoints.duration", expected="either")
        if self.curve == "time_optimal":
            expected = "another curve, or no times: they follow from the limits"
            raise ScenarioError("with times", place="Waypoints.curve", value=self.curve, expected=expected)
        if self.curve == "parabolic":
            if self.limits is None:
                raise ScenarioError(
                    "missing", place="Waypoints.limits", expected="an acceleration limit for the blends"
                )
            self.limits.required("acceleration", moving=np.ptp(points, axis=0) > 0.0)
            blends = blend_durations(points, np.diff(times), self.limits.acceleration)
            room = _room(np.diff(times))
            if (blends > room * KEPT).any():
                k = int(np.argmax(blends / room))
                what = f"turning there takes {blends[k]:.4g} s within the acceleration limits"
                raise ScenarioError(what, place=f"Waypoints.times[{k}]", expected=f"{room[k]:.4g} s at most: more time")
            found = _blended(points, np.diff(times), blends).delayed(times[0] - 0.5 * blends[0])
        else:
            curve = "cubic" if self.curve == "fastest" else self.curve
            found = _Found.spline(curve, spline(curve, times, points))
        if self.limits is not None:
            _check_use(found.polynomial, self.limits, jerk=self.curve != "parabolic")
        return found


@dataclass(frozen=True, eq=False)
class _Found:
    """A motion through waypoints.

    Attributes:
        curve: of `Waypoints`.   polynomial: the motion.   passes: (k,) [s] times at the waypoints.
        shape: the same curve in fewer pieces, with other speeds: its extrema of position are the motion's.
    """

    curve: str
    polynomial: PiecewisePolynomial
    passes: np.ndarray
    shape: PiecewisePolynomial

    @classmethod
    def spline(cls, curve: str, polynomial: PiecewisePolynomial) -> _Found:
        """A spline whose knots are the waypoints."""
        return cls(curve, polynomial, polynomial.knots, polynomial)

    def scaled(self, factor: float) -> _Found:
        """The motion from time 0 in `factor` times the duration."""
        return _Found(self.curve, self.polynomial.scaled(factor), factor * self.passes, self.shape.scaled(factor))

    def delayed(self, time: float) -> _Found:
        """The motion from time 0, shifted to begin at `time` [s]."""
        return _Found(self.curve, self.polynomial.delayed(time), time + self.passes, self.shape.delayed(time))


def _blended(points: np.ndarray, lengths: np.ndarray, blends: np.ndarray) -> _Found:
    """Parabolic blends from time 0; see `parabolic_blends`."""
    polynomial = parabolic_blends(points, lengths, blends)
    return _Found("parabolic", polynomial, 0.5 * blends[0] + np.append(0.0, np.cumsum(lengths)), polynomial)


def _along_path(points: np.ndarray, limits: MotionLimits) -> _Found:
    """The natural spline over √|Δq|, as fast as limits of velocity, acceleration and jerk allow, from time 0. [PhamPham2018]"""
    ways = np.sqrt(np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)))
    path = JointPath(points, np.append(0.0, np.cumsum(ways)))
    cells = WholeCells.of(path, limits, CELLS)
    timing = PathTiming(cells.s, cells.fastest((0.0, 0.0)), ramps=False)
    if has_jerk_limits(path, limits):
        timing = jerk_limited(path, limits, timing)[0]
    motion = PathMotion(path, timing.s, timing.x, 0.0, {}, 0.0, ramps=False, spans=timing.spans)
    passes = motion.breaks[np.searchsorted(timing.s, path.breaks)]
    rates = (np.diff(path.breaks) / np.diff(passes))[:, None, None]
    rows = path.curve.c[::-1].transpose(1, 2, 0)
    shape = PiecewisePolynomial(passes, rows * rates ** np.arange(rows.shape[2]))
    return _Found("time_optimal", motion.polynomial, passes, shape)


def _checked_points(value: Any) -> np.ndarray:
    """(k, n) waypoints, finite, each another than the one before."""
    points = scalar.numbers_or_nan(value).astype(float)
    if points.ndim != 2 or len(points) < 2 or not points.size:
        raise ScenarioError(place="Waypoints.points", value=value, expected="(k, n) numbers, two waypoints or more")
    wrong = np.argwhere(~np.isfinite(points))
    if len(wrong):
        k, joint = (int(at) for at in wrong[0])
        raise ScenarioError(
            place=f"Waypoints.points[{k}][{joint}]", value=float(points[k, joint]), expected="finite numbers"
        )
    same = np.abs(np.diff(points, axis=0)).max(axis=1) <= COINCIDENT * (1.0 + np.abs(points[1:]).max(axis=1))
    if same.any():
        k = int(np.argmax(same)) + 1
        expected = "another pose, or no such waypoint"
        raise ScenarioError(
            "the same pose as the waypoint before it, or as the start",
            place=f"Waypoints.points[{k}]",
            expected=expected,
        )
    return points


def _checked_times(value: Any, count: int) -> np.ndarray:
    """(k,) times, one a waypoint, finite and increasing."""
    times = scalar.numbers_or_nan(value).astype(float)
    if times.shape != (count,) or not np.isfinite(times).all():
        raise ScenarioError(
            place="Waypoints.times", value=value, expected=f"{count} finite numbers [s], one a waypoint"
        )
    late = np.flatnonzero(np.diff(times) <= 0.0)
    if len(late):
        k = int(late[0]) + 1
        what = f"not after {times[k - 1]:.10g} before it"
        raise ScenarioError(what, place=f"Waypoints.times[{k}]", value=float(times[k]), expected="times that increase")
    return times


def _check_use(polynomial: PiecewisePolynomial, limits: MotionLimits, *, jerk: bool) -> None:
    """Refuses a motion whose times are too short for its limits."""
    for order, quantity in enumerate(("velocity", "acceleration", "jerk")[: 2 + jerk], 1):
        used = polynomial.largest(order) / getattr(limits, quantity)
        joint = int(np.argmax(used))
        if used[joint] > KEPT:
            what = f"{limits.names[joint]} uses {used[joint]:.1%} of its {quantity} limit"
            expected = f"more time: {used[joint] ** (1.0 / order):.4g} times as much everywhere would do for that"
            raise ScenarioError(what, place="Waypoints.times", expected=expected)


def _overswing_error(found: _Found, limits: MotionLimits) -> ScenarioError | None:
    """The error for a curve that leaves the limits of position between its waypoints; None if it does not."""
    polynomial = found.shape
    low, high = polynomial.extrema(0)
    beyond = np.maximum(limits.position[:, 0] - low, high - limits.position[:, 1])
    piece, joint = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
    if beyond[piece, joint] <= 1e-9 * (1.0 + np.abs(limits.position[joint]).max()):
        return None
    where = f"between {polynomial.knots[piece]:.4g} s and {polynomial.knots[piece + 1]:.4g} s"
    unit = limits.unit("position", int(joint))
    what = f"the curve swings {beyond[piece, joint]:.4g} {unit} out of the limits of {limits.names[joint]} {where}"
    return ScenarioError(what, place="Waypoints.points", expected="waypoints further inside, or curve = 'parabolic'")


def parabolic_lengths(points: np.ndarray, limits: MotionLimits) -> np.ndarray:
    """(k - 1,) [s] segments between parabolic blends, as short as limits of speed and acceleration allow. [KunzStilman2011]

    Args:
        points: (k, n) [rad | m].   limits: acceleration, and perhaps velocity.
    """
    way = np.abs(np.diff(points, axis=0))
    least = (way / limits.velocity).max(axis=1)

    def scaled(lengths: np.ndarray) -> np.ndarray:
        """Lengths as they are, or as much longer as makes all blends fit and no segment too fast."""
        # blends shrink by the factor by which segments grow: what is too long fits then, exactly
        excess = (blend_durations(points, lengths, limits.acceleration) / _room(lengths)).max()
        return lengths * max(np.sqrt(excess), (least / lengths).max()) * (1.0 + 1e-14)

    lengths = scaled(np.maximum(least, np.sqrt((way / limits.acceleration).max(axis=1))))
    if len(points) > 2:
        lengths = blend_intervals(points, lengths, limits, scaled)
    return lengths


def _room(lengths: np.ndarray) -> np.ndarray:
    """(k,) [s] longest blend of each waypoint, half of it on either side: the shorter of both segments (k - 1,)."""
    return np.minimum(np.append(lengths, np.inf), np.append(np.inf, lengths))


def blend_durations(points: np.ndarray, lengths: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """(k,) [s] time in which the speed turns at each waypoint: Δv / a of the joint that needs longest.

    Args:
        points: (k, n) [rad | m].   lengths: (k - 1,) [s] of the segments.   acceleration: (n,) [rad/s² | m/s²].
    """
    speeds = np.diff(points, axis=0) / lengths[:, None]
    still = np.zeros((1, points.shape[1]))
    return (np.abs(np.diff(speeds, axis=0, prepend=still, append=still)) / acceleration).max(axis=1)


def parabolic_blends(points: np.ndarray, lengths: np.ndarray, blends: np.ndarray) -> PiecewisePolynomial:
    """Straight lines between waypoints with constant acceleration around each of them, from time 0. [KunzStilman2011]

    Waypoint i is where two lines would meet, half a blend after the blend's beginning: the motion passes it at the distance
    |Δv| blend / 8, and begins and ends in the first and the last one.

    Args:
        points: (k, n) [rad | m].   lengths: (k - 1,) [s] from waypoint to waypoint.   blends: (k,) [s].
    """
    speeds = np.diff(points, axis=0) / lengths[:, None]
    # else a line goes on straight, but for rounding
    blends = np.where(blends > COINCIDENT * lengths.sum(), blends, 0.0)
    still = np.zeros((1, points.shape[1]))
    before, after = np.concatenate([still, speeds]), np.concatenate([speeds, still])
    middle = 0.5 * blends[0] + np.append(0.0, np.cumsum(lengths))
    knots, rows = [], []
    for k, (point, blend) in enumerate(zip(points, blends, strict=True)):
        if blend > 0.0:
            knots.append(middle[k] - 0.5 * blend)
            rows.append([point - 0.5 * blend * before[k], before[k], 0.5 * (after[k] - before[k]) / blend])
        if k < len(lengths) and lengths[k] - 0.5 * (blend + blends[k + 1]) > COINCIDENT * lengths[k]:
            knots.append(middle[k] + 0.5 * blend)
            rows.append([point + 0.5 * blend * after[k], after[k], 0.0 * point])
    knots.append(middle[-1] + 0.5 * blends[-1])
    return PiecewisePolynomial(np.array(knots), np.array(rows).transpose(0, 2, 1))

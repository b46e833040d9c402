"""Motions of the tool along a path at an even speed, with smooth ends, slowed down where joints ask for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.scalar import Array, Scalar
from armwright.trajectory.cartesian.path import CartesianPath
from armwright.trajectory.cartesian.solve import ToolPathSolution, place, solve_path
from armwright.trajectory.cartesian.tool import Aim
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.motion import Motion
from armwright.trajectory.piecewise import PiecewisePolynomial
from armwright.trajectory.s_curve import JERK, s_curve_times

SAMPLES, IN_A_PIECE = 2000, 8  # places where limits are looked at: on the whole way, between two nodes of its spline
ROUNDS, JUST = 12, 1e-10  # refinements of those near the largest use; of a time: just beside it
SLOWEST = 100.0  # a motion that must be slower than asked by more is next to a singularity
MARGIN = 1e-7  # of limits, for what lies between those places
JERK_TIME = 0.1  # [s] in which an acceleration is reached where no jerk is given
ROUNDED = 1e-9  # of a limit


@dataclass(frozen=True, eq=False)
class CartesianMotion(Motion):
    """Motion of the joints that leads the tool along a path; made by `follow_path`.

    The way s(t) has constant jerk in each of seven segments between two stops; q = q(s), q̇ = q' ṡ, q̈ = q'' ṡ² + q' s̈.

    Attributes:
        solution: joint positions along the path.   profile: s(t) [m].
        slowed: factor by which the motion is slower than asked.   reasons: limits that asked for it, the hardest first.
    """

    solution: ToolPathSolution
    profile: PiecewisePolynomial
    slowed: float
    reasons: tuple[str, ...] = ()

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

    def at(self, t: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, q̇ and q̈, each (…, n) [rad | m, …/s, …/s²], at times t (…) [s]."""
        s, rate, change = (each[..., 0] for each in self.profile.at(t))
        q, first, second = self.solution.at(s)
        rate, change = rate[..., None], change[..., None]
        return q, first * rate, second * rate * rate + first * change

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at a time t [s], a number.

        Raises:
            ScenarioError: a symbol; its hundreds of polynomials are sampled, not traced.
        """
        if scalar.is_symbolic(t):
            expected = "a number; in a loop it is sampled at every tick"
            raise ScenarioError("cannot be traced", place="CartesianMotion", expected=expected)
        return self.at(t)


def follow_path(
    arm: Model,
    path: CartesianPath,
    speed: float,
    acceleration: float,
    *,
    jerk: float | None = None,
    angular_speed: float | None = None,
    angular_acceleration: float | None = None,
    limits: MotionLimits | None = None,
    constant: bool = False,
    near: Any = None,
    frame: str | None = None,
    aim: Aim = "pose",
    posture: Any = None,
    tolerance: float = 1e-6,
    time: float = 0.0,
) -> CartesianMotion:
    """Motion that leads the tool along a path at an even speed, from rest to rest between its stops.

    Where limits of the joints or of the tool would be exceeded, the whole motion is slower by one factor, or is refused with
    `constant`. One that would have to be slower by more than 100 is next to a singularity, and refused.

    Args:
        arm: the model.   path: of the tool.   speed: [m/s] of the tool.   acceleration: [m/s²] of the tool, centripetal included.
        jerk: [m/s³] along the way; None: the acceleration is reached in 0.1 s.
        angular_speed: [rad/s] of the tool; None: no limit.   angular_acceleration: [rad/s²]; both are needed for turns in place.
        limits: position, velocity, acceleration and jerk of the joints; None: the record's.
        constant: whether the speed that is asked for must be kept.   time: [s] of the beginning.
        near: (n,) positions [rad | m] to begin near.   frame: of the arm that is led; None: its tip.
        aim: "pose", or "position", which leaves the rotation free.   posture: (n,) [rad | m] for a redundant arm's self-motion.
        tolerance: [m] and [rad] of the tool from its path.
    Returns:
        motion: of the joints; it says by how much it is slower than asked, and for which limits.
    Raises:
        ScenarioError: as `solve_path`; a limit exceeded with `constant`; a speed that singularity forbids: where, which joint,
            which speed it would need.   ModelError: no such frame or aim.
    """
    asked = {"speed": speed, "acceleration": acceleration, "jerk": jerk, "angular_speed": angular_speed}
    asked["angular_acceleration"] = angular_acceleration
    values = {name: _above_zero(name, value, name in ("speed", "acceleration")) for name, value in asked.items()}
    begin = scalar.real_number(time)
    if begin is None or not np.isfinite(begin):
        raise ScenarioError(place="time", value=time, expected="a finite number [s]")
    limits = MotionLimits.of(arm) if limits is None else limits
    solution = solve_path(
        arm, path, near=near, frame=frame, aim=aim, posture=posture, limits=limits, tolerance=tolerance
    )  # fmt: skip
    profile = _profile(path, values, begin, 1.0)
    uses = _uses(solution, profile, limits, values)
    hardest = max(uses, key=lambda each: each.slower) if uses else None
    slowed = 1.0
    if hardest is not None and hardest.slower > 1.0 + ROUNDED:
        slowed = hardest.slower * (1.0 + MARGIN)
        if constant or slowed > SLOWEST:
            near_one = slowed > SLOWEST and hardest.joint
            what = f"{'next to a singularity, ' if near_one else ''}{hardest.what}"
            slower = f"a speed of {values['speed'] / slowed:.3g} m/s or less there, or another path"
            raise ScenarioError(what, place=place(path, hardest.s), expected=slower)
        profile = _profile(path, values, begin, slowed)
    reasons = sorted((each for each in uses if each.slower > 1.0 + ROUNDED), key=lambda each: -each.slower)
    return CartesianMotion(solution, profile, slowed, tuple(f"{place(path, e.s)}: {e.what}" for e in reasons))


@dataclass(frozen=True)
class _Use:
    """A limit, where most of it is used, and by which factor the motion must be slower for it."""

    slower: float
    s: float
    what: str
    joint: bool


def _above_zero(name: str, value: Any, needed: bool) -> float:
    number = scalar.real_number(value)
    if value is None and not needed:
        return np.inf
    if number is None or not 0.0 < number < np.inf:
        raise ScenarioError(place=name, value=value, expected="a number above 0")
    return number


def _profile(path: CartesianPath, values: dict[str, float], time: float, slowed: float) -> PiecewisePolynomial:
    """s(t) of all runs behind each other.

    Raises:
        ScenarioError: a turn in place without limits for it.
    """
    knots, rows = [np.array([time])], []
    for begin, end in path.runs:
        names = ("speed", "acceleration")
        if not path.points(np.array([0.5 * (begin + end)])).first[0, :3].any():  # a turn in place
            names = ("angular_speed", "angular_acceleration")
            for name in names:
                if not np.isfinite(values[name]):
                    expected = "a number, as the tool turns in place"
                    raise ScenarioError("missing", place=name, expected=f"{expected}: {place(path, begin)}")
        v, a = (values[name] for name in names)
        j = values["jerk"] / values["acceleration"] * a if np.isfinite(values["jerk"]) else a / JERK_TIME
        times = s_curve_times(end - begin, v, a, j) * slowed
        derivative = np.zeros((7, 3))
        ramp, flat, _, cruise, *_ = times
        derivative[:, -1] = JERK * (end - begin) / (ramp * (ramp + flat) * (2.0 * ramp + flat + cruise))
        run = PiecewisePolynomial.of_segments(float(knots[-1][-1]), times, derivative, begin)
        knots.append(run.knots[1:])
        rows.append(run.coefficients)
    return PiecewisePolynomial(np.concatenate(knots), np.concatenate(rows))


def _uses(
    solution: ToolPathSolution, profile: PiecewisePolynomial, limits: MotionLimits, values: dict[str, float]
) -> list[_Use]:
    """The limits and how much of each the motion uses, the largest use of all to 1e-8 of it."""
    motion = CartesianMotion(solution, profile, 1.0)
    places = [
        begin + np.linspace(run.breaks[:-1], run.breaks[1:], IN_A_PIECE).ravel()
        for (begin, _), run in zip(solution.path.runs, solution.runs, strict=True)
    ]
    begin, end = motion.time, motion.time + motion.duration
    t = np.concatenate([motion.times(np.concatenate(places)), np.linspace(begin, end, SAMPLES), motion.breaks])
    t = np.unique(np.concatenate([t, t * (1.0 - JUST), t * (1.0 + JUST)]).clip(begin, end))  # both sides of a jump
    columns = _columns(motion, limits, values, t)
    for _ in range(ROUNDS):
        if not columns:
            return []
        used = np.max([column.slower for column in columns], axis=0)
        bend = np.abs(np.diff(used, 2, prepend=used[0], append=used[-1]))
        reachable = np.maximum(used[:-1], used[1:]) + np.maximum(bend[:-1], bend[1:])  # between two points, by far
        coarse = np.flatnonzero((reachable > used.max() * (1.0 + 0.1 * MARGIN)) & (np.diff(t) > JUST * motion.duration))
        if not len(coarse):
            break
        coarse = coarse[np.argsort(-reachable[coarse])[:SAMPLES]]
        t = np.unique(np.concatenate([t, np.linspace(t[coarse], t[coarse + 1], 8)[1:-1].ravel()]))
        columns = _columns(motion, limits, values, t)
    s = profile.at(t)[0][:, 0]
    return [
        _Use(float(c.slower.max()), float(s[c.slower.argmax()]), c.said(int(c.slower.argmax())), c.joint)
        for c in columns
    ]


@dataclass(frozen=True, eq=False)
class _Column:
    """Use of one limit at many times: the factor (k,) by which the motion must be slower for it."""

    what: str
    unit: str
    values: np.ndarray
    limit: float
    power: int  # of the time, in the quantity
    joint: bool

    @property
    def slower(self) -> np.ndarray:
        return (self.values / self.limit) ** (1.0 / self.power)

    def said(self, k: int) -> str:
        return f"{self.what.format(f'{self.values[k]:.4g} {self.unit}')}, its limit is {self.limit:.4g}"


def _columns(motion: CartesianMotion, limits: MotionLimits, values: dict[str, float], t: np.ndarray) -> list[_Column]:
    """Uses of all limits that there are at times t (k,)."""
    (s, rate, change), jerk = (each[:, 0] for each in motion.profile.at(t)), motion.profile.derivative().at(t)[2][:, 0]
    _, qd, qdd = motion.at(t)
    third = motion.solution.third(s)
    _, first, second = motion.solution.at(s)
    qddd = third * rate[:, None] ** 3 + 3.0 * second * (rate * change)[:, None] + first * jerk[:, None]
    columns = []
    for power, quantity, rows in ((1, "velocity", qd), (2, "acceleration", qdd), (3, "jerk", qddd)):
        word = "speed" if quantity == "velocity" else quantity
        for joint in np.flatnonzero(np.isfinite(getattr(limits, quantity))):
            what = f"joint {limits.names[joint]!r} would need {{}} of {word}"
            unit, limit = limits.unit(quantity, int(joint)), float(getattr(limits, quantity)[joint])
            columns.append(_Column(what, unit, np.abs(rows[:, joint]), limit, power, True))
    points = motion.path.points(s)
    twist = points.first * rate[:, None]
    accelerations = points.second * rate[:, None] ** 2 + points.first * change[:, None]
    tool = {
        "acceleration": (2, accelerations[:, :3], "m/s²"),
        "angular_speed": (1, twist[:, 3:], "rad/s"),
        "angular_acceleration": (2, accelerations[:, 3:], "rad/s²"),
    }
    for name, (power, rows, unit) in tool.items():
        if np.isfinite(values[name]) and (name == "acceleration" or motion.solution.tool.aim == "pose"):
            what = f"the tool's {name.replace('_', ' ')} would be {{}}"
            columns.append(_Column(what, unit, np.linalg.norm(rows, axis=1), values[name], power, False))
    return columns

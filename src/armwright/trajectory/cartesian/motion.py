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

SAMPLES = 4000  # of a run, for its limits
IN_A_PIECE = 12  # and between two nodes of its spline
SLOWEST = 100.0  # a motion that must be slower than asked by more is next to a singularity
MARGIN = 1e-7  # of limits, for what lies between samples
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
    """The limits and how much of each the motion uses, on a dense grid of times."""
    motion = CartesianMotion(solution, profile, 1.0)
    path = solution.path
    nodes = np.concatenate([
        begin + np.linspace(run.breaks[:-1], run.breaks[1:], IN_A_PIECE, endpoint=False).ravel()
        for (begin, _), run in zip(path.runs, solution.runs, strict=True)
    ])  # fmt: skip
    t = np.unique(np.concatenate([np.linspace(0.0, 1.0, SAMPLES) * motion.duration + motion.time, motion.times(nodes)]))
    s, rate, change = (each[:, 0] for each in profile.at(t))
    _, qd, qdd = motion.at(t)
    step = np.maximum(np.diff(t), 1e-9 * motion.duration)[:, None]
    jerks = np.where(np.diff(t)[:, None] > 1e-6 * motion.duration, np.diff(qdd, axis=0) / step, 0.0)
    uses = []
    for power, quantity, rows in ((1, "velocity", qd), (2, "acceleration", qdd), (3, "jerk", jerks)):
        most = getattr(limits, quantity)
        share = np.abs(rows) / most
        for joint in np.flatnonzero(np.isfinite(most)):
            k = int(share[:, joint].argmax())
            unit = limits.unit(quantity, int(joint))
            name = limits.names[joint]
            used = f"{abs(rows[k, joint]):.4g} {unit} of {'speed' if quantity == 'velocity' else quantity}"
            what = f"joint {name!r} would need {used}, its limit is {most[joint]:.4g}"
            uses.append(_Use(float(share[k, joint] ** (1.0 / power)), float(s[k]), what, True))
    points = path.points(s)
    first, second = points.first, points.second
    accelerations = second * rate[:, None] ** 2 + first * change[:, None]
    tool = {
        "acceleration": (2, np.linalg.norm(accelerations[:, :3], axis=1), "m/s²"),
        "angular_speed": (1, np.linalg.norm(first[:, 3:], axis=1) * rate, "rad/s"),
        "angular_acceleration": (2, np.linalg.norm(accelerations[:, 3:], axis=1), "rad/s²"),
    }
    for name, (power, used, unit) in tool.items():
        if np.isfinite(values[name]) and (name == "acceleration" or solution.tool.aim == "pose"):
            k = int(used.argmax())
            what = f"the tool's {name.replace('_', ' ')} would be {used[k]:.4g} {unit}, its limit is {values[name]:.4g}"
            uses.append(_Use(float((used[k] / values[name]) ** (1.0 / power)), float(s[k]), what, False))
    return uses

"""Motions of the tool along a path at constant speed, with smooth ends, slowed down to keep limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from armwright import scalar
from armwright.entry import AnyArm, as_arm, expect
from armwright.errors import ScenarioError, check_known
from armwright.kinematics.forward_kinematics import forward_kinematics
from armwright.model import Model
from armwright.trajectory.cartesian.motion import CartesianMotion, SlowStretch
from armwright.trajectory.cartesian.path import CartesianPath
from armwright.trajectory.cartesian.slowing import Pace, locally_slowed
from armwright.trajectory.cartesian.solve import ToolPathSolution, checked_limits, past_limits, place, solve_path
from armwright.trajectory.cartesian.tool import Tool
from armwright.trajectory.cartesian.uses import MARGIN, uses_of
from armwright.trajectory.limits import LARGEST, SMALLEST, MotionLimits
from armwright.trajectory.piecewise import LAST, PiecewisePolynomial
from armwright.trajectory.s_curve import s_curve_jerks, s_curve_times

SLOWEST = 100.0  # a motion that must be slower than requested by more is next to a singularity
CHECKED = 2000  # places of a given solution at which it is compared with limits of position
SAME = 1e-9  # [m] between poses of two models that are one arm
JERK_TIME = 0.1  # [s] in which an acceleration is reached where no jerk is given
Slow = Literal["everywhere", "where needed", "nowhere"]
SLOW = get_args(Slow)


@dataclass(frozen=True)
class ToolLimits:
    """Limits of a tool's motion along its path, beside its speed and its acceleration.

    Args:
        jerk: [m/s³] along the way; absent: the acceleration is reached in 0.1 s.
        angular_speed: [rad/s]; absent: no limit.   angular_acceleration: [rad/s²]; both are needed for turns in place.
    Raises:
        ScenarioError: names the limit, its value and what was expected.
    Example:
        >>> limits = aw.trajectories.ToolLimits(angular_speed=1.0)  # of `follow_path`
        >>> limits.angular_speed
        1.0
    """

    jerk: float | None = None
    angular_speed: float | None = None
    angular_acceleration: float | None = None

    def __post_init__(self) -> None:
        _ = self.values

    @property
    def values(self) -> dict[str, float]:
        """The limits by name; infinite: none."""
        return {name: np.inf if value is None else _above_zero(name, value) for name, value in vars(self).items()}


def follow_path(
    arm: AnyArm,
    path: CartesianPath | ToolPathSolution,
    speed: float,
    acceleration: float,
    *,
    near: Any = None,
    limits: MotionLimits | None = None,
    tool: ToolLimits = ToolLimits(),
    slow: Slow = "everywhere",
    time: float = 0.0,
) -> CartesianMotion:
    """Joint motion that moves the tool along a path at constant speed, from rest to rest between its stops.

    Where limits of the joints or of the tool would be exceeded, the whole motion is slower by one factor; with
    `slow="where needed"` the tool is slower there and about there alone, and with "nowhere" the motion is refused. It tells
    where and by how much. One that would have to be slower by more than 100 is next to a singularity, and refused.

    Args:
        arm: the model.   path: of the tool's tip in all of its pose; or a solution of `solve_path`, which leads another frame,
            counts a part of the pose, or keeps clear of obstacles.
        speed: [m/s] of the tool.   acceleration: [m/s²] of the tool, centripetal included.
        near: (n,) positions [rad | m] to begin near.
        limits: position, velocity, acceleration and jerk of the joints; None: the record's.
        tool: its jerk, its angular speed and acceleration.
        slow: what is slower where a limit would be exceeded: "everywhere", "where needed", or "nowhere": it is refused.
        time: [s] of the beginning.
    Returns:
        motion: of the joints; it says where and by how much the speed is too high, and for which limits.
    Raises:
        ScenarioError: as `solve_path`; a limit exceeded with "nowhere"; a speed that singularity forbids: where, which joint,
            which speed it would need.   ModelError: no arm.
    Example:
        >>> arm, q = aw.load("ur5e"), [0.0, -1.0, 1.2, -0.5, 0.8, 0.0]
        >>> start = aw.forward_kinematics(arm, q)
        >>> line = aw.trajectories.Line(start[:3, 3] + [0.0, 0.1, 0.0])
        >>> path = aw.trajectories.CartesianPath([line], start)
        >>> motion = aw.trajectories.follow_path(arm, path, speed=0.1, acceleration=0.5, near=q)
        >>> round(float(motion.duration), 2)
        1.3
    """
    arm = as_arm(arm)
    expect(tool, ToolLimits, "tool", "an aw.trajectories.ToolLimits", ScenarioError)
    asked = {"speed": speed, "acceleration": acceleration}
    values = {name: _above_zero(name, value) for name, value in asked.items()} | tool.values
    begin = scalar.real_number(time)
    if begin is None or not np.isfinite(begin):
        raise ScenarioError(place="time", value=time, expected="a finite number [s]")
    check_known(ScenarioError, slow, SLOW, place="slow")
    limits = checked_limits(arm, limits)
    solution = _solved(arm, path, near, limits)
    path = solution.path
    paces = [_pace(path, values, *run) for run in path.runs]
    profile = _profile(path, paces, begin, 1.0)
    uses = uses_of(solution, profile, limits, values)
    hardest = uses.hardest()
    if not hardest:
        return CartesianMotion(solution, profile, 1.0)
    slowed, worst, row = hardest[0]
    if slow == "nowhere" or slowed > SLOWEST:
        near_one = slowed > SLOWEST and worst.joint
        what = f"{'next to a singularity, ' if near_one else ''}{worst.said(row)}"
        slower = f"a speed of {values['speed'] / slowed:.3g} m/s or less there, or another path"
        raise ScenarioError(what, place=place(path, float(uses.s[row])), expected=slower)
    reasons = tuple(f"{place(path, float(uses.s[k]))}: {column.said(k)}" for _, column, k in hardest)
    stretches = tuple(SlowStretch(*each) for each in uses.stretches())
    slowed *= 1.0 + MARGIN
    profile = _profile(path, paces, begin, slowed)
    if slow == "where needed":
        local, whole = locally_slowed(solution, limits, values, paces, begin)
        if local.duration < profile.duration:
            profile, slowed = local, max(slowed, whole)
    return CartesianMotion(solution, profile, slowed, reasons, stretches)


def _solved(arm: Model, path: Any, near: Any, limits: MotionLimits) -> ToolPathSolution:
    """The path's solution, or the given one.

    Raises:
        ScenarioError: as `solve_path`; a solution of another arm, beyond limits of position, or one that is to begin elsewhere.
    """
    if not isinstance(path, ToolPathSolution):
        return solve_path(arm, path, near=near, limits=limits)
    s = np.linspace(0.0, path.path.length, CHECKED)
    q = path.at(s)[0]
    if path.tool.arm.names != arm.names or not _alike(arm, path.tool, q[:: CHECKED // 4]):
        what, expected = f"solved for {path.tool.arm.name}", f"a path, or one that is solved for {arm.name}"
        raise ScenarioError(what, place="path", expected=expected)
    if near is not None:
        expected = "none beside a solved path, which begins where solve_path(…, near=…) began it"
        raise ScenarioError(place="near", value=near, expected=expected)
    outside = past_limits(path.path, limits, s, q)
    if outside is not None:
        raise outside.error
    return path


def _alike(arm: Model, tool: Tool, positions: np.ndarray) -> bool:
    """True if the tools of another model and of the arm have equal poses at positions (k, n)."""
    poses = ([forward_kinematics(each, q, frame=tool.frame) for q in positions] for each in (arm, tool.arm))
    return np.allclose(*poses, rtol=0.0, atol=SAME)


def _above_zero(name: str, value: Any) -> float:
    number = scalar.real_number(value)
    if number is None or not SMALLEST <= number <= LARGEST:
        expected = "a number above 0" if number is None or number <= 0.0 else f"{SMALLEST:g} … {LARGEST:g}"
        raise ScenarioError(place=name, value=value, expected=expected)
    return number


def _pace(path: CartesianPath, values: dict[str, float], begin: float, end: float) -> Pace:
    """Speed, acceleration and jerk of a run between two places.

    Raises:
        ScenarioError: a turn in place without limits for it.
    """
    names = ("speed", "acceleration")
    if not path.points(np.array([0.5 * (begin + end)])).first[0, :3].any():  # a turn in place
        names = ("angular_speed", "angular_acceleration")
        for name in names:
            if not np.isfinite(values[name]):
                expected = "a number, as the tool turns in place"
                raise ScenarioError("missing", place=name, expected=f"{expected}: {place(path, begin)}")
    v, a = (values[name] for name in names)
    return Pace(v, a, values["jerk"] / values["acceleration"] * a if np.isfinite(values["jerk"]) else a / JERK_TIME)


def _profile(path: CartesianPath, paces: list[Pace], time: float, slowed: float) -> PiecewisePolynomial:
    """s(t) of all runs behind each other, each in seven segments of constant jerk."""
    knots, rows = [np.array([time])], []
    for (begin, end), pace in zip(path.runs, paces, strict=True):
        times = s_curve_times(end - begin, pace.speed, pace.acceleration, pace.jerk) * slowed
        if not time + times.sum() <= LAST:
            expected = f"one by which the path ends within {LAST:.0e} s"
            raise ScenarioError(
                f"it ends at {time + times.sum():.3g} s", place="speed", value=pace.speed, expected=expected
            )
        jerks = s_curve_jerks(end - begin, times)
        run = PiecewisePolynomial.of_segments(float(knots[-1][-1]), times, jerks, begin)
        knots.append(run.knots[1:])
        rows.append(run.coefficients)
    return PiecewisePolynomial(np.concatenate(knots), np.concatenate(rows))

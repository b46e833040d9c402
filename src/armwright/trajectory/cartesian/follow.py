"""Motions of the tool along a path at constant speed, with smooth ends, slowed down to keep limits."""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np

from armwright import scalar
from armwright.collision import Clearance
from armwright.entry import AnyArm, as_arm
from armwright.errors import ScenarioError
from armwright.kinematics.aim import Aim
from armwright.trajectory.cartesian.motion import CartesianMotion, SlowStretch
from armwright.trajectory.cartesian.path import CartesianPath
from armwright.trajectory.cartesian.slowing import Pace, locally_slowed
from armwright.trajectory.cartesian.solve import checked_limits, place, solve_path
from armwright.trajectory.cartesian.uses import MARGIN, uses_of
from armwright.trajectory.limits import LARGEST, SMALLEST, MotionLimits
from armwright.trajectory.piecewise import LAST, PiecewisePolynomial
from armwright.trajectory.s_curve import JERK, s_curve_times

SLOWEST = 100.0  # a motion that must be slower than requested by more is next to a singularity
JERK_TIME = 0.1  # [s] in which an acceleration is reached where no jerk is given
Slow = Literal["everywhere", "where needed"]
SLOW = get_args(Slow)


def follow_path(
    arm: AnyArm,
    path: CartesianPath,
    speed: float,
    acceleration: float,
    *,
    jerk: float | None = None,
    angular_speed: float | None = None,
    angular_acceleration: float | None = None,
    limits: MotionLimits | None = None,
    slow: Slow = "everywhere",
    constant: bool = False,
    near: Any = None,
    frame: str | None = None,
    aim: str | Aim = "pose",
    posture: Any = None,
    tolerance: float = 1e-6,
    time: float = 0.0,
    clearance: Clearance | None = None,
) -> CartesianMotion:
    """Joint motion that moves the tool along a path at constant speed, from rest to rest between its stops.

    Where limits of the joints or of the tool would be exceeded, the whole motion is slower by one factor; with
    `slow="where needed"` the tool is slower there and about there alone, and with `constant` the motion is refused. It tells
    where and by how much. One that would have to be slower by more than 100 is next to a singularity, and refused.

    Args:
        arm: the model.   path: of the tool.   speed: [m/s] of the tool.   acceleration: [m/s²] of the tool, centripetal included.
        jerk: [m/s³] along the way; None: the acceleration is reached in 0.1 s.
        angular_speed: [rad/s] of the tool; None: no limit.   angular_acceleration: [rad/s²]; both are needed for turns in place.
        limits: position, velocity, acceleration and jerk of the joints; None: the record's.
        slow: what is slower where a limit would be exceeded: "everywhere" or "where needed".
        constant: whether the speed that is asked for must be kept.   time: [s] of the beginning.
        near: (n,) positions [rad | m] to begin near.   frame: of the arm that is led; None: its tip.
        aim: part of the path's poses that counts, as in `solve_path`.
        posture: (n,) [rad | m] for a redundant arm's self-motion.
        tolerance: [m] and [rad] of the tool from its path.   clearance: of the arm, whose least distance is kept.
    Returns:
        motion: of the joints; it says where and by how much the speed is too high, and for which limits.
    Raises:
        ScenarioError: as `solve_path`; a limit exceeded with `constant`; a speed that singularity forbids: where, which joint,
            which speed it would need.   ModelError: no such frame or aim.
    """
    arm = as_arm(arm)
    asked = {"speed": speed, "acceleration": acceleration, "jerk": jerk, "angular_speed": angular_speed}
    asked["angular_acceleration"] = angular_acceleration
    values = {name: _above_zero(name, value, name in ("speed", "acceleration")) for name, value in asked.items()}
    begin = scalar.real_number(time)
    if begin is None or not np.isfinite(begin):
        raise ScenarioError(place="time", value=time, expected="a finite number [s]")
    if slow not in SLOW:
        raise ScenarioError(place="slow", value=slow, choices=SLOW)
    limits = checked_limits(arm, limits)
    solution = solve_path(
        arm, path, near=near, frame=frame, aim=aim, posture=posture, limits=limits, tolerance=tolerance, clearance=clearance
    )  # fmt: skip
    paces = [_pace(path, values, *run) for run in path.runs]
    profile = _profile(path, paces, begin, 1.0)
    uses = uses_of(solution, profile, limits, values)
    hardest = uses.hardest()
    if not hardest:
        return CartesianMotion(solution, profile, 1.0)
    slowed, worst, row = hardest[0]
    if constant or slowed > SLOWEST:
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


def _above_zero(name: str, value: Any, needed: bool) -> float:
    number = scalar.real_number(value)
    if value is None and not needed:
        return np.inf
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
        derivative = np.zeros((7, 3))
        ramp, flat, _, cruise, *_ = times
        derivative[:, -1] = JERK * (end - begin) / (ramp * (ramp + flat) * (2.0 * ramp + flat + cruise))
        run = PiecewisePolynomial.of_segments(float(knots[-1][-1]), times, derivative, begin)
        knots.append(run.knots[1:])
        rows.append(run.coefficients)
    return PiecewisePolynomial(np.concatenate(knots), np.concatenate(rows))

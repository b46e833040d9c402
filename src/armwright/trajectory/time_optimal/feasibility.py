"""Reasons for infeasible problems: the place on the path, the joint, and the excess."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.trajectory.efforts import is_massless, without_constants
from armwright.trajectory.keep_clear import check_arm, nearest_along, too_near
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.path import JointPath
from armwright.trajectory.time_optimal.constraints import UNBOUNDED
from armwright.trajectory.time_optimal.planner import MOST, Planner, Profile

ROUNDING = 1e-9  # of a limit
PLACES = 2000  # of a path, where distances are computed at first
CREEPING = 1e-3  # of the median speed that accelerations reach over one piece: nearly at rest, with all of its friction


def squared_speeds(speeds: Any) -> tuple[float, float]:
    """ṡ² at both ends.

    Raises:
        ScenarioError: no two numbers of 0 or more.
    """
    values = scalar.numbers_or_nan(speeds)
    if values.shape != (2,) or not (np.isfinite(values) & (values >= 0.0)).all():
        raise ScenarioError(place="speeds", value=speeds, expected="two path speeds of 0 or more, at both ends")
    return float(values[0] ** 2), float(values[1] ** 2)


def check_limits(arm: Model, limits: MotionLimits, path: JointPath, rms_torque: np.ndarray) -> None:
    """Refuses limits that the record is too incomplete for or the planner does not support, and motions without any bound.

    Args:
        arm: the model.   limits: of its joints.   path: q(s).   rms_torque: (n,) [N m | N] of the motors; infinite: no limit.
    Raises:
        ScenarioError: names the quantity and the joints.
    """
    moving = np.ptp(np.asarray(path.waypoints), axis=0) > 0.0
    dark = without_constants(arm)
    light, unknown = "links without masses" if is_massless(arm) else "", f"no motor constants of {', '.join(dark)}"
    for place, values, lacks in (
        ("limits.torque", limits.torque, light),
        ("rms_torque", rms_torque, light),
        ("limits.voltage", limits.voltage, light or (unknown if dark else "")),
    ):
        if lacks and np.isfinite(values).any():
            expected = f"a record that can tell it, or {place.removeprefix('limits.')} = inf"
            raise ScenarioError(f"the record of {arm.name} has {lacks}", place=place, expected=expected)
    bounded = np.isfinite([limits.acceleration, limits.torque, limits.voltage]).any(axis=0)
    if not (moving & bounded).any():
        free = ", ".join(name for name, moves in zip(limits.names, moving, strict=True) if moves)
        expected = "a limit of acceleration, torque or voltage, in the record or as an argument"
        raise ScenarioError(f"nothing bounds the acceleration of {free}", place="limits", expected=expected)


def check_positions(limits: MotionLimits, path: JointPath) -> None:
    """Refuses paths that leave the position limits, between waypoints too.

    Raises:
        ScenarioError: names the joint, the place and how far it is outside.
    """
    s, q = path.extremes()
    beyond = np.stack([limits.position[:, 0] - q[:, 0], q[:, 1] - limits.position[:, 1]], axis=1)
    joint, side = np.unravel_index(int(beyond.argmax()), beyond.shape)
    if beyond[joint, side] > ROUNDING * max(1.0, abs(q[joint, side])):
        unit, (low, high) = limits.unit("position", int(joint)), limits.position[joint]
        raise ScenarioError(
            f"{limits.names[joint]} is {beyond[joint, side]:.4g} {unit} outside its limits",
            place=f"path at s = {s[joint, side]:.6g} of {path.length:.6g}", expected=f"{low:.6g} … {high:.6g} {unit}",
        )  # fmt: skip


def check_distances(arm: Model, clearance: Any, path: JointPath) -> None:
    """Refuses paths on which the arm comes nearer to itself or an obstacle than the least distance of a clearance.

    Raises:
        ScenarioError: names the two, the place and the distance.
    """
    check_arm(clearance, arm)
    places = np.union1d(np.linspace(0.0, path.length, PLACES), path.breaks)
    found, s = nearest_along(clearance, lambda s: path.at(s)[0], places)
    error = too_near(clearance, found)
    if error is not None:
        raise error.within(f"path at s = {s:.6g} of {path.length:.6g}")


def check_holding(planner: Planner) -> None:
    """Refuses paths on which the motors cannot hold the arm at rest.

    Raises:
        ScenarioError: names the joint, the place, the torque and what the limits allow.
    """
    error = _too_weak(planner, 0.0, f"to hold {_loads(planner)} alone")
    if error is not None:
        raise error


def no_way(planner: Planner, profile: Profile) -> ScenarioError:
    """The reason why no motion along the path is feasible.

    Args:
        planner: of the path.   profile: that got stuck.
    """
    k = int(profile.stuck or 0)
    if 0.0 <= profile.highest_first < planner.ends[0]:
        return too_fast(planner.ends, 0, profile.highest_first)
    if (highest := planner.highest_last()) < planner.ends[1]:
        return too_fast(planner.ends, 1, highest)
    return too_weak_to_move(planner) or ScenarioError(
        "no motion within the limits leads on from here", place=_place(planner, k), value=planner.points.q[k],
        expected="other limits or another path",
    )  # fmt: skip


def too_fast(ends: tuple[float, float], end: int, highest: float) -> ScenarioError:
    """The error for a path speed at one end that the limits do not allow.

    Args:
        ends: ṡ² at both.   end: 0 or 1.   highest: ṡ² that is allowed there.
    """
    what = (
        "from this path speed at the beginning the limits cannot be kept to the end",
        "this path speed at the end is not reached within the limits",
    )[end]
    expected = f"{np.sqrt(max(highest, 0.0)):.5g} or less"
    return ScenarioError(what, place=f"speeds[{end}]", value=float(np.sqrt(ends[end])), expected=expected)


def too_weak_to_move(planner: Planner) -> ScenarioError | None:
    """The error for a motor too weak to move the arm along the path even slowly; None if all are strong enough."""
    whole = {name: np.ones_like(each) for name, each in planner.shares.items()}
    high = planner.points.bounds(np.zeros((len(planner.s), 1)), whole)[1]
    x = CREEPING**2 * float(np.median(np.clip(high, 0.0, MOST))) * planner.path.length / len(planner.s)
    return _too_weak(planner, x, f"to move {_loads(planner)} and friction, however slowly,")


def _too_weak(planner: Planner, x: float, what: str) -> ScenarioError | None:
    """The error that a motor is too weak for a constant, small path speed √x, where it is by most; None where all can do it."""
    points = planner.points
    if not points.has_torques:
        return None
    rows, whole = np.full((len(planner.s), 1), x), {name: np.ones_like(each) for name, each in planner.shares.items()}
    least, most = (each[:, 0] for each in points.torque_limits(rows, whole))
    torque = points.torque(rows, np.zeros_like(rows))[:, 0]
    allowed = np.where(torque > 0.0, most, -least)
    excess = np.abs(torque) / np.maximum(allowed, 1.0 / UNBOUNDED)
    k, joint = (int(each) for each in np.unravel_index(int(excess.argmax()), excess.shape))
    if excess[k, joint] <= 1.0 + ROUNDING:
        return None
    unit, name = planner.limits.unit("torque", joint), planner.limits.names[joint]
    return ScenarioError(
        f"{what} takes {abs(torque[k, joint]):.5g} {unit} of {name}, {allowed[k, joint]:.5g} {unit} is what its "
        "limits of torque and voltage allow",
        place=_place(planner, k), value=points.q[k], expected="a lighter payload, a stronger motor or another path",
    )  # fmt: skip


def _loads(planner: Planner) -> str:
    return "the arm against gravity and springs" if planner.dyn.arm.is_sprung else "the arm against gravity"


def _place(planner: Planner, k: int) -> str:
    return f"path at s = {planner.s[k]:.6g} of {planner.path.length:.6g}"

"""Joint positions for a tool's path: the initial solution, the continuation along it, and reasons for failure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import PPoly

from armwright.collision import Clearance
from armwright.entry import AnyArm, as_arm
from armwright.errors import ABSENT, ScenarioError
from armwright.ik.solutions import distance_text
from armwright.ik.solve import inverse_kinematics
from armwright.ik.starts import random_positions
from armwright.kinematics.aim import AXES, Aim
from armwright.model import Model
from armwright.results.result import Result
from armwright.scalar import numbers_or_nan, real_number
from armwright.trajectory.cartesian.following import Follower, Stuck
from armwright.trajectory.cartesian.path import CartesianPath
from armwright.trajectory.cartesian.pieces import PathPoints
from armwright.trajectory.cartesian.tool import Tool
from armwright.trajectory.cartesian.turning import UPRIGHT
from armwright.trajectory.keep_clear import check_arm, nearest_along, too_near
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.path import JointPath

STARTS, DIFFERENT = 64, 1e-4  # random starts for solutions at the beginning; [rad | m] by which two of them differ
TRIED = 8  # solutions that are followed along the path
AHEAD = np.geomspace(1e-6, 0.05, 16)  # of the path: how far behind a place poses are tried, when a path ends there
IN_A_PIECE = 9  # places between two nodes of a spline, where distances are computed at first
SAMPLES = 200  # of a path, for how far it leaves the reach
BESIDE, SEVERAL = 1e-5, 3  # [rad] off and places of the path: what is less may be a descent that did not get there
BOUNDLESS = 1e9  # [rad/m]
STILL = 1e-9  # [rad | m] of a joint that does not move
BEYOND = 1e-9  # [rad | m] outside of a limit that is rounding


@dataclass(frozen=True, eq=False)
class SplinePath(JointPath):
    """A joint path with a given spline in place of the natural one through its waypoints."""

    spline: PPoly = field(kw_only=True)

    @cached_property
    def curve(self) -> PPoly:
        """q(s) as piecewise polynomials of fifth degree."""
        return self.spline


@dataclass(frozen=True, eq=False)
class ToolPathSolution(Result):
    """Joint positions along a tool's path.

    Attributes:
        path: of the tool.   runs: joint paths from one stop to the next, their s from 0 on.
        deviation: largest distance [m] and angle [rad] of the tool from its path, on a grid denser than the splines'.
        tool: the frame that is led.
    """

    path: CartesianPath
    runs: tuple[JointPath, ...]
    deviation: tuple[float, float]
    tool: Tool

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.runs[0].n

    def at(self, s: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q [rad | m], dq/ds and d²q/ds², each (…, n), at s (…) of the tool's path; at a stop those before it."""
        s = np.asarray(s, dtype=float)
        found = np.zeros((3, s.size, self.n))
        for run, rows, local in self._parts(s.reshape(-1)):
            found[:, rows] = run.at(local)
        q, first, second = found.reshape(3, *s.shape, self.n)
        return q, first, second

    def twists(self, s: np.ndarray, points: PathPoints) -> PathPoints:
        """Points (k) of the path at s with the tool's own motion, whose free parts turn as the joints turn them."""
        return self.tool.twists(*self.at(s), points)

    def third(self, s: np.ndarray) -> np.ndarray:
        """d³q/ds³ (k, n) at s (k,), which jumps at the nodes of the splines."""
        found = np.zeros((len(s), self.n))
        for run, rows, local in self._parts(s):
            found[rows] = run.derivative(local, 3)
        return found

    def _parts(self, s: np.ndarray) -> Iterator[tuple[JointPath, np.ndarray, np.ndarray]]:
        """The runs, which of s (k,) lie on each, and those places from its beginning on."""
        begins = np.array([begin for begin, _ in self.path.runs])
        which = np.clip(np.searchsorted(begins, s, side="left") - 1, 0, len(self.runs) - 1)
        for k in np.unique(which):
            yield self.runs[k], which == k, s[which == k] - begins[k]


def solve_path(
    arm: AnyArm,
    path: CartesianPath,
    *,
    near: Any = None,
    frame: str | None = None,
    aim: str | Aim = "pose",
    posture: Any = None,
    limits: MotionLimits | None = None,
    tolerance: float = 1e-6,
    clearance: Clearance | None = None,
) -> ToolPathSolution:
    """Joint positions along a path of the tool, continuous, with  J q' = V  and  J q'' = V' - J' q'  at their nodes.

    Without `near`, several solutions at the beginning are followed, and of those that reach the end within the limits of
    position, and without coming too near to anything, the one is taken whose joints are slowest, by their limits of speed. A
    redundant arm moves its joints as little as possible, or towards a posture as well.

    Args:
        arm: the model.   path: of the tool.
        near: (n,) positions [rad | m] to begin near.   frame: of the arm that is led; None: its tip.
        aim: part of the path's poses that counts, as in `inverse_kinematics`: "pose", "position", which leaves the rotation
            free, "axis", "pitch", …; what is free moves continuously, as little as the joints need.
        posture: (n,) [rad | m] that a redundant arm's self-motion goes to; None: the least motion.
        limits: of positions and speeds; None: the record's.   tolerance: [m] and [rad] of the tool on a dense grid.
        clearance: of the arm; solutions that come nearer than its least distance are left out.
    Returns:
        solution: joint paths between the stops, and how far the tool leaves its path.
    Raises:
        ScenarioError: a path out of reach (where, how far), past a limit of position (which joint, where, how far), or through
            a singularity (where, which joint, its speed), or too near to something (what, where, how near).
        ModelError: no such frame or aim.
    Example:
        >>> arm = aw.load("ur5e")
        >>> start = aw.forward_kinematics(arm, [0.0, -1.0, 1.2, -0.5, 0.8, 0.0])
        >>> line = aw.trajectories.Line(start[:3, 3] + [0.0, 0.1, 0.0])
        >>> path = aw.trajectories.CartesianPath([line], start)
        >>> max(aw.trajectories.solve_path(arm, path).deviation) < 1e-6
        True
    """
    arm = as_arm(arm)
    limits = checked_limits(arm, limits)
    if not isinstance(path, CartesianPath):
        raise ScenarioError(place="path", value=path, expected="an aw.trajectories.CartesianPath")
    part = Aim.of(aim)
    accuracy = real_number(tolerance)
    if accuracy is None or not 1e-9 <= accuracy < 0.1:
        raise ScenarioError(place="tolerance", value=tolerance, expected="a number from 1e-9 to 0.1 [m and rad]")
    if clearance is not None:
        check_arm(clearance, arm)
    tool, turning = Tool(arm, frame, part), np.array([not body.kind.slides for body in arm.coordinates])
    _check_vertical(path, part)
    follower = Follower(tool, path, None if posture is None else _positions(arm, "posture", posture))
    found: list[tuple[float, list[Any]]] = []
    failures: list[Stuck | Outside] = []
    for q in _starts(follower, near):
        try:
            runs = _within(_followed(follower, q), limits, turning if near is None else None, path)
            found.append((_pace(follower, runs, limits), runs))
        except (Stuck, Outside) as failure:
            failures.append(failure)
    for _, runs in sorted(found, key=lambda each: float(f"{each[0]:.6g}")):  # as good: in the order of the starts
        try:
            return _splined(follower, runs, accuracy, limits, clearance)
        except (Stuck, Outside) as failure:
            failures.append(failure)
    farthest = max(failures, key=lambda each: each.s)
    raise explained(follower, farthest) if isinstance(farthest, Stuck) else farthest.error


def checked_limits(arm: Any, limits: Any) -> MotionLimits:
    """Limits of an arm; None: the record's.

    Raises:
        ModelError: no arm.   ScenarioError: no limits, or of another number of joints.
    """
    limits = MotionLimits.of(arm) if limits is None else limits
    if not isinstance(limits, MotionLimits) or limits.n != arm.n:
        what = f"limits of {limits.n} joints" if isinstance(limits, MotionLimits) else ""
        expected = f"aw.trajectories.MotionLimits.of(arm, …) of {arm.name}"
        raise ScenarioError(what, place="limits", value=ABSENT if what else limits, expected=expected)
    return limits


def _check_vertical(path: CartesianPath, aim: Aim) -> None:
    """Refuses paths on which an axis is vertical in places, if its yaw or its pitch counts.

    Raises:
        ScenarioError: where; a pitch that is vertical on the whole path is none of them.
    """
    if aim.kind not in ("pitch", "yaw"):
        return
    s = np.union1d(np.linspace(0.0, path.length, SAMPLES), path.breaks)
    sine = np.linalg.norm(path.points(s).pose[:, :2, aim.axis], axis=1)
    vertical = sine < UPRIGHT
    if vertical.any() and not (aim.kind == "pitch" and vertical.all()):
        what = f"the tool's {AXES[aim.axis]} axis is vertical, where its {aim.kind} has no slope"
        expected = "an axis beside the vertical, if by 1 mrad, or aim = 'axis'"
        raise ScenarioError(what, place=place(path, float(s[vertical.argmax()])), expected=expected)


@dataclass(frozen=True, eq=False)
class Outside(Exception):
    """A solution that passes a limit of position or comes too near to something, and where it does."""

    s: float
    error: ScenarioError


def _starts(follower: Follower, near: Any) -> list[np.ndarray]:
    """Solutions at the beginning of the path: the one near positions, or some that differ.

    Raises:
        ScenarioError: there is none; says how far the nearest pose is.
    """
    tool, start = follower.tool, follower.path.start
    options: Any = {"frame": tool.frame, "aim": tool.aim}
    if near is not None:
        solutions = inverse_kinematics(tool.arm, start, near=_positions(tool.arm, "near", near), **options)
        rows, fine = solutions.q[None], solutions.success[None]
    else:
        targets = np.broadcast_to(start, (STARTS, 4, 4))
        solutions = inverse_kinematics(tool.arm, targets, near=random_positions(tool.arm, STARTS), **options)
        rows, fine = solutions.q, solutions.success
    if not fine.any():
        exact = (solutions.position_error <= solutions.tolerance) & (solutions.angle_error <= solutions.tolerance)
        if np.any(exact):  # but for the limits
            outside = solutions.q.reshape(-1, tool.arm.n)[np.argmax(exact)]
            MotionLimits.of(tool.arm).check_position(place(follower.path, 0.0), outside)
        off = np.ravel(solutions.position_error + solutions.angle_error).argmin()
        distance, angle = np.ravel(solutions.position_error)[off], np.ravel(solutions.angle_error)[off]
        raise _out_of_reach(follower, 0.0, float(distance), float(angle))
    different: list[np.ndarray] = []
    for q in rows[fine]:
        if all(np.abs(q - other).max() > DIFFERENT for other in different):
            different.append(q)
    begin = np.zeros(len(different))
    exact, converged = follower.corrected(np.array(different), begin)
    return list(exact[converged][:TRIED]) or different[:1]


def _positions(arm: Model, name: str, value: Any) -> np.ndarray:
    positions = numbers_or_nan(value)
    if positions.shape != (arm.n,) or not np.isfinite(positions).all():
        raise ScenarioError(place=name, value=value, expected=f"{arm.n} finite numbers: {', '.join(arm.names)}")
    return positions


def _followed(follower: Follower, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Nodes and positions of every run, from positions at the beginning."""
    runs = []
    for begin, end in follower.path.runs:
        s, rows = follower.run(q, begin, end)
        runs.append((s, rows))
        q = rows[-1]
    return runs


def _within(
    runs: list[tuple[np.ndarray, np.ndarray]], limits: MotionLimits, turning: np.ndarray | None, path: CartesianPath
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Runs within the limits of position, if need be with whole turns added to the joints of `turning` (n,), which only turn.

    Raises:
        Outside: names the joint, the place and how far it is outside.
    """
    rows = np.concatenate([q for _, q in runs])
    low, high = limits.position.T
    if turning is not None:
        least, most = rows.min(axis=0), rows.max(axis=0)
        over = np.where(least < low - BEYOND, np.ceil((low - least) / (2.0 * np.pi)), 0.0)
        over = np.where(most > high + BEYOND, -np.ceil((most - high) / (2.0 * np.pi)), over)
        shift = np.where(turning, 2.0 * np.pi * over, 0.0)
        fits = (least + shift >= low - BEYOND) & (most + shift <= high + BEYOND)
        shift = np.where(fits, shift, 0.0)
        runs, rows = [(s, q + shift) for s, q in runs], rows + shift
    outside = past_limits(path, limits, np.concatenate([s for s, _ in runs]), rows)
    if outside is not None:
        raise outside
    return runs


def past_limits(path: CartesianPath, limits: MotionLimits, s: np.ndarray, q: np.ndarray) -> Outside | None:
    """The joint that is first outside its limits, of positions q (k, n) at places s (k,) of a path; None if all are within."""
    low, high = limits.position.T
    beyond = np.maximum(low - q, q - high)
    if not (beyond > BEYOND).any():
        return None
    row, joint = np.argwhere(beyond > BEYOND)[0]
    worst = int(beyond[:, joint].argmax())
    return Outside(float(s[row]), _past_limit(path, limits, int(joint), float(s[row]), q[worst, joint], s[worst]))


def _past_limit(
    path: CartesianPath, limits: MotionLimits, joint: int, first: float, worst: float, at: float
) -> ScenarioError:
    """The error of a joint that first leaves its limits at one place of a path and is farthest outside at another."""
    low, high = limits.position[joint]
    unit = limits.unit("position", joint)
    beyond = max(low - worst, worst - high)
    what = f"joint {limits.names[joint]!r} leaves its limits, and is {beyond:.4g} {unit} outside at s = {at:.4g} m"
    expected = f"{low:.4g} … {high:.4g} {unit}"
    return ScenarioError(what, place=place(path, first), value=float(worst), expected=expected)


def place(path: CartesianPath, s: float) -> str:
    """A place on a path in the form used by errors."""
    x, y, z = path.points(np.array([s])).pose[0, :3, 3]
    return f"path at s = {s:.4g} of {path.length:.4g} m ({x:.3f}, {y:.3f}, {z:.3f})"


def _pace(follower: Follower, runs: list[tuple[np.ndarray, np.ndarray]], limits: MotionLimits) -> float:
    """The largest |q'| by its limit of speed; without limits in rad/m."""
    known = np.where(np.isfinite(limits.velocity), limits.velocity, 1.0)
    peaks = [(np.abs(follower.derivatives(q, np.nextafter(s, np.inf))[0]) / known).max() for s, q in runs]
    return float(max(peaks))


def _splined(
    follower: Follower,
    runs: list[tuple[np.ndarray, np.ndarray]],
    tolerance: float,
    limits: MotionLimits,
    clearance: Clearance | None,
) -> ToolPathSolution:
    """Runs as splines, the limits of position and the least distance held between nodes as well.

    Raises:
        Stuck, Outside: as named there.   ScenarioError: a part of the path moves no joint.
    """
    paths, off, angle = [], 0.0, 0.0
    for s, q in runs:
        if np.ptp(q, axis=0).max() < STILL:
            what = f"no joint moves: the tool's turn does not count with aim = {str(follower.tool.aim)!r}"
            raise ScenarioError(
                what, place=place(follower.path, float(s[0])), expected="a path without it, or another aim"
            )
        nodes, rows, curve, (distance, turned) = follower.spline(s, q, tolerance)
        off, angle = max(off, distance), max(angle, turned)
        spline = PPoly(curve.c, curve.x - nodes[0])
        each = SplinePath(rows, nodes - nodes[0], spline=spline)
        places, extremes = each.extremes()
        low, high = limits.position.T
        beyond = np.stack([low - extremes[:, 0], extremes[:, 1] - high], axis=1)
        if beyond.max() > 1e3 * BEYOND:
            joint, end = np.unravel_index(int(beyond.argmax()), beyond.shape)
            at = nodes[0] + float(places[joint, end])
            error = _past_limit(follower.path, limits, int(joint), at, float(extremes[joint, end]), at)
            raise Outside(at, error)
        if clearance is not None:
            dense = np.unique(np.linspace(each.breaks[:-1], each.breaks[1:], IN_A_PIECE))
            found, at = nearest_along(clearance, lambda s, each=each: each.at(s)[0], dense)
            error = too_near(clearance, found)
            if error is not None:
                raise Outside(nodes[0] + at, error.within(place(follower.path, nodes[0] + at)))
        paths.append(each)
    return ToolPathSolution(follower.path, tuple(paths), (off, angle), follower.tool)


def explained(follower: Follower, stuck: Stuck) -> ScenarioError:
    """The error of a path that the joints cannot follow from some place on: out of reach, or a singularity."""
    path, tool = follower.path, follower.tool
    ahead = np.clip(stuck.s + AHEAD * path.length, None, path.length)
    s = np.concatenate([ahead, np.linspace(stuck.s, path.length, SAMPLES)])
    success, distance, angle = _solved(tool, path, s)
    off = np.where(success, -1.0, distance + tool.radian * angle)
    far, here = off > BESIDE * tool.radian, not success[: len(AHEAD)].any()
    if here or far.sum() >= SEVERAL:  # a path that leaves the reach is no use even if its singular places are avoided
        worst, first = int(np.argmax(off)), stuck.s if here else float(s[far].min())
        return _out_of_reach(follower, first, float(distance[worst]), float(angle[worst]), float(s[worst]))
    joint, rate = tool.hardest(stuck.q, path.points(np.array([stuck.s])))
    unit = tool.arm.coordinates[joint].kind.units.position
    speed = (
        f"{rate:.3g} {unit}/s for each m/s of the tool, and more beyond" if rate < BOUNDLESS else "an infinite speed"
    )
    what = f"singular: joint {tool.arm.names[joint]!r} would need {speed}"
    return ScenarioError(what, place=place(path, stuck.s), expected="a path farther from the singularity")


def _solved(tool: Tool, path: CartesianPath, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True where poses at s (k,) have solutions, and how far off the nearest are [m], [rad]."""
    solutions = inverse_kinematics(tool.arm, path.points(s).pose, frame=tool.frame, aim=tool.aim)
    return solutions.success, solutions.position_error, solutions.angle_error


def _out_of_reach(
    follower: Follower, s: float, distance: float, angle: float, worst: float | None = None
) -> ScenarioError:
    off = distance_text(distance, angle if follower.tool.aim.counted else None)
    at = "" if worst is None else f" at s = {worst:.4g} m"
    what = f"out of reach within the joints' limits: the nearest pose is {off} off{at}"
    return ScenarioError(what, place=place(follower.path, s), expected="a path that the arm reaches")

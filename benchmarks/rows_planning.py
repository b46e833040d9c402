"""Planning of motions: time-optimal along a path, beside toppra, and through a thousand waypoints, beside SciPy's spline."""

# toppra is optional and has no stubs.
# pyright: reportMissingImports=false, reportMissingTypeStubs=false

from __future__ import annotations

import importlib.util
from functools import partial
from typing import Any

import numpy as np
from records import Record, Task, record
from scipy.interpolate import CubicSpline
from timing import Check, Contestant, Entry, race

import armwright as aw

GRID, QUICK_GRID = 500, 200  # at 100 points toppra is a percent slower than at 500
WAYPOINTS, QUICK_WAYPOINTS = 1_000, 50
TURNS, QUICK_TURNS, MOTOR_TURNS = 300, 20, 100  # random waypoints; of the row with motors
BETWEEN = 100  # toppra's grid points between two random waypoints
TURNING = {"velocity": 2.0, "acceleration": 5.0}  # [rad/s], [rad/s²] of all joints, for random turns
MOST = {"time-optimal": 2000.0, "turns": 300.0, "turns with motors": 1000.0, "waypoints": 1000.0}  # [ms] a plan
AS_TOPPRA = 0.01  # relative, between the two durations
KEPT = 1e-6  # relative, that a limit may be exceeded by
FAR = 1e6  # [rad] limits of position that do not matter
ACCELERATION = 10.0  # [rad/s²] of all joints of the waypoints' arm, whose record has no limits of it
TOPPRA_SWING = 1e-3  # [rad] its path from the last waypoint


def tasks(quick: bool) -> list[Task]:
    """Six plans."""
    turns, motor_turns = (QUICK_TURNS, QUICK_TURNS) if quick else (TURNS, MOTOR_TURNS)
    grid, count = (QUICK_GRID, QUICK_WAYPOINTS) if quick else (GRID, WAYPOINTS)
    return [
        Task("planning", "planning time-optimal rigid panda", partial(rigid_records, "panda", grid)),
        Task("planning", "planning time-optimal motors cmu-dd", partial(motor_records, "cmu-dd", grid)),
        Task("planning", "planning time-optimal turns puma560", partial(turn_records, "puma560", turns)),
        Task(
            "planning", "planning time-optimal motor turns cmu-dd", partial(motor_turn_records, "cmu-dd", motor_turns)
        ),
        Task("planning", "planning waypoints panda", partial(waypoint_records, "panda", count)),
        Task("planning", "planning waypoint turns puma560", partial(waypoint_turn_records, "puma560", turns)),
    ]


def rigid_records(name: str, grid: int, repetitions: int) -> list[Record]:
    """Limits of velocity and of a rigid body's torque, which toppra can have too."""
    arm = aw.load(name).replace(friction=None, efficiency=None)
    path, limits = random_path(arm), aw.trajectories.MotionLimits.of(arm, voltage=np.inf)
    plan, contestants, facts = partial(aw.trajectories.time_optimal, arm, path, limits, grid=grid), {}, {}
    if importlib.util.find_spec("toppra") is not None:
        solve = by_toppra(path.parameter, path.waypoints, limits, np.linspace(0.0, path.length, grid + 1), arm)
        duration, expected = plan().duration, float(solve().duration)
        facts = {"motion": duration, "toppra's motion": expected}
        contestants["toppra"] = Contestant("toppra", solve, grid, partial(check_duration, duration))
        same = partial(check_duration, expected)
    else:
        same = None
    ours = Contestant("ours", plan, grid, partial(check_plan, arm, limits, same))
    labels = {"arm": name, "joints": arm.n, "work": "time-optimal: velocity, rigid torque", "points": grid}
    return raced(labels, {"ours": ours} | contestants, repetitions, "time-optimal", facts)


def motor_records(name: str, grid: int, repetitions: int) -> list[Record]:
    """All limits of the arm's drives: voltage and friction too."""
    arm = aw.load(name)
    path, limits = random_path(arm), aw.trajectories.MotionLimits.of(arm)
    plan = partial(aw.trajectories.time_optimal, arm, path, limits, grid=grid)
    ours = Contestant("ours", plan, grid, partial(check_plan, arm, limits, None))
    labels = {"arm": name, "joints": arm.n, "work": "time-optimal: with friction and voltage", "points": grid}
    return raced(labels, {"ours": ours}, repetitions, "time-optimal", {"motion": plan().duration})


def turn_records(name: str, count: int, repetitions: int) -> list[Record]:
    """Random waypoints with limits of velocity and acceleration alone."""
    arm = aw.load(name)
    limits = aw.trajectories.MotionLimits.of(arm, **TURNING, torque=np.inf, voltage=np.inf, position=FAR)
    path = random_turns(arm.n, count)
    plan, contestants, facts, same = partial(aw.trajectories.time_optimal, arm, path, limits), {}, {}, None
    if importlib.util.find_spec("toppra") is not None:
        ways = np.diff(path.breaks)[:, None] * np.arange(BETWEEN) / BETWEEN
        grid = np.append((path.breaks[:-1, None] + ways).ravel(), path.length)
        solve = by_toppra(path.parameter, path.waypoints, limits, grid)
        duration, expected = plan().duration, float(solve().duration)
        facts = {"motion": duration, "toppra's motion": expected}
        contestants["toppra"] = Contestant("toppra", solve, count, partial(check_duration, duration))
        same = partial(check_duration, expected)
    ours = Contestant("ours", plan, count, partial(check_plan, arm, limits, same))
    labels = {"arm": name, "joints": arm.n, "work": "time-optimal turns: velocity, acceleration", "points": count}
    return raced(labels, {"ours": ours} | contestants, repetitions, "turns", facts)


def motor_turn_records(name: str, count: int, repetitions: int) -> list[Record]:
    """Random waypoints with all limits: velocity, acceleration, torque, voltage."""
    arm = aw.load(name)
    limits = aw.trajectories.MotionLimits.of(arm, velocity=8.0, acceleration=80.0, position=FAR)
    plan = partial(aw.trajectories.time_optimal, arm, random_turns(arm.n, count), limits)
    ours = Contestant("ours", plan, count, partial(check_plan, arm, limits, None))
    labels = {"arm": name, "joints": arm.n, "work": "time-optimal turns: with friction and voltage", "points": count}
    return raced(labels, {"ours": ours}, repetitions, "turns with motors", {"motion": plan().duration})


def waypoint_records(name: str, count: int, repetitions: int) -> list[Record]:
    """A cubic spline through waypoints with optimised times; SciPy's with these times given, and toppra along a spline."""
    arm = aw.load(name)
    limits = aw.trajectories.MotionLimits.of(arm, acceleration=ACCELERATION, torque=np.inf, voltage=np.inf)
    points = waves(limits, count)
    plan = partial(aw.trajectories.Waypoints, points, limits, "cubic")
    motion = plan()
    times = motion.polynomial.knots
    curve = partial(CubicSpline, times, points, bc_type="clamped")
    contestants = {
        "ours": Contestant("ours", plan, count, partial(check_spline, arm, limits, curve())),
        "scipy": Contestant("SciPy", curve, count, partial(check_curve, motion)),
    }
    facts = {"motion": motion.duration}
    if importlib.util.find_spec("toppra") is not None:
        knots = np.linspace(0.0, 1.0, count)
        solve = by_toppra(knots, points, limits, knots)
        facts["toppra's motion"] = float(solve().duration)
        contestants["toppra"] = Contestant("toppra", solve, count, partial(check_end, points[-1]))
    labels = {"arm": name, "joints": arm.n, "work": "waypoints: cubic, optimised times", "points": count}
    return raced(labels, contestants, repetitions, "waypoints", facts)


def waypoint_turn_records(name: str, count: int, repetitions: int) -> list[Record]:
    """`Waypoints` through random poses, as fast as limits of velocity and acceleration allow; toppra along the same path."""
    arm = aw.load(name)
    limits = aw.trajectories.MotionLimits.of(arm, **TURNING, torque=np.inf, voltage=np.inf, position=FAR)
    points = random_turns(arm.n, count).waypoints
    plan, contestants, facts, same = partial(aw.trajectories.Waypoints, points, limits), {}, {}, None
    if importlib.util.find_spec("toppra") is not None:
        ways = np.linalg.norm(np.diff(points, axis=0), axis=1) ** 0.5
        knots = np.append(0.0, np.cumsum(ways))
        grid = np.append((knots[:-1, None] + ways[:, None] * np.arange(BETWEEN) / BETWEEN).ravel(), knots[-1])
        solve = by_toppra(knots, points, limits, grid)
        duration, expected = plan().duration, float(solve().duration)
        facts = {"motion": duration, "toppra's motion": expected}
        contestants["toppra"] = Contestant("toppra", solve, count, partial(check_duration, duration))
        same = partial(check_duration, expected)
    ours = Contestant("ours", plan, count, partial(check_fast, same))
    labels = {"arm": name, "joints": arm.n, "work": "waypoints: turns, fastest", "points": count}
    return raced(labels, {"ours": ours} | contestants, repetitions, "waypoints", facts)


def raced(
    labels: dict[str, Any], contestants: dict[str, Contestant], repetitions: int, work: str, facts: dict[str, Any]
) -> list[Record]:
    """The row, and how long a whole plan may take."""
    facts = {**facts, "at_most": {"ours": MOST[work]}}
    beside = {column: "ours" for column in contestants if column == "toppra"}
    return [record(row) for row in race([Entry(labels, contestants, beside, facts=facts)], repetitions)]


def random_path(arm: aw.Model) -> aw.trajectories.JointPath:
    """Through five random poses well within the position limits."""
    low, high = np.clip([body.limits.position for body in arm.coordinates], -2.0, 2.0).T
    return aw.trajectories.JointPath(np.random.default_rng(0).uniform(0.6 * low, 0.6 * high, (5, arm.n)))


def random_turns(n: int, count: int) -> aw.trajectories.JointPath:
    """Through random poses, each far from the one before."""
    return aw.trajectories.JointPath(np.random.default_rng(0).uniform(-1.5, 1.5, (count, n)))


def waves(limits: aw.trajectories.MotionLimits, count: int) -> np.ndarray:
    """(count, n) poses along sines of different frequency, within half of the position limits."""
    draw = np.random.default_rng(0)
    low, high = np.clip(limits.position, -np.pi, np.pi).T
    angles = np.linspace(0.0, 1.0, count)[:, None] * draw.uniform(2.0, 8.0, limits.n) + draw.uniform(0.0, 1.0, limits.n)
    return 0.5 * (low + high) + 0.25 * (high - low) * np.sin(2.0 * np.pi * angles)


def by_toppra(
    knots: np.ndarray, points: np.ndarray, limits: aw.trajectories.MotionLimits, grid: np.ndarray, arm: Any = None
) -> Any:
    """toppra's work along the natural spline through points at `knots`: its default solver, rest at both ends."""
    import toppra
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    both_ends, kept = constraint.DiscretizationType.Interpolation, []
    if np.isfinite(limits.velocity).all():
        kept.append(constraint.JointVelocityConstraint(symmetric(limits.velocity)))
    if np.isfinite(limits.acceleration).all():
        kept.append(constraint.JointAccelerationConstraint(symmetric(limits.acceleration), both_ends))
    if arm is not None:
        torques = aw.compile(arm).inverse_dynamics
        kept.append(
            constraint.JointTorqueConstraint(torques, symmetric(limits.torque), np.zeros(arm.n), both_ends),
        )

    def solve() -> Any:
        curve = toppra.SplineInterpolator(knots, points, bc_type="natural")
        planner = algorithm.TOPPRA(kept, curve, gridpoints=grid, parametrizer="ParametrizeConstAccel")
        return planner.compute_trajectory(0.0, 0.0)

    return solve


def symmetric(limit: np.ndarray) -> np.ndarray:
    """(n, 2) from minus the limit to the limit."""
    return np.stack([-limit, limit], axis=1)


def check_duration(expected: float, found: Any) -> Check:
    """Difference of a motion's duration from the other's, relative."""
    return Check(abs(float(found.duration) / expected - 1.0) if found is not None else float("nan"), AS_TOPPRA)


def check_plan(arm: aw.Model, limits: aw.trajectories.MotionLimits, same: Any, found: Any) -> Check:
    """Excess of limits on a dense grid, and the other's duration where there is one."""
    if not aw.trajectories.limits_report(arm, found, limits, samples=10).kept:
        return Check(float("nan"), KEPT)
    return same(found) if same is not None else Check(max(float(found.excess), 0.0), KEPT)


def check_fast(same: Any, found: aw.trajectories.Waypoints) -> Check:
    """The other's duration, or the largest excess of a limit where there is none."""
    limits, polynomial = found.limits, found.polynomial
    assert limits is not None
    excess = (
        max((polynomial.largest(k) / most).max() for k, most in enumerate((limits.velocity, limits.acceleration), 1))
        - 1.0
    )
    if excess > KEPT:
        return Check(float("nan"), KEPT)
    return same(found) if same is not None else Check(max(float(excess), 0.0), KEPT)


def check_spline(
    arm: aw.Model, limits: aw.trajectories.MotionLimits, curve: CubicSpline, found: aw.trajectories.Waypoints
) -> Check:
    """Difference from SciPy's spline at the same times [rad]; NaN where a limit is exceeded."""
    kept = aw.trajectories.limits_report(arm, found, limits, samples=10).kept
    return Check(difference(found, curve) if kept else float("nan"), KEPT)


def check_curve(motion: aw.trajectories.Waypoints, found: CubicSpline) -> Check:
    """Difference from our spline [rad]."""
    return Check(difference(motion, found), KEPT)


def difference(motion: aw.trajectories.Waypoints, curve: CubicSpline) -> float:
    """Largest difference of positions [rad], four times between waypoints."""
    knots = motion.polynomial.knots
    t = np.linspace(knots[0], knots[-1], 4 * len(knots))
    return float(np.abs(motion.at(t)[0] - curve(t)).max())


def check_end(goal: np.ndarray, found: Any) -> Check:
    """Distance of the motion's end from the last waypoint [rad]."""
    return Check(float(np.abs(found(found.duration) - goal).max()) if found is not None else float("nan"), TOPPRA_SWING)


def notes(quick: bool) -> dict[str, list[str]]:
    """Texts of the rows."""
    lines = [
        "time-optimal: a natural spline through five random poses, rest at both ends; ours is judged on a ten times denser grid "
        "through the compiled inverse dynamics, and made again where a limit is exceeded, toppra's on its grid alone "
        "(Interpolation); toppra's torques are by our compiled inverse dynamics, one call a point. Both durations agree to 1 %",
        f"time-optimal turns: a natural spline through random poses; toppra on {BETWEEN} points between two of them, not "
        "looked at between its points; ours keeps its limits there",
        f"waypoints: velocity limits of the record and {ACCELERATION:g} rad/s²; SciPy: `CubicSpline` alone, with the times that "
        "ours found: the same curve, and the floor of any planner; toppra: the fastest motion along a spline through them, "
        "a grid point at each waypoint, accelerations that jump where ours are continuous",
    ]
    return {"planning": lines}

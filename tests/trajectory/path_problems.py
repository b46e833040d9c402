"""Paths, limits and oracles that tests of time-optimal motions share."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np
import pytest

import armwright as aw
from armwright.model import Model, build_model
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.motion import Motion
from armwright.trajectory.path import JointPath
from physics.arms import arm as built_arm

ARMS = ("panda", "cmu-dd", "lwa4p", "puma560", "workshop", "rough", "sprung", "two-link")
HOME = {  # in the middle of the space of each
    "puma560": [0.3, -0.8, 0.4, 0.2, 0.7, 0.0],
    "lwa4p": [0.3, 0.6, 1.5, 0.2, 0.9, 0.1],
    "panda": [0.2, -0.5, 0.1, -2.0, 0.1, 1.6, 0.5],
}
RELAXED = {"acceleration": np.inf, "torque": np.inf, "voltage": np.inf}


def random_path(arm: Model, seed: int, count: int = 5) -> JointPath:
    """A path through random poses well within the position limits."""
    bounds = np.clip([body.limits.position for body in arm.coordinates], -2.0, 2.0)
    points = np.random.default_rng(seed).uniform(0.6 * bounds[:, 0], 0.6 * bounds[:, 1], size=(count, arm.n))
    return JointPath(points)


def reachable_limits(arm: Model, path: JointPath, seed: int) -> MotionLimits:
    """Random limits under which the arm can be held along the path, with friction: of torque, and some of velocity,
    acceleration and voltage."""
    draw, dyn = np.random.default_rng(seed), aw.compile(arm)
    q, first, _ = path.at(np.linspace(0.0, path.length, 200))
    slowly = 0.05 * first / np.abs(first).max()
    holding = np.abs([dyn.inverse_dynamics(q, speed, 0.0 * q) for speed in (0.0 * q, slowly, -slowly)]).max(axis=(0, 1))
    inertia = np.abs(dyn.mass_matrix(q[::10])).max(axis=(0, 1))
    torque = holding * draw.uniform(1.2, 4.0, arm.n) + inertia * draw.uniform(1.0, 10.0)
    limits = MotionLimits.of(arm, **RELAXED, position=1e6, velocity=np.inf).replace(torque=torque)
    if draw.random() < 0.5:
        limits = limits.replace(velocity=draw.uniform(0.5, 4.0, arm.n))
    if draw.random() < 0.5:
        limits = limits.replace(acceleration=draw.uniform(2.0, 20.0, arm.n))
    drives = [body.drive for body in arm.coordinates]
    if all(drive.resistance is not None and drive.torque_constant is not None for drive in drives):
        stall = [drive.resistance / abs(drive.gear_ratio * drive.torque_constant) for drive in drives]
        limits = limits.replace(voltage=torque * np.array(stall, dtype=float) * draw.uniform(0.95, 2.0))
    return limits


def limited_in_speed(volts: float) -> tuple[Model, np.ndarray, MotionLimits]:
    """`cmu-dd` with so little resistance that its voltages limit its speeds alone, poses (3, n), and its limits."""
    record = aw.load("cmu-dd").record
    joints = (joint.replace(motor=joint.motor.replace(resistance_ohm=0.05)) for joint in record.joints)
    arm = build_model(record.replace(joints=tuple(joints)))
    points = np.random.default_rng(0).uniform(-1.2, 1.2, (3, arm.n))
    return arm, points, MotionLimits.of(arm, position=1e6, voltage=volts)


def random_problem(seed: int) -> tuple[Model, JointPath, MotionLimits]:
    """An arm of eight, a path through two to six random poses and random limits."""
    arm = built_arm(ARMS[seed % len(ARMS)])
    path = random_path(arm, seed, 2 + seed % 5)
    return arm, path, reachable_limits(arm, path, seed)


def random_tool_motion(seed: int) -> tuple[Model, aw.trajectories.CartesianMotion, MotionLimits]:
    """A motion along two random lines with a rounded corner under random limits; every other one is slower where needed alone."""
    draw = np.random.default_rng(seed)
    arm, home = built_arm(list(HOME)[seed % 3]), np.array(list(HOME.values())[seed % 3])
    goals = aw.compile(arm).forward_kinematics(home + draw.uniform(-0.3, 0.3, (2, arm.n)))
    limits = aw.trajectories.MotionLimits.of(
        arm, velocity=draw.uniform(0.3, 3.0), acceleration=draw.uniform(1.0, 20.0), jerk=500.0, torque=np.inf, voltage=np.inf
    )  # fmt: skip
    start, blend = aw.compile(arm).forward_kinematics(home), 10.0 ** draw.uniform(-4.0, -1.5)
    path = aw.trajectories.CartesianPath([aw.trajectories.Line(goal) for goal in goals], start, blend, 0.1)
    speed, slow = draw.uniform(0.05, 2.0), "where needed" if (seed // 3) % 2 else "everywhere"
    return arm, aw.trajectories.follow_path(arm, path, speed, 5.0, limits=limits, near=home, slow=slow), limits


def largest_use(arm: Model, motion: Motion, limits: MotionLimits, denser: int = 10) -> float:
    """Largest part of any limit that a motion uses: between its breaks on a grid so many times denser, and at as many random
    times, by `motion.at` and the arm's own kernels."""
    breaks = motion.breaks
    denser = max(denser, 20_000 // len(breaks))
    within = np.linspace(0.0, 1.0, denser + 2)[:-1]
    even = (breaks[:-1, None] + np.diff(breaks)[:, None] * within).ravel()
    random = np.random.default_rng(len(breaks)).uniform(breaks[0], breaks[-1], len(even))
    q, qd, qdd = motion.at(np.concatenate([even, random, breaks[-1:]]))
    dyn, values = aw.compile(arm), {"velocity": qd, "acceleration": qdd}
    if np.isfinite([limits.torque, limits.voltage]).any():
        values["torque"] = dyn.inverse_dynamics(q, qd, qdd)
    if np.isfinite(limits.voltage).any():
        values["voltage"] = dyn.motor_voltage(qd, values["torque"])
    return max(float((np.abs(value) / getattr(limits, name)).max()) for name, value in values.items())


def by_toppra(arm: Model | None, path: JointPath, limits: MotionLimits, grid: int | np.ndarray = 1000) -> float:
    """Duration [s] of the fastest motion by toppra, under limits of velocity, acceleration and rigid-body torque (of an arm);
    NaN where it finds none. `grid`: number of even pieces, or the points."""
    toppra = pytest.importorskip("toppra", reason="toppra is the oracle here: pip install toppra")
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    both_ends = constraint.DiscretizationType.Interpolation
    curve = toppra.SplineInterpolator(path.parameter, path.waypoints, bc_type="natural")
    made: list[Any] = []
    if np.isfinite(limits.velocity).all():
        made.append(constraint.JointVelocityConstraint(np.stack([-limits.velocity, limits.velocity], axis=1)))
    if np.isfinite(limits.acceleration).all():
        bounds = np.stack([-limits.acceleration, limits.acceleration], axis=1)
        made.append(constraint.JointAccelerationConstraint(bounds, discretization_scheme=both_ends))
    if np.isfinite(limits.torque).all():
        bounds, friction = np.stack([-limits.torque, limits.torque], axis=1), np.zeros(limits.n)
        torques = aw.compile(arm).inverse_dynamics
        made.append(constraint.JointTorqueConstraint(torques, bounds, friction, both_ends))
    points = np.linspace(0.0, path.length, grid + 1) if isinstance(grid, int) else grid
    planner = algorithm.TOPPRA(made, curve, gridpoints=points, parametrizer="ParametrizeConstAccel")
    found = planner.compute_trajectory(0.0, 0.0)
    return np.nan if found is None else float(found.duration)


def by_ipopt(arm: Model, path: JointPath, limits: MotionLimits, s: np.ndarray, starts: list[np.ndarray]) -> list[float]:
    """Durations [s] of the local optima that IPOPT finds from several profiles of x, on the same grid: the same problem as a
    nonlinear program over x, with the compiled kernels' own traces."""
    dyn = aw.compile(arm)
    torques, by_voltage = dyn.casadi("inverse_dynamics"), np.isfinite(limits.voltage).any()
    (q, first, second), ds, least = path.at(s), np.diff(s), 1e-10
    x = casadi.SX.sym("x", len(s))
    sdd, kept = (x[1:] - x[:-1]) / (2.0 * ds), []
    for piece in range(len(ds)):
        for k in (piece, piece + 1):
            qd, qdd = first[k] * casadi.sqrt(x[k]), first[k] * sdd[piece] + second[k] * x[k]
            tau = torques(q[k], qd, qdd)
            values = {"velocity": qd, "acceleration": qdd, "torque": tau}
            if by_voltage:
                values["voltage"] = dyn.casadi("motor_voltage")(qd, tau)
            for name, value in values.items():
                most = getattr(limits, name)
                kept += [value[i] / most[i] for i in range(arm.n) if np.isfinite(most[i])]
    problem = {
        "x": x,
        "f": casadi.sum1(2.0 * ds / (casadi.sqrt(x[1:]) + casadi.sqrt(x[:-1]))),
        "g": casadi.vertcat(*kept),
    }
    options = {
        "ipopt.print_level": 0,
        "print_time": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": 1e-9,
        "show_eval_warnings": False,
    }
    solver = casadi.nlpsol("fastest", "ipopt", problem, options)
    low, high = np.full(len(s), least), np.full(len(s), np.inf)
    high[[0, -1]] = least
    found = []
    for start in starts:
        solution = solver(x0=np.maximum(start, least), lbx=low, ubx=high, lbg=-1.0, ubg=1.0)
        if solver.stats()["success"]:
            found.append(float(solution["f"]))
    return found

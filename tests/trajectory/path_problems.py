"""Paths, limits and oracles that tests of time-optimal motions share."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np
import pytest

import armwright as aw
from armwright.model import Model
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.path import JointPath

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


def by_toppra(arm: Model, path: JointPath, limits: MotionLimits, grid: int = 1000) -> float:
    """Duration [s] of the fastest motion by toppra, under limits of velocity, acceleration and rigid-body torque; NaN where it
    finds none."""
    toppra = pytest.importorskip("toppra", reason="toppra is the oracle here: pip install toppra")
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    dyn, both_ends = aw.compile(arm), constraint.DiscretizationType.Interpolation
    curve = toppra.SplineInterpolator(path.parameter, path.waypoints, bc_type="natural")
    made: list[Any] = []
    if np.isfinite(limits.velocity).all():
        made.append(constraint.JointVelocityConstraint(np.stack([-limits.velocity, limits.velocity], axis=1)))
    if np.isfinite(limits.acceleration).all():
        bounds = np.stack([-limits.acceleration, limits.acceleration], axis=1)
        made.append(constraint.JointAccelerationConstraint(bounds, discretization_scheme=both_ends))
    if np.isfinite(limits.torque).all():
        bounds, friction = np.stack([-limits.torque, limits.torque], axis=1), np.zeros(arm.n)
        made.append(constraint.JointTorqueConstraint(dyn.inverse_dynamics, bounds, friction, both_ends))
    points = np.linspace(0.0, path.length, grid + 1)
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

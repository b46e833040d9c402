"""Time-optimal motions along a path under limits of velocity, acceleration, torque and voltage."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.kernels.compiled import compile_arm
from armwright.model import Model
from armwright.simulation.inputs.payload import Payload
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.path import JointPath
from armwright.trajectory.poses import check_number
from armwright.trajectory.time_optimal.feasibility import (
    check_holding,
    check_limits,
    check_positions,
    no_way,
    squared_speeds,
    too_weak_to_move,
)
from armwright.trajectory.time_optimal.motion import PathMotion
from armwright.trajectory.time_optimal.planner import Planner

GRID = 500
LEAST_GRID, MOST_GRID = 10, 100_000
NEAR = 0.02  # of an even piece: a turn that near to another grid point is none of its own
ROUNDING = 1e-9  # of a piece
END = (1.0 / 64.0, 1.0 / 16.0, 1.0 / 4.0)  # of the first and the last piece: there x grows from 0, √x fastest of all


def time_optimal(
    arm: Model,
    path: Any,
    limits: MotionLimits | None = None,
    *,
    payload: Payload | None = None,
    grid: int = GRID,
    speeds: tuple[float, float] = (0.0, 0.0),
    time: float = 0.0,
) -> PathMotion:
    """The fastest motion along a path that the arm with its motors can do:  min ∫ ds/ṡ,  all limits kept.

    |q̇|, |q̈|, |tau(q, q̇, q̈)| and |V| = |R tau/(n Kt) + n Ke q̇| stay below their limits, with tau by the compiled inverse dynamics:
    rotors, friction of every law and lossy gears included. Sets of ṡ² from which the end is reached are found backwards, the
    largest ṡ² in them forwards. [BobrowEtAl1985], [PhamPham2018] The plan is judged on a ten times denser grid; limits that it
    exceeds there are shrunk, and it is made again. Jerk is not limited: accelerations jump.

    Args:
        arm: the model.   path: a `JointPath`, or waypoints (k, n) [rad | m] of one.   limits: None: the record's.
        payload: a body in the hand for the whole motion; its time does not count.
        grid: number of grid points, about; breaks of the path are among them, and some more at both ends.
        speeds: path speeds ṡ at the beginning and the end.   time: [s] of the beginning.
    Returns:
        motion: along the path; `motion.used` tells where which limit is reached.
    Raises:
        ScenarioError: a path outside the position limits, limits that cannot be judged or that nothing satisfies, with the place
            on the path, the joint and by how much.
    """
    path = path if isinstance(path, JointPath) else JointPath(path)
    limits = MotionLimits.of(arm) if limits is None else limits
    if not isinstance(limits, MotionLimits) or path.n != arm.n or limits.n != arm.n:
        count = f"{limits.n} limits" if isinstance(limits, MotionLimits) else "no MotionLimits"
        raise ScenarioError(f"a path of {path.n} joints with {count}", place=arm.name, expected=f"{arm.n} of both")
    if isinstance(grid, bool) or not isinstance(grid, (int, np.integer)) or not LEAST_GRID <= grid <= MOST_GRID:
        raise ScenarioError(place="grid", value=grid, expected=f"a whole number from {LEAST_GRID} to {MOST_GRID}")
    ends = squared_speeds(speeds)
    check_number("time_optimal", "time", time)
    if payload is not None:
        arm = arm.with_payload(payload.mass, payload.com, payload.inertia, payload.frame)
    check_limits(arm, limits, path)
    check_positions(limits, path)
    s = grid_points(path, int(grid))
    planner = Planner(compile_arm(arm), limits, path, s, ends)
    check_holding(planner)
    try:
        profile, used = planner.plan()
    except ScenarioError as error:
        raise too_weak_to_move(planner) or error from None
    if profile.stuck is not None:
        raise no_way(planner, profile)
    excess = max(float(each.max()) for each in used.values()) - 1.0
    return PathMotion(path, s, profile.x, float(time), used, excess)


def grid_points(path: JointPath, count: int) -> np.ndarray:
    """(m,) s from 0 to the path's length, about evenly spread: breaks and turns of the path, where friction changes its sign,
    are among them, and some more near both ends.

    Args:
        path: q(s).   count: of even pieces.
    """
    even = path.length / count
    fixed = list(path.breaks)
    for s in path.turns:
        if np.abs(np.subtract(fixed, s)).min() > NEAR * even:
            fixed.append(s)
    fixed = np.sort(fixed)
    pieces = np.ceil(np.diff(fixed) / even - ROUNDING).clip(1).astype(int)
    parts = [a + (b - a) * np.arange(k) / k for a, b, k in zip(fixed, fixed[1:], pieces, strict=False)]
    s = np.concatenate([*parts, fixed[-1:]])
    first, last = (s[1] - s[0]) * np.array(END), (s[-1] - s[-2]) * np.array(END[::-1])
    return np.concatenate([s[:1], s[0] + first, s[1:-1], s[-1] - last, s[-1:]])

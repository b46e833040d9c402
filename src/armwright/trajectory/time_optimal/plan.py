"""Time-optimal motions along a path under limits of velocity, acceleration, torque and voltage."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from armwright.collision import Clearance
from armwright.entry import AnyArm, as_arm
from armwright.errors import ScenarioError
from armwright.kernels.compiled import KERNELS, CompiledArm, compile_arm
from armwright.model import Model
from armwright.model.changes import without_servos
from armwright.model.payload import Payload
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.path import JointPath
from armwright.trajectory.poses import check_number
from armwright.trajectory.time_optimal.feasibility import (
    check_distances,
    check_holding,
    check_limits,
    check_positions,
    no_way,
    squared_speeds,
    too_weak_to_move,
)
from armwright.trajectory.time_optimal.heat import cooled
from armwright.trajectory.time_optimal.jerk_limited import has_jerk_limits, jerk_limited
from armwright.trajectory.time_optimal.motion import PathMotion
from armwright.trajectory.time_optimal.planner import Planner, largest
from armwright.trajectory.time_optimal.timing import PathTiming
from armwright.trajectory.time_optimal.whole_cells import WholeCells

SUPPORT = KERNELS.named("time_optimal")

GRID = 500
LEAST_GRID, MOST_GRID = 10, 5_000  # more change no digit that anybody needs
BETWEEN = 24  # grid points between two breaks of the path, on average, unless there are too many breaks for that
FINER = 3  # grids, each twice as fine, for a plan that …
SLOWER = 1.05  # times what the limits at grid points allow is slower for what lies between them
NEAR = 0.02  # of an even piece: a turn that near to another grid point is none of its own
ROUNDING = 1e-9  # of a piece
GRADED = 10  # of the grid points one, and …
MOST_GRADED = 60  # … pieces at most grow evenly in length from either end on: from rest they are passed in equal times


def time_optimal(
    arm: AnyArm,
    path: Any,
    limits: MotionLimits | None = None,
    *,
    payload: Payload | None = None,
    grid: int = GRID,
    speeds: tuple[float, float] = (0.0, 0.0),
    time: float = 0.0,
    clearance: Clearance | None = None,
    rms_torque: Any = None,
) -> PathMotion:
    """The fastest motion along a path within the limits of arm and motors:  min ∫ ds/ṡ.

    |q̇|, |q̈|, |tau(q, q̇, q̈)| and |V| = |R tau/(n Kt) + n Ke q̇| stay below their limits, with tau by the compiled inverse dynamics:
    rotors, friction of every law and lossy gears included. Sets of ṡ² from which the end is reached are found backwards, the
    largest ṡ² in them forwards, by exact linear programs [BobrowEtAl1985], [PhamPham2018]. Limits of velocity and acceleration
    alone hold between grid points by construction. With torques and voltages, whose tangents are taken again until the plan
    settles, it is judged on a denser grid; limits that it exceeds there are shrunk, and it is made again. Friction may forbid
    speeds between lower and higher ones: no plan passes through them, but one that begins below may miss a way above.

    Accelerations jump, unless limits of jerk are stated, for motions from rest to rest: then q̈ is continuous, 0 at both ends, and
    |q⃛| stays below its limit beside all others, in a local optimum.

    The motors' heat over the whole motion, √(∫ tau² dt / T) ≤ `rms_torque`, is kept by an outer search over plans within less
    torque, each played as slowly as it takes: for a mass on a straight line 7.5 % longer than the fastest there is.

    Args:
        arm: the model.   path: a `JointPath`, or waypoints (k, n) [rad | m] of one.   limits: None: the record's.
        payload: a body in the hand for the whole motion; its time does not count.
        grid: number of grid points, about; breaks of the path are among them, and some more at both ends. Between two breaks
            there are 48 at least with limits of velocity and acceleration alone, else 16 on average. Where they are too few to
            keep the limits between them without losing time, they are doubled, twice at most.
        speeds: path speeds ṡ at the beginning and the end.   time: [s] of the beginning.
        clearance: of the arm; a path that comes nearer than its least distance is refused.
        rms_torque: continuous torque of the motors, referred to the joints [N m | N]: one number, (n,), or a mapping by joint
            whose others are not limited; from rest to rest only.
    Returns:
        motion: along the path; `motion.used` tells where which limit is reached.
    Raises:
        ScenarioError: a path outside the position limits or too near to something, limits that cannot be judged or that nothing
            satisfies, with the place on the path, the joint and by how much.   ModelError: no arm.
    Example:
        >>> path = aw.trajectories.JointPath([[0.0] * 6, [0.7, 0.3, 0.5, 0.2, -0.6, 0.1]])
        >>> fast = aw.trajectories.time_optimal("cmu-dd", path, grid=100)
        >>> round(fast.duration, 2)  # within the motors' torques and voltages
        0.25
        >>> free = {"acceleration": 20.0, "torque": float("inf"), "voltage": float("inf")}
        >>> limits = aw.trajectories.MotionLimits.of("cmu-dd", jerk=400.0, **free)
        >>> round(aw.trajectories.time_optimal("cmu-dd", path, limits).duration, 2)  # smooth
        0.43
    """
    arm = as_arm(arm)
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
        if not isinstance(payload, Payload):
            raise ScenarioError(place="payload", value=payload, expected="an aw.Payload")
        arm = arm.with_payload(payload.mass, payload.com, payload.inertia, payload.frame)
    free = limits.replace(torque=np.inf)
    continuous = free.torque if rms_torque is None else free.read("rms_torque", "torque", rms_torque)
    for what, is_limited in (("rms_torque", np.isfinite(continuous).any()), ("jerk", has_jerk_limits(path, limits))):
        if is_limited and any(ends):
            expected = "(0, 0): motions that are slower as a whole are tried"
            raise ScenarioError(f"with a limit of {what}", place="speeds", value=speeds, expected=expected)
    check_limits(arm, limits, path, continuous)
    check_positions(limits, path)
    if clearance is not None:
        check_distances(arm, clearance, path)
    plan = partial(_planned, arm, path, grid=int(grid), ends=ends, time=float(time))
    motion = plan(limits)
    if np.isinf(continuous).all():
        return motion
    return cooled(compile_arm(without_servos(arm)), motion, limits, continuous, plan)


def _planned(
    arm: Model, path: JointPath, limits: MotionLimits, *, grid: int, ends: tuple[float, float], time: float
) -> PathMotion:
    """The fastest motion within limits that hold at every time; see `time_optimal`."""
    if not np.isfinite([limits.torque, limits.voltage]).any():
        cells = WholeCells.of(path, limits, grid)
        timing = PathTiming(cells.s, cells.fastest(ends), ramps=False)
        if has_jerk_limits(path, limits):
            return _smooth(arm, path, limits, timing, time)
        used = cells.used(timing.x)
        return PathMotion(path, timing.s, timing.x, time, used, largest(used) - 1.0, SUPPORT.notes(arm), ramps=False)
    dyn, best, failure = compile_arm(without_servos(arm)), None, None
    least = max(grid, min(BETWEEN * (len(path.breaks) - 1), MOST_GRID))
    for count in (least * 2**k for k in range(FINER)):
        planner = Planner(dyn, limits, path, grid_points(path, count), ends)
        if best is None and failure is None:
            check_holding(planner)
        try:
            profile, used = planner.plan()
        except ScenarioError as error:
            weak = too_weak_to_move(planner)
            if weak is not None:
                raise weak from None
            failure = error
            continue
        if profile.stuck is not None:
            failure = no_way(planner, profile)
            break
        excess = largest(used) - 1.0
        motion = PathMotion(path, planner.s, profile.x, time, used, excess, SUPPORT.notes(arm), planner.ramps)
        if best is None or motion.duration < best.duration:
            best = motion
        if motion.duration <= SLOWER * planner.least:
            break
    if best is None:
        assert failure is not None
        raise failure
    if has_jerk_limits(path, limits):
        return _smooth(arm, path, limits, PathTiming(best.s, best.x, best.ramps), time, dyn)
    return best


def _smooth(
    arm: Model, path: JointPath, limits: MotionLimits, fastest: PathTiming, time: float, dyn: CompiledArm | None = None
) -> PathMotion:
    """The motion within limits of jerk as well; `dyn` where torques or voltages are limited."""
    timing, used = jerk_limited(path, limits, fastest, dyn)
    return PathMotion(
        path, timing.s, timing.x, time, used, largest(used) - 1.0, SUPPORT.notes(arm), ramps=False, spans=timing.spans
    )


def grid_points(path: JointPath, count: int) -> np.ndarray:
    """(m,) s from 0 to the path's length: breaks and turns of the path, where friction changes its sign, are among them.

    Evenly spread in the middle. Towards both ends, where the arm rests, as the squares of whole numbers: there s grows with the
    square of time, and √x, with what friction and back EMF take, by as much in every piece.

    Args:
        path: q(s).   count: of even pieces.
    """
    even = path.length / count
    turns = path.turns[np.diff(path.turns, prepend=-np.inf) > NEAR * even]
    after = np.searchsorted(path.breaks, turns).clip(1, len(path.breaks) - 1)
    room = np.minimum(np.abs(path.breaks[after] - turns), np.abs(turns - path.breaks[after - 1]))
    fixed = np.sort(np.concatenate([path.breaks, turns[room > NEAR * even]]))
    graded = float(min(count // GRADED, MOST_GRADED))
    numbers = _number(fixed, path.length, even, graded)
    pieces = np.ceil(np.diff(numbers) - ROUNDING).clip(1).astype(int)
    parts = [
        _place(a + (b - a) * np.arange(1, k) / k, path.length, even, graded)
        for a, b, k in zip(numbers, numbers[1:], pieces, strict=False)
    ]
    return np.concatenate([fixed[:1], *(np.append(part, s) for part, s in zip(parts, fixed[1:], strict=True))])


def _number(s: np.ndarray, length: float, even: float, graded: float) -> np.ndarray:
    """Number of pieces, broken ones too, from 0 to s, where pieces grow from both ends on until they are even."""

    def from_end(s: np.ndarray) -> np.ndarray:
        return np.where(s < 0.5 * graded * even, np.sqrt(2.0 * graded * s / even), s / even + 0.5 * graded)

    half, near = from_end(np.array(0.5 * length)), from_end(np.minimum(s, length - s).clip(0.0))
    return np.where(s <= 0.5 * length, near, 2.0 * half - near)


def _place(number: np.ndarray, length: float, even: float, graded: float) -> np.ndarray:
    """s at numbers of pieces: the inverse of `_number`."""
    whole = float(_number(np.array(length), length, even, graded))
    near = np.minimum(number, whole - number)
    s = even * np.where(near < graded, near * near / (2.0 * graded), near - 0.5 * graded)
    return np.where(number <= 0.5 * whole, s, length - s)

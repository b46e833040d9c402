"""Inverse kinematics by descent from many starts, in native code: every lane works on a target until it is solved."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, lru_cache
from typing import Any, Literal, get_args

import numpy as np

from armwright.entry import AnyArm, as_arm
from armwright.errors import ModelError, ShapeError
from armwright.features import Support
from armwright.ik.chain import Chain
from armwright.ik.closed_form.branches import ClosedForm
from armwright.ik.closed_form.nearly import closed_form
from armwright.ik.descent import descent
from armwright.ik.goals import GOALS, Goal
from armwright.ik.several import best_different, descended
from armwright.ik.solutions import PoseSolutions
from armwright.ik.starts import RANKED, Starts
from armwright.ik.targets import checked_array, checked_targets
from armwright.kernels.batch import Kernel
from armwright.kernels.compiled import compile_arm
from armwright.kernels.loop import LoopArrays, NativeLoop, Tasks
from armwright.kernels.stages import Call, Exchange
from armwright.kernels.target import select_target
from armwright.kinematics.aim import Aim
from armwright.kinematics.reach import reach
from armwright.model import Model
from armwright.other_names import answering
from armwright.program import trace
from armwright.scalar import Array, Scalar, real_number

SUPPORT = Support(
    "ik",
    without_effect={
        "all but geometry": "poses depend on frames and position limits alone",
        "payload": "poses depend on frames and position limits alone",
    },
)

ATTEMPTS = 1000  # starts of one target, at most
CHUNK = 8192  # targets of one call of native code
MOST_SOLUTIONS = 64  # of one target
MARGIN = 0.3  # of the tolerance: where a descent ends
ANGLE_SHARE = 1.0 / 3.0  # of the reach: what a turn by 1 rad counts as


class Solver:
    """The native code that solves an arm's targets, made once for each arm, frame, aim and tolerance."""

    def __init__(self, chain: Chain, tolerance: float, near: bool, attempts: int = ATTEMPTS):
        self.chain, self.target, self.tolerance = chain, select_target(), MARGIN * tolerance
        options = {} if chain.frame is None else {"frame": chain.frame}
        self._poses = compile_arm(chain.model).kernel("forward_kinematics", **options)
        self.starts = Starts(chain, self._poses, self.target)
        n, task = chain.n, chain.task_size + chain.n * near
        ranked = RANKED + near  # the first attempt is the given start
        program = descent(chain, self.tolerance, near)
        self._loop = NativeLoop((Exchange(task, n + 1, n + 3, attempts, ranked), Call(program)), self.target)

    def solve(
        self, poses: np.ndarray, near: np.ndarray | None, threads: int, ranks: np.ndarray | None = None
    ) -> np.ndarray:
        """(k, n + 3): joint positions, squared error [m²], iterations and attempts for poses (k, 4, 4).

        Args:
            poses: where to.   near: (k, n) positions to begin with, of a solver that takes them.
            threads: for large batches.   ranks: (RANKED,) starts to try first, in place of those nearest to each pose.
        """
        results = np.empty((len(poses), self.chain.n + 3))
        parts = [slice(first, first + CHUNK) for first in range(0, len(poses), CHUNK)]

        def part(which: slice) -> None:
            self._solve(poses[which], None if near is None else near[which], ranks, results[which])

        if threads == 1 or len(parts) == 1:
            for each in parts:
                part(each)
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(part, parts))
        return results

    @cached_property
    def _patient(self) -> NativeLoop:
        """One long descent from given positions."""
        n, task = self.chain.n, self.chain.task_size + self.chain.n
        program = descent(self.chain, self.tolerance, near=True, patient=True)
        return NativeLoop((Exchange(task, n + 1, n + 3, 1, 1), Call(program)), self.target)

    def nearest(self, poses: np.ndarray, q: np.ndarray) -> np.ndarray:
        """(k, n) positions as near to poses out of reach as a long descent from positions (k, n) comes."""
        results = np.empty((len(q), self.chain.n + 3))
        tasks = np.concatenate([self.chain.tasks(poses), q], axis=1)
        self._run(self._patient, tasks, np.zeros((len(q), 1)), results)
        return results[:, : self.chain.n]

    @cached_property
    def errors(self) -> Kernel:
        """Compiled  q (k, n), poses (k, 4, 4) → distance (k,) [m], angle (k,) [rad], margin to the limits (k,)."""

        def errors(q: Array, target: Array) -> tuple[Scalar, Scalar, Scalar]:
            return *self.chain.errors(q, target), self.chain.margin(q)

        shapes = {"q": (self.chain.n,), "target": (4, 4)}
        return Kernel(trace("errors", errors, shapes, ("position", "angle", "margin")), self.target)

    def solved(self, q: np.ndarray, poses: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
        """(k,) True where positions (k, n) within the limits bring the frame to poses (k, 4, 4); and (k,) [m] how far off it is.

        Beyond the limits, or where there are no positions, it is infinitely far off.
        """
        position, angle, margin = self.errors(q, poses)
        off, within = np.hypot(position, self.chain.weight * angle), margin >= 0.0
        return (position <= tolerance) & (angle <= tolerance) & within, np.where(within, off, np.inf)

    def _solve(self, poses: np.ndarray, near: np.ndarray | None, given: np.ndarray | None, results: np.ndarray) -> None:
        tasks, features = self.chain.places(poses)
        ranks = self.starts.ranked(tasks, features) if given is None else np.tile(given, (len(tasks), 1))
        if near is not None:
            tasks, ranks = np.concatenate([tasks, near], axis=1), np.concatenate([ranks[:, :1], ranks], axis=1)
        self._run(self._loop, tasks, ranks, results)

    def _run(self, loop: NativeLoop, tasks: np.ndarray, ranks: np.ndarray, results: np.ndarray) -> None:
        lanes = loop.lanes(self.target.width)
        lanes.blocks["over"].fill(2.0)
        lanes.blocks["task_number"].fill(-1.0)
        queue = np.array([0, len(tasks)])
        work = Tasks(queue, np.ascontiguousarray(tasks), self.starts.rows, np.ascontiguousarray(ranks), results)
        loop.run(lanes, 0.0, (0, 2**62), LoopArrays(tasks=work))


@lru_cache(maxsize=16)
def solver(
    model: Model, frame: str | None, aim: Aim, tolerance: float, near: bool, weight: float | None = None
) -> Solver:
    """The solver of an arm, kept for the next call."""
    if weight is not None:
        return Solver(Chain(model, frame, float(weight), aim), tolerance, near)
    length = float(reach(model, frame))
    weight = ANGLE_SHARE * length if np.isfinite(length) and length > 0.0 else 1.0
    return Solver(Chain(model, frame, weight, aim), tolerance, near)


@answering
def inverse_kinematics(
    arm: AnyArm,
    targets: Any,
    *,
    frame: str | None = None,
    aim: str | Aim | None = None,
    near: Any = None,
    tolerance: float = 1e-8,
    method: Method = "auto",
    goal: Goal | None = None,
    solutions: int | None = None,
    length: float | None = None,
    threads: int = 1,
) -> PoseSolutions:
    """Joint positions within the limits that bring the tip, or another frame, to poses.

    In closed form where the arm's six axes allow it: all eight branches, each checked by forward kinematics. [EliasWen2025]
    Else, and where none of them is a solution, by damped least squares from starts whose own pose is near the target,
    then from others, up to 1000 of them; all in one compiled loop, whose lanes take the next target when one is done. The
    result for a target does not depend on its neighbours. [Marquardt1963]

    Args:
        arm: whose joints move.   targets: (…, 4, 4) poses of the frame in the base, or (…, 3) positions alone [m].
        frame: name of a frame of the arm; by default its tip.
        aim: part of the poses that counts besides the position; by default what targets say.
            "pose": the whole orientation; "position": none of it.
            "axis": the direction of the frame's z axis, free to turn about it; of others "axis x", "axis y".
            "pitch": the angle of the frame's z axis to the base's xy plane; "pitch x", "pitch y".
            "yaw": the direction of the frame's x axis, seen along the base's z axis; "yaw y", "yaw z".
            "base xy", "tool z", …: components about these axes of the rotation (angle times axis) from the frame to its
            target that must be 0, in axes of the base or of the frame.
        near: (…, n) or (n,) joint positions to begin with [rad | m]; the solution is as a rule the one nearest to them. Without
            them that of a closed form is the one farthest from the limits.
        tolerance: on the distance [m] and on the angle [rad].   threads: for large batches.
        method: "auto", "numeric", or "closed-form", which leaves targets that it does not solve without positions (NaN).
        goal: the solution that is "nearest" to `near` (least Σ (q - near)²), farthest from the "limits" (least Σ of squared
            distances from the middles of the joints' ranges, in halves of them), or of most "manipulability" (angles times
            `length`). Of several descents; joints that a pose leaves free then move until the goal grows no better. The result
            is the best of these, not proven to be the best of all. [Liegeois1977]
        solutions: how many are wanted that differ by 0.05 rad or m of a joint: one more axis (…, solutions, n), best first: by
            the goal, else by `near`, else by distance to limits; nan and success False where fewer were found.
        length: [m/rad] of angles against lengths, where a target is not reached; by default a third of the arm's reach.
    Returns:
        solutions: of every target; those that are out of reach have the nearest positions and say how far off they are.
    Raises:
        ShapeError: targets or starts of a wrong shape, or rotation matrices alone.   ModelError: no arm, no pose (no rotation
            matrix, NaN), no such frame, a tolerance below 1e-12, an arm that branches and names no tip, or one without the
            closed form that is asked for.
    """
    arm = as_arm(arm)
    poses, shape, part = checked_targets(targets, aim)
    limit = real_number(tolerance)
    if limit is None or not 1e-12 <= limit < 1.0:
        raise ModelError(place="tolerance", value=tolerance, expected="a number from 1e-12 to 1 [m and rad]")
    if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
        raise ModelError(place="threads", value=threads, expected="a whole number, 1 or more")
    starts = None
    if near is not None:
        starts = checked_array(near, "near")
        fits = starts.shape[-1:] == (arm.n,) and starts.shape[:-1] in ((), shape)
        if not fits or not np.isfinite(starts).all():
            expected = f"{arm.n} finite numbers, or as many for each target"
            raise ShapeError(place="near", value=starts.shape if not fits else near, expected=expected)
        starts = np.broadcast_to(starts, (*shape, arm.n)).reshape(-1, arm.n)
    _check_choice(goal, starts is not None, solutions, length)
    closed = _closed_form(arm, frame, part, method, starts is not None)
    if goal is not None or solutions is not None:
        plain = solver(arm, frame, part, limit, False, length)
        begins = None if starts is None else solver(arm, frame, part, limit, True, length)
        if closed is None:
            candidates = descended(plain, begins, poses, starts, solutions or 1, threads)
        else:
            candidates = closed.solve(poses, starts, limit, threads)[0].q
            if method == "auto":
                candidates = np.concatenate([candidates, plain.solve(poses, None, threads)[:, None, : arm.n]], axis=1)
        q = best_different(plain, poses, candidates, starts, goal, solutions or 1, limit)
        return _several(plain, q, poses, shape, solutions, limit)
    if closed is None:
        values, more = _numeric(arm, frame, part, limit, poses, starts, length, threads), {}
    else:
        branches, best = closed.solve(poses, starts, limit, threads)
        values, branch = _of_branches(best)
        left = np.flatnonzero(branch < 0)
        if len(left) and method == "auto":
            some = _numeric(
                arm, frame, part, limit, poses[left], None if starts is None else starts[left], length, threads
            )
            for every, found in zip(values, some, strict=True):
                every[left] = found
        more = {
            "method": f"{closed.kind} ({closed.geometry.description})",
            "branches": branches.reshaped(shape),
            "branch": branch.reshape(shape),
        }
    return PoseSolutions(
        *(each.reshape((*shape, *each.shape[1:])) for each in values), tolerance=limit, arm=arm, **more
    )


Method = Literal["auto", "closed-form", "numeric"]


def _closed_form(arm: Model, frame: str | None, aim: Aim, method: Method, near: bool) -> ClosedForm | None:
    """The closed form that a call uses.

    Raises:
        ModelError: it is asked for and there is none.
    """
    if method not in get_args(Method):
        raise ModelError(place="method", value=method, choices=get_args(Method))
    found = closed_form(arm, frame, near) if aim.kind == "pose" and method != "numeric" else None
    if found is None and method == "closed-form":
        expected = "six joints whose axes meet or are parallel as one needs, a frame of the last link and whole poses"
        what = (
            f"{arm.name} has no closed form"
            if aim.kind == "pose"
            else f"a closed form needs whole poses, not aim = {str(aim)!r}"
        )
        raise ModelError(what, place="method", value=method, expected=expected)
    return found


def _of_branches(best: np.ndarray) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Positions, success, errors, margins, iterations and attempts (k, …) of the best branches, and their numbers (k,)."""
    n, branch = best.shape[1] - 4, best[:, -1].astype(int)
    none = np.zeros((2, len(best)), int)
    return (best[:, :n], branch >= 0, best[:, n], best[:, n + 1], best[:, n + 2], *none), branch


def _numeric(
    arm: Model,
    frame: str | None,
    aim: Aim,
    tolerance: float,
    poses: np.ndarray,
    starts: np.ndarray | None,
    weight: float | None,
    threads: int,
) -> tuple[np.ndarray, ...]:
    """Positions, success, errors, margins, iterations and attempts (k, …) by descent."""
    chosen = solver(arm, frame, aim, tolerance, starts is not None)
    found = chosen.solve(poses, starts, threads)
    q = found[:, : arm.n]
    missed = np.flatnonzero(found[:, arm.n] >= (chosen.tolerance * min(1.0, chosen.chain.weight)) ** 2)
    if len(missed):
        if weight is not None:  # which says what is nearest, and must not decide what is found
            chosen = solver(arm, frame, aim, tolerance, starts is not None, weight)
            found[missed] = chosen.solve(poses[missed], None if starts is None else starts[missed], threads)
        q[missed] = chosen.nearest(poses[missed], q[missed])
    if starts is not None:
        q = chosen.chain.nearest_turns(q, starts)
    position, angle, margin = chosen.errors(q, poses)
    success = (position <= tolerance) & (angle <= tolerance) & (margin >= 0.0)
    return q, success, position, angle, margin, *found[:, -2:].astype(int).T


def _several(
    solver: Solver,
    q: np.ndarray,
    poses: np.ndarray,
    shape: tuple[int, ...],
    solutions: int | None,
    tolerance: float,
) -> PoseSolutions:
    """Results (…, solutions) of positions (k, solutions, n); without `solutions` the axis is left out."""
    count = q.shape[1]
    flat, targets = q.reshape(-1, q.shape[2]), np.repeat(poses, count, axis=0)
    position, angle, margin = solver.errors(flat, targets)
    success = (position <= tolerance) & (angle <= tolerance) & (margin >= 0.0)  # False of nan
    values = (flat, success, position, angle, margin, *np.zeros((2, len(flat)), int))
    lead = shape if solutions is None else (*shape, count)
    shaped = (each.reshape((*lead, *each.shape[1:])) for each in values)
    return PoseSolutions(*shaped, tolerance=tolerance, arm=solver.chain.model, several=solutions is not None)


def _check_choice(goal: Goal | None, near: bool, solutions: int | None, weight: float | None) -> None:
    """Refuses a goal, a count or a weight that is none.

    Raises:
        ModelError: names it.
    """
    if goal is not None and goal not in GOALS:
        raise ModelError(place="goal", value=goal, choices=GOALS)
    if goal == "nearest" and not near:
        raise ModelError(place="goal", value=goal, expected="near, the joint positions to be nearest to")
    whole = isinstance(solutions, int) and not isinstance(solutions, bool) and 1 <= solutions <= MOST_SOLUTIONS
    if solutions is not None and not whole:
        raise ModelError(place="solutions", value=solutions, expected=f"a whole number from 1 to {MOST_SOLUTIONS}")
    length = None if weight is None else real_number(weight)
    if weight is not None and (length is None or not 1e-6 <= length <= 1e6):
        raise ModelError(place="length", value=weight, expected="a number from 1e-6 to 1e6 [m/rad]")

"""Inverse kinematics: in closed form where the arm's axes allow it, else by descent from many starts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, get_args

import numpy as np

from armwright.entry import AnyArm, as_arm
from armwright.errors import ModelError, ShapeError, check_known
from armwright.features import Support
from armwright.ik.closed_form.branches import ClosedForm
from armwright.ik.closed_form.nearly import closed_form
from armwright.ik.goals import Goal
from armwright.ik.several import best_different, descended
from armwright.ik.solutions import PoseBranches, PoseSolutions
from armwright.ik.solver import solver
from armwright.ik.targets import checked_array, checked_targets
from armwright.kinematics.aim import Aim
from armwright.model import Model
from armwright.other_names import answering
from armwright.scalar import real_number

SUPPORT = Support(
    "ik",
    without_effect={
        "all but geometry": "poses depend on frames and position limits alone",
        "payload": "poses depend on frames and position limits alone",
    },
)

MOST_SOLUTIONS = 64  # of one target
Method = Literal["auto", "closed-form", "numeric"]


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
    goal: str | Goal | None = None,
    solutions: int | None = None,
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
        goal: the solution that is "nearest" to `near`, farthest from the "limits" or of most "manipulability"; a `Goal` also says
            what an angle counts as against a length. Of several descents; joints that a pose leaves free then move until the
            goal grows no better. The result is the best of these, not proven to be the best of all. [Liegeois1977]
        solutions: how many are wanted that differ by 0.05 rad or m of a joint: one more axis (…, solutions, n), best first: by
            the goal, else by `near`, else by distance to limits; nan and success False where fewer were found.
    Returns:
        solutions: of every target; those that are out of reach have the nearest positions and say how far off they are.
    Raises:
        ShapeError: targets or starts of a wrong shape, or rotation matrices alone.   ModelError: no arm, no pose (no rotation
            matrix, NaN), no such frame, a tolerance below 1e-12, an arm that branches and names no tip, or one without the
            closed form that is asked for.
    Example:
        >>> arm = aw.load("ur5e")
        >>> goal = aw.forward_kinematics(arm, [0.0, -1.0, 1.2, -0.5, 0.8, 0.0])
        >>> found = aw.inverse_kinematics(arm, goal, near=[0.1, -0.9, 1.1, -0.4, 0.7, 0.1])
        >>> found.q.round(4)
        array([ 0. , -1. ,  1.2, -0.5,  0.8,  0. ])
    """
    arm = as_arm(arm)
    poses, shape, part = checked_targets(targets, aim)
    limit, wanted = real_number(tolerance), Goal.of(goal)
    if limit is None or not 1e-12 <= limit < 1.0:
        raise ModelError(place="tolerance", value=tolerance, expected="a number from 1e-12 to 1 [m and rad]")
    if not _is_count(threads):
        raise ModelError(place="threads", value=threads, expected="a whole number, 1 or more")
    starts = None if near is None else _checked_starts(near, arm.n, shape)
    if wanted.best == "nearest" and starts is None:
        raise ModelError(place="goal", value=wanted.best, expected="near, the joint positions to be nearest to")
    if solutions is not None and not _is_count(solutions, MOST_SOLUTIONS):
        raise ModelError(place="solutions", value=solutions, expected=f"a whole number from 1 to {MOST_SOLUTIONS}")
    check_known(ModelError, method, get_args(Method), place="method")
    asked, whole = _Targets(poses, shape, part, starts, limit, wanted, threads), part.kind == "pose"
    closed = closed_form(arm, frame, starts is not None) if whole and method != "numeric" else None
    if closed is None and method == "closed-form":
        expected = "six joints whose axes meet or are parallel as one needs, a frame of the last link and whole poses"
        no_aim = f"a closed form needs whole poses, not aim = {str(part)!r}"
        what = f"{arm.name} has no closed form" if whole else no_aim
        raise ModelError(what, place="method", value=method, expected=expected)
    if wanted.best is not None or solutions is not None:
        return _several(arm, frame, asked, closed, solutions, numeric=method != "closed-form")
    if closed is None:
        return PoseSolutions(*asked.shaped(_numeric(arm, frame, asked)), tolerance=limit, arm=arm)
    values, branches, branch = _in_closed_form(closed, asked)
    left = np.flatnonzero(branch < 0)
    if len(left) and method == "auto":
        for every, found in zip(values, _numeric(arm, frame, asked.only(left)), strict=True):
            every[left] = found
    how = f"{closed.kind} ({closed.geometry.description})"
    more = {"method": how, "branches": branches.reshaped(shape), "branch": branch.reshape(shape)}
    return PoseSolutions(*asked.shaped(values), tolerance=limit, arm=arm, **more)


@dataclass(frozen=True, eq=False)
class _Targets:
    """Targets, checked, and what is asked of their solutions.

    Attributes:
        poses: (k, 4, 4).   shape: of their batch.   aim: what counts of them.   near: (k, n) positions to begin with, or None.
        tolerance: [m] and [rad].   goal: which solution is wanted.   threads: for large batches.
    """

    poses: np.ndarray
    shape: tuple[int, ...]
    aim: Aim
    near: np.ndarray | None
    tolerance: float
    goal: Goal
    threads: int

    def only(self, rows: np.ndarray) -> _Targets:
        """Some of the targets."""
        return replace(self, poses=self.poses[rows], near=None if self.near is None else self.near[rows])

    def shaped(self, values: Sequence[np.ndarray], *axis: int) -> Iterator[np.ndarray]:
        """Values (k, …) in the shape of the batch, with one more axis where it is given."""
        return (each.reshape((*self.shape, *axis, *each.shape[1:])) for each in values)


def _is_count(value: Any, most: float = np.inf) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= most


def _checked_starts(near: Any, n: int, shape: tuple[int, ...]) -> np.ndarray:
    """(k, n) positions to begin with, one for each target.

    Raises:
        ShapeError: of other joints or targets, or not finite.
    """
    starts = checked_array(near, "near")
    fits = starts.shape[-1:] == (n,) and starts.shape[:-1] in ((), shape)
    expected = f"{n} finite numbers, or as many for each target"
    if not fits:
        raise ShapeError(f"shape {starts.shape}", place="near", expected=expected)
    if not np.isfinite(starts).all():
        raise ShapeError(place="near", value=near, expected=expected)
    return np.broadcast_to(starts, (*shape, n)).reshape(-1, n)


def _in_closed_form(closed: ClosedForm, targets: _Targets) -> tuple[tuple[np.ndarray, ...], PoseBranches, np.ndarray]:
    """Positions, success, errors, margins, iterations and attempts (k, …) of the best branches; all of them; numbers (k,)."""
    branches, best = closed.solve(targets.poses, targets.near, targets.tolerance, targets.threads)
    n, branch = best.shape[1] - 4, best[:, -1].astype(int)
    none = np.zeros((2, len(best)), int)
    return (best[:, :n], branch >= 0, best[:, n], best[:, n + 1], best[:, n + 2], *none), branches, branch


def _numeric(arm: Model, frame: str | None, targets: _Targets) -> tuple[np.ndarray, ...]:
    """Positions, success, errors, margins, iterations and attempts (k, …) by descent."""
    poses, near, length = targets.poses, targets.near, targets.goal.length
    of_arm = partial(solver, arm, frame, targets.aim, targets.tolerance, near is not None)
    chosen = of_arm()
    found = chosen.solve(poses, near, targets.threads)
    q = found[:, : arm.n]
    missed = np.flatnonzero(found[:, arm.n] >= (chosen.tolerance * min(1.0, chosen.chain.weight)) ** 2)
    if len(missed):
        if length is not None:  # which says what is nearest, and must not decide what is found
            chosen = of_arm(length)
            found[missed] = chosen.solve(poses[missed], None if near is None else near[missed], targets.threads)
        q[missed] = chosen.nearest(poses[missed], q[missed])
    if near is not None:
        q = chosen.chain.nearest_turns(q, near)
    return q, *chosen.judged(q, poses, targets.tolerance), *found[:, -2:].astype(int).T


def _several(
    arm: Model, frame: str | None, targets: _Targets, closed: ClosedForm | None, solutions: int | None, *, numeric: bool
) -> PoseSolutions:
    """The best solutions by a goal, one more axis of each target; without `solutions` one, and no axis."""
    poses, near, limit, threads = targets.poses, targets.near, targets.tolerance, targets.threads
    of_arm = partial(solver, arm, frame, targets.aim, limit)
    plain, count = of_arm(False, targets.goal.length), solutions or 1
    if closed is None:
        begins = None if near is None else of_arm(True, targets.goal.length)
        candidates = descended(plain, begins, poses, near, count, threads)
    else:
        candidates = closed.solve(poses, near, limit, threads)[0].q
        if numeric:
            candidates = np.concatenate([candidates, plain.solve(poses, None, threads)[:, None, : arm.n]], axis=1)
    q = best_different(plain, poses, candidates, near, targets.goal.best, count, limit)
    flat = q.reshape(-1, arm.n)
    values = (flat, *plain.judged(flat, np.repeat(poses, count, axis=0), limit), *np.zeros((2, len(flat)), int))
    axis = () if solutions is None else (solutions,)
    return PoseSolutions(*targets.shaped(values, *axis), tolerance=limit, arm=arm, several=solutions is not None)

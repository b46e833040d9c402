"""Inverse kinematics by descent from many starts, in native code: every lane works on a target until it is solved."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from functools import lru_cache
from typing import Any, Literal, get_args

import numpy as np

from armwright.errors import ModelError, ShapeError
from armwright.ik.chain import TURN, Aim, Chain, angles_between
from armwright.ik.closed_form.branches import ClosedForm, closed_form
from armwright.ik.descent import descent
from armwright.ik.pose_defect import pose_defects
from armwright.ik.solutions import PoseBranches, PoseSolutions
from armwright.ik.starts import RANKED, Starts
from armwright.kernels.compiled import compile_arm
from armwright.kernels.loop import Loop, Tasks
from armwright.kernels.stages import Call, Exchange
from armwright.kernels.target import select_target
from armwright.kinematics.reach import reach
from armwright.model import Model
from armwright.scalar import real_number, real_numbers

ATTEMPTS = 1000  # starts of one target, at most
CHUNK = 8192  # targets of one call of native code
ORTHOGONAL = 1e-6  # of the entries of Rᵀ R - 1
MARGIN = 0.3  # of the tolerance: where a descent ends
ANGLE_SHARE = 1.0 / 3.0  # of the reach: what a turn by 1 rad counts as


class Solver:
    """The native code that solves an arm's targets, made once for each arm, frame, aim and tolerance."""

    def __init__(self, chain: Chain, tolerance: float, near: bool, attempts: int = ATTEMPTS):
        self.chain, self.target = chain, select_target()
        options = {} if chain.frame is None else {"frame": chain.frame}
        self._poses = compile_arm(chain.model).kernel("forward_kinematics", **options)
        self.starts = Starts(chain, self._poses, self.target)
        n, task = chain.n, chain.task_size + chain.n * near
        ranked = RANKED + near  # the first attempt is the given start
        program = descent(chain, MARGIN * tolerance, near)
        self._loop = Loop((Exchange(task, n + 1, n + 2, attempts, ranked), Call(program)), self.target)

    def solve(self, poses: np.ndarray, near: np.ndarray | None, threads: int) -> np.ndarray:
        """(k, n + 2): joint positions, squared error [m²] and iterations for poses (k, 4, 4)."""
        results = np.empty((len(poses), self.chain.n + 2))
        parts = [slice(first, first + CHUNK) for first in range(0, len(poses), CHUNK)]

        def part(which: slice) -> None:
            self._solve(poses[which], None if near is None else near[which], results[which])

        if threads == 1 or len(parts) == 1:
            for each in parts:
                part(each)
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(part, parts))
        return results

    def errors(self, q: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance (k,) [m] and angle (k,) [rad] from where positions (k, n) bring the frame to poses (k, 4, 4)."""
        reached, aim = self._poses(q), self.chain.aim
        distance = np.linalg.norm(reached[:, :3, 3] - poses[:, :3, 3], axis=1)
        if aim == "position":
            return distance, np.zeros(len(q))
        if aim == "axis":
            half = np.linalg.norm(reached[:, :3, 2] - poses[:, :3, 2], axis=1) / 2.0
            return distance, 2.0 * np.arcsin(np.minimum(half, 1.0))
        return distance, angles_between(reached[:, :3, :3], poses[:, :3, :3])

    def _solve(self, poses: np.ndarray, near: np.ndarray | None, results: np.ndarray) -> None:
        tasks = self.chain.tasks(poses)
        ranks = self.starts.ranked(tasks, poses)
        if near is not None:
            tasks, ranks = np.concatenate([tasks, near], axis=1), np.concatenate([ranks[:, :1], ranks], axis=1)
        lanes = self._loop.lanes(self.target.width)
        lanes.blocks["over"].fill(2.0)
        lanes.blocks["task_number"].fill(-1.0)
        queue = np.array([0, len(tasks)])
        work = Tasks(queue, np.ascontiguousarray(tasks), self.starts.rows, np.ascontiguousarray(ranks), results)
        self._loop.run(lanes, 0.0, (0, 2**62), tasks=work)


@lru_cache(maxsize=16)
def solver(model: Model, frame: str | None, aim: Aim, tolerance: float, near: bool) -> Solver:
    """The solver of an arm, kept for the next call."""
    length = float(reach(model))
    weight = ANGLE_SHARE * length if np.isfinite(length) and length > 0.0 else 1.0
    return Solver(Chain(model, frame, weight, aim), tolerance, near)


def inverse_kinematics(
    arm: Model,
    targets: Any,
    *,
    frame: str | None = None,
    aim: Aim | None = None,
    near: Any = None,
    tolerance: float = 1e-8,
    method: Method = "auto",
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
        aim: "pose", "position", or "axis": the position and the direction of the frame's z axis; by default what targets say.
        near: (…, n) or (n,) joint positions to begin with [rad | m]; the solution is as a rule the one nearest to them. Without
            them that of a closed form is the one farthest from the limits.
        tolerance: on the distance [m] and on the angle [rad].   threads: for large batches.
        method: "auto", "numeric", or "closed-form", which leaves targets that it does not solve without positions (NaN).
    Returns:
        solutions: of every target; those that are out of reach have the nearest positions and say how far off they are.
    Raises:
        ShapeError: targets or starts of a wrong shape.   ModelError: no pose (no rotation matrix, NaN), no such frame, a
            tolerance below 1e-12, an arm that branches and names no tip, or one without the closed form that is asked for.
    """
    poses, shape, aim = checked_targets(targets, aim)
    limit = real_number(tolerance)
    if limit is None or not 1e-12 <= limit < 1.0:
        raise ModelError(place="tolerance", value=tolerance, expected="a number from 1e-12 to 1 [m and rad]")
    if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
        raise ModelError(place="threads", value=threads, expected="a whole number, 1 or more")
    starts = None
    if near is not None:
        starts = real_numbers(near)
        fits = starts.shape[-1:] == (arm.n,) and starts.shape[:-1] in ((), shape)
        if not fits or not np.isfinite(starts).all():
            expected = f"{arm.n} finite numbers, or as many for each target"
            raise ShapeError(place="near", value=starts.shape if not fits else near, expected=expected)
        starts = np.broadcast_to(starts, (*shape, arm.n)).reshape(-1, arm.n)
    closed = _closed_form(arm, frame, aim, method, starts is not None)
    if closed is None:
        values, more = _numeric(arm, frame, aim, limit, poses, starts, threads), {}
    else:
        branches, best = closed.solve(poses, starts, limit, threads)
        values, branch = _of_branches(best)
        left = np.flatnonzero(branch < 0)
        if len(left) and method == "auto":
            some = _numeric(arm, frame, aim, limit, poses[left], None if starts is None else starts[left], threads)
            for every, found in zip(values, some, strict=True):
                every[left] = found
        parts = [getattr(branches, each.name) for each in fields(branches)]
        more = {
            "method": f"closed form ({closed.geometry.description})",
            "branches": PoseBranches(*(part.reshape((*shape, *part.shape[1:])) for part in parts)),
            "branch": branch.reshape(shape),
        }
    return PoseSolutions(*(each.reshape((*shape, *each.shape[1:])) for each in values), tolerance=limit, **more)


Method = Literal["auto", "closed-form", "numeric"]


def _closed_form(arm: Model, frame: str | None, aim: Aim, method: Method, near: bool) -> ClosedForm | None:
    """The closed form that a call uses.

    Raises:
        ModelError: it is asked for and there is none.
    """
    if method not in get_args(Method):
        raise ModelError(place="method", value=method, choices=get_args(Method))
    found = closed_form(arm, frame, near) if aim == "pose" and method != "numeric" else None
    if found is None and method == "closed-form":
        expected = "six joints whose axes meet or are parallel as one needs, a frame of the last link and whole poses"
        raise ModelError(f"{arm.name} has no closed form", place="method", value=method, expected=expected)
    return found


def _of_branches(best: np.ndarray) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Positions, success, errors, margins and iterations (k, …) of the best branches, and their numbers (k,)."""
    n, branch = best.shape[1] - 4, best[:, -1].astype(int)
    iterations = np.zeros(len(best), int)
    return (best[:, :n], branch >= 0, best[:, n], best[:, n + 1], best[:, n + 2], iterations), branch


def _numeric(
    arm: Model,
    frame: str | None,
    aim: Aim,
    tolerance: float,
    poses: np.ndarray,
    starts: np.ndarray | None,
    threads: int,
) -> tuple[np.ndarray, ...]:
    """Positions, success, errors, margins and iterations (k, …) by descent."""
    chosen = solver(arm, frame, aim, tolerance, starts is not None)
    found = chosen.solve(poses, starts, threads)
    q = found[:, : arm.n]
    if starts is not None:
        q = nearest_turns(chosen.chain, q, starts)
    position, angle = chosen.errors(q, poses)
    low, high = chosen.chain.limits
    with np.errstate(invalid="ignore", divide="ignore"):
        margins = np.minimum(q - low, high - q) / (high - low)
    margin = np.where(np.isfinite(margins), margins, 0.5).min(axis=1, initial=0.5)
    success = (position <= tolerance) & (angle <= tolerance) & (margin >= 0.0)
    return q, success, position, angle, margin, found[:, -1].astype(int)


def checked_targets(targets: Any, aim: Aim | None) -> tuple[np.ndarray, tuple[int, ...], Aim]:
    """Targets as poses (k, 4, 4), the shape of their batch, and what of them counts.

    Raises:
        ShapeError, ModelError: what is no pose; names the first.
    """
    array = real_numbers(targets)
    if aim not in (None, "pose", "position", "axis"):
        raise ModelError(place="aim", value=aim, choices=("pose", "position", "axis"))
    if array.shape[-2:] == (4, 4):
        shape, poses, aim = array.shape[:-2], array.reshape(-1, 4, 4), aim or "pose"
    elif array.shape[-1:] == (3,) and aim in (None, "position"):
        shape, aim = array.shape[:-1], "position"
        poses = np.broadcast_to(np.eye(4), (array.size // 3, 4, 4)).copy()
        poses[:, :3, 3] = array.reshape(-1, 3)
    else:
        expected = "(…, 4, 4) poses" + (" or (…, 3) positions" if aim in (None, "position") else "")
        raise ShapeError(place="targets", value=array.shape, expected=expected)
    right = pose_defects(poses) < ORTHOGONAL  # False of NaN
    wrong = np.flatnonzero(~right)
    if len(wrong):
        k = int(wrong[0])
        place = f"targets[{', '.join(str(i) for i in np.unravel_index(k, shape))}]" if shape else "targets"
        expected = "a rotation matrix, a finite position, and the row 0 0 0 1"
        raise ModelError("no pose", place=place, value=poses[k].tolist(), expected=expected)
    return poses, shape, aim


def nearest_turns(chain: Chain, q: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Positions (k, n) with whole turns of the joints that reach every angle added, as near to others as limits allow."""
    low, high = chain.limits
    turns = np.where(chain.turns_around, np.round((near - q) / TURN), 0.0)
    with np.errstate(invalid="ignore"):
        turns = np.clip(turns, np.ceil((low - q) / TURN), np.floor((high - q) / TURN))
    return np.where(chain.turns_around, q + TURN * turns, q)

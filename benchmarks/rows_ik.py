"""Inverse kinematics: in closed form, all branches, beside EAIK's analytic solver (C++, one thread, no joint limits); numeric,
within the limits, beside Robotics Toolbox's Levenberg-Marquardt in C++, on the same arm and poses."""

# EAIK is a compiled module without stubs, the toolbox is optional.
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false

from __future__ import annotations

import contextlib
import importlib.util
import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from records import Record, Task, record
from timing import Check, Contestant, Entry, race

import armwright as aw
from armwright.kernels import target
from armwright.kinematics.forward_kinematics import body_placements

ARMS = ("puma560", "lwa4p", "cmu-dd")
POSES, QUICK_POSES = 10_000, 100
TOLERANCE = 1e-9  # of entries of poses [1 | m]
EXPECTED = {"eaik": 4.0}
NUMERIC = ("puma560", "lwa4p", "panda", "cmu-dd")
NUMERIC_POSES = 2_000
DESCENT = 3e-8  # of entries of poses [1 | m], where 1e-8 m and rad are asked for
TOOLBOX = {
    "toolbox": 1e-6,
    "toolbox fine": 1e-16,
}  # its tol, of half the squared error: its default, and what ours keeps
TIMES = 40.0
LEAST_SOLVED, TOOLBOX_SOLVED = 0.999, 0.95


def tasks(quick: bool) -> list[Task]:
    """A race for each arm and method."""
    closed = [Task("ik", f"ik closed form {name}", partial(closed_records, name, quick)) for name in ARMS]
    return closed + [Task("ik", f"ik numeric {name}", partial(numeric_records, name, quick)) for name in NUMERIC]


def random_poses(arm: aw.Model, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Random positions (count, n) within the limits and their poses (count, 4, 4)."""
    low, high = np.array([body.limits.position for body in arm.coordinates]).T
    q = np.random.default_rng(0).uniform(low, high, (count, arm.n))
    return q, aw.compile(arm).forward_kinematics(q)


def closed_records(name: str, quick: bool, repetitions: int) -> list[Record]:
    """All branches of poses that random positions within the limits have."""
    arm, count = aw.load(name), QUICK_POSES if quick else POSES
    q, poses = random_poses(arm, count)
    solve = partial(aw.inverse_kinematics, arm, poses, method="closed-form")
    contestants = {"ours": Contestant("ours", solve, count, partial(check, arm, poses, q))}
    peer = {}
    if importlib.util.find_spec("eaik") is not None:
        contestants["eaik"] = Contestant("EAIK", analytic(arm, poses), count, partial(check_peer, arm, poses))
        peer = {"eaik": "ours"}
    labels = {"arm": name, "joints": arm.n, "work": "closed form, all branches", "states": count}
    return [
        record(row) for row in race([Entry(labels, contestants, peer, EXPECTED)], repetitions, clock=time.process_time)
    ]


def check(arm: aw.Model, poses: np.ndarray, q: np.ndarray, found: aw.kinematics.PoseSolutions) -> Check:
    """Largest error of all solutions; NaN where a pose is not solved or the positions that it was computed from are not found."""
    branches = found.branches
    assert branches is not None
    known = np.abs(np.sin((branches.q - q[:, None]) / 2.0)).max(axis=2).min(axis=1).max() < 1e-6  # whole turns aside
    every = np.broadcast_to(poses[:, None], (*branches.success.shape, 4, 4))[branches.success]
    off = np.abs(aw.compile(arm).forward_kinematics(branches.q[branches.success]) - every).max()
    return Check(float(off) if found.success.all() and known else float("nan"), TOLERANCE)


def analytic(arm: aw.Model, poses: np.ndarray) -> Any:
    """EAIK's work: its tip has the base's axes in the zero pose, so poses are turned for it."""
    from eaik.IK_HP import HPRobot

    placed = [body_placements(arm, np.zeros(arm.n))[i] for i in range(arm.n)]
    tip = aw.forward_kinematics(arm, np.zeros(arm.n))
    points = np.array([np.zeros(3), *(each.position for each in placed), tip[:3, 3]])
    robot = HPRobot(np.array([each.rotation[:, 2] for each in placed]), np.diff(points, axis=0))
    turned = poses.copy()
    turned[:, :3, :3] = poses[:, :3, :3] @ tip[:3, :3].T
    targets = [*turned]
    return lambda: robot.IK_batched(targets, 1)


def check_peer(arm: aw.Model, poses: np.ndarray, found: Any) -> Check:
    """Errors of a sample of the peer's solutions that it does not mark as least squares."""
    dyn, off = aw.compile(arm), []
    for each, pose in zip(found[:100], poses, strict=False):
        q = np.array(each.Q)[~np.array(each.is_LS, dtype=bool)]
        off.append(np.abs(dyn.forward_kinematics(q) - pose).max() if len(q) else np.inf)
    return Check(float(max(off)), 1e-6)


def numeric_records(name: str, quick: bool, repetitions: int) -> list[Record]:
    """One solution within the limits of each pose, by descents from many starts."""
    arm, count = aw.load(name), QUICK_POSES if quick else NUMERIC_POSES
    _, poses = random_poses(arm, count)
    solve = partial(aw.inverse_kinematics, arm, poses, method="numeric")
    checked = partial(check_numeric, arm, poses)
    contestants = {"ours": Contestant("ours", solve, count, checked)}
    contestants["default"] = Contestant("ours", partial(aw.inverse_kinematics, arm, poses), count, checked)
    if target.select_target().width > target.WIDTHS["x86-64-v3"]:
        contestants["avx2"] = Contestant("ours, AVX2", narrow(name, poses), count, checked)
    if importlib.util.find_spec("roboticstoolbox") is not None:
        for column, tolerance in TOOLBOX.items():
            checked = partial(check_toolbox, arm, poses, tolerance)
            contestants[column] = Contestant(column, by_toolbox(arm, poses, tolerance), count, checked)
    peers = [column for column in contestants if column in TOOLBOX]
    found = solve()
    facts = {"iterations": float(found.iterations.mean()), "first start": float((found.attempts == 1).mean())}
    labels = {"arm": name, "joints": arm.n, "work": "numeric, one solution", "states": count}
    entry = Entry(labels, contestants, dict.fromkeys(peers, "ours"), dict.fromkeys(peers, TIMES), facts)
    return [record(row) for row in race([entry], repetitions, clock=time.process_time)]


def narrow(name: str, poses: np.ndarray) -> Any:
    """The same work by code for AVX2."""
    with without_avx512():
        arm = aw.load(name)  # another object, for which nothing is compiled yet
        solve = partial(aw.inverse_kinematics, arm, poses, method="numeric")
        solve()
    return solve


@contextlib.contextmanager
def without_avx512() -> Iterator[None]:
    """Lets the block compile as on this processor without AVX-512."""
    whole = target._host_features

    def features() -> dict[str, bool]:
        return {name: has and not name.startswith("avx512") for name, has in whole().items()}

    try:
        target._host_features = features
        target.select_target.cache_clear()
        yield
    finally:
        target._host_features = whole
        target.select_target.cache_clear()


def check_numeric(arm: aw.Model, poses: np.ndarray, found: aw.kinematics.PoseSolutions) -> Check:
    """Largest error of the solutions; NaN where too few poses are solved."""
    return Check(error_of(arm, poses, found.q, found.success, LEAST_SOLVED), DESCENT)


def check_toolbox(arm: aw.Model, poses: np.ndarray, tolerance: float, found: list[Any]) -> Check:
    """Largest error of the peer's solutions, beside the length that its tolerance allows."""
    q, success = np.array([each.q for each in found]), np.array([bool(each.success) for each in found])
    return Check(error_of(arm, poses, q, success, TOOLBOX_SOLVED), 1.05 * float(np.sqrt(2.0 * tolerance)))


def error_of(arm: aw.Model, poses: np.ndarray, q: np.ndarray, success: np.ndarray, least: float) -> float:
    """Largest error of an entry of a pose that is solved; NaN where a solution is outside the limits or too few are found."""
    low, high = np.array([body.limits.position for body in arm.coordinates]).T
    q = q[success]
    if success.mean() < least or not ((q >= low - 1e-9) & (q <= high + 1e-9)).all():
        return float("nan")
    return float(np.abs(aw.compile(arm).forward_kinematics(q) - poses[success]).max())


def by_toolbox(arm: aw.Model, poses: np.ndarray, tolerance: float) -> Any:
    """The toolbox's work, one call a pose, on a chain of this arm's own placements, joints and limits."""
    import roboticstoolbox as rtb

    chain, tip = rtb.ETS(), arm.frame(None)
    for i in arm.path(tip.body):
        body = arm.bodies[i]
        joint = {"revolute": rtb.ET.Rz, "prismatic": rtb.ET.tz}[body.kind.name]
        chain = chain * rtb.ET.SE3(as_matrix(body.placement)) * joint(qlim=np.array(body.limits.position, dtype=float))
    chain = chain * rtb.ET.SE3(as_matrix(tip.placement))
    return lambda: [chain.ik_LM(pose, tol=tolerance) for pose in poses]


def as_matrix(placement: Any) -> np.ndarray:
    """(4, 4) floats."""
    return np.asarray(placement.matrix(), dtype=float)


def notes(quick: bool) -> dict[str, list[str]]:
    count = QUICK_POSES if quick else POSES
    lines = [
        f"{count:,} poses of random positions within the limits, through `aw.inverse_kinematics`: all branches, moved into the "
        "limits, each checked by forward kinematics, and the best one chosen; EAIK by `IK_batched` with one thread: all "
        "branches, without limits",
        "times are those of the processor, which a busy machine does not lengthen as much",
        "by default: the same poses without `method`, which solves them in closed form where the arm has one",
        "for AVX2: the numeric solution by code for this processor without AVX-512",
        f"numeric: {QUICK_POSES if quick else NUMERIC_POSES:,} such poses, solved to 1e-8 m and rad within the limits; Robotics "
        "Toolbox by `ETS.ik_LM`, its C++ called once a pose, on the same chain with the same limits, from its own random starts: "
        f"at its default `tol` of {TOOLBOX['toolbox']:g}, which bounds half the squared error (pose errors to 1.4e-3), and at "
        f"{TOOLBOX['toolbox fine']:g}, which is about ours (1.4e-8). It may leave {100 * (1 - TOOLBOX_SOLVED):.0f} % unsolved, "
        f"ours {100 * (1 - LEAST_SOLVED):g} %",
    ]
    return {"ik": lines}

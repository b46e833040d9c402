"""Inverse kinematics in closed form, all branches, beside EAIK's analytic solver (C++, one thread, no joint limits)."""

# EAIK is a compiled module without stubs.
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false

from __future__ import annotations

import importlib.util
from functools import partial
from typing import Any

import numpy as np
from records import Record, Task, record
from timing import Check, Contestant, Entry, race

import armwright as aw
from armwright.kinematics.forward_kinematics import body_placements

ARMS = ("puma560", "lwa4p", "cmu-dd")
POSES, QUICK_POSES = 10_000, 100
TOLERANCE = 1e-9  # of entries of poses [1 | m]
EXPECTED = {"eaik": 4.0}


def tasks(quick: bool) -> list[Task]:
    """A race for each arm."""
    return [Task("ik", f"ik closed form {name}", partial(closed_records, name, quick)) for name in ARMS]


def closed_records(name: str, quick: bool, repetitions: int) -> list[Record]:
    """All branches of poses that random positions within the limits have."""
    arm, count = aw.load(name), QUICK_POSES if quick else POSES
    low, high = np.array([body.limits.position for body in arm.bodies]).T
    q = np.random.default_rng(0).uniform(low, high, (count, arm.n))
    poses = aw.compile(arm).forward_kinematics(q)
    solve = partial(aw.inverse_kinematics, arm, poses, method="closed-form")
    contestants = {"ours": Contestant("ours", solve, count, partial(check, arm, poses, q))}
    peer = {}
    if importlib.util.find_spec("eaik") is not None:
        contestants["eaik"] = Contestant("EAIK", analytic(arm, poses), count, partial(check_peer, arm, poses))
        peer = {"eaik": "ours"}
    labels = {"arm": name, "joints": arm.n, "work": "closed form, all branches", "states": count}
    return [record(row) for row in race([Entry(labels, contestants, peer, EXPECTED)], repetitions)]


def check(arm: aw.Model, poses: np.ndarray, q: np.ndarray, found: aw.PoseSolutions) -> Check:
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


def notes(quick: bool) -> dict[str, list[str]]:
    count = QUICK_POSES if quick else POSES
    lines = [
        f"{count:,} poses of random positions within the limits, through `aw.inverse_kinematics`: all branches, moved into the "
        "limits, each checked by forward kinematics, and the best one chosen; EAIK by `IK_batched` with one thread: all "
        "branches, without limits",
    ]
    return {"ik": lines}

"""A task, and the arms of a library that can do it, the best first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice

import numpy as np

from armwright.model import Model
from armwright.modules.assembly import Assembly
from armwright.modules.chains import Rules, chains
from armwright.modules.cycle import shortest_round
from armwright.modules.enumerate import COUNTED, Progress, arm_of, counted
from armwright.modules.inverse_kinematics import reaching
from armwright.modules.library import ModuleLibrary
from armwright.modules.statics import static_torques
from armwright.modules.task import Task

STARTS = 24  # of the descent to each pose
NIMBLE = 2 / 3  # of an arm's reach: where most of them can point the tip as they like
KEPT = 8  # joint positions for each pose that the round may choose from
APART = 0.05  # [rad | m] below which two of them are the same


@dataclass(frozen=True, eq=False)
class Ranked:
    """An arm of modules, and how well it does a task."""

    assembly: Assembly
    joints: int
    mass: float  # [kg]
    reached: tuple[str, ...]  # names of poses that it comes to within tolerance
    torque_margin: (
        float  # share of the torque limits that is left at rest with the payload, at the worst pose; nan: not reached
    )
    weakest: str  # the joint with that margin
    cycle_time: float  # [s] of one round; nan: not reached
    feasible: bool
    margin: float  # the smaller share left of torque and time; -inf where poses are out of reach
    why_not: str  # "" where it is feasible
    q: np.ndarray  # (poses, n) [rad | m], one row a pose; no rows where poses are out of reach


@dataclass(frozen=True)
class Ranking:
    """Arms in order, of how many, and which modules were left out and why."""

    ranked: tuple[Ranked, ...]
    total: int  # arms that the connectors allow; COUNTED: that many or more
    long_enough: int  # of them for the furthest pose
    left_out: Mapping[str, str]


def rank_assemblies(
    library: ModuleLibrary,
    task: Task,
    *,
    max_joints: int = 6,
    min_joints: int = 1,
    max_links: int = 1,
    limit: int = 1000,
    seed: int = 0,
    progress: Progress = lambda done, total: None,
) -> Ranking:
    """Arms that the connectors allow, those that can do a task first, by the margin they keep, then by mass.

    Arms that are too short for the furthest pose are counted only. Of the others `limit` are computed, first those that
    have it at two thirds of their reach.

    Feasible: within tolerance and limits at every pose; torques at rest with the payload within the torque limits;
    one round, rest to rest with the joints' velocity and acceleration limits, within the time. Not looked at: collisions,
    friction, and torques that motion itself asks for.

    Args:
        library: what there is.   task: what it is for.   max_joints: of an arm.   min_joints: of an arm.
        max_links: how many modules without joints may stand on each other, not counting one that ends the arm.
        limit: how many are computed.   seed: of the descents' starts.   progress: is told (done, of how many).
    Returns:
        ranking: `ranked` arms, of how many in `total`, `long_enough`, and `left_out` modules with the reason.
    Raises:
        DescriptionError: no module with a ground, or limits that leave nothing.
    """
    rules = Rules(max_joints, min_joints, max_links, turned=True)
    modules, total, left_out = counted(library, rules, limit)
    furthest = max(float(np.linalg.norm(np.array(pose.xyz_m))) for pose in task.poses) - float(
        task.position_tolerance_m
    )
    long = [chain for chain in islice(chains(modules, rules), COUNTED) if chain.reach >= furthest]
    ranked = []
    for chain in sorted(long, key=lambda chain: (abs(furthest / chain.reach - NIMBLE), chain.mass))[:limit]:
        ranked.append(_judged(chain.assembly(library), arm_of(chain, library), task, seed))
        progress(len(ranked), min(limit, len(long)))
    ranked.sort(key=lambda r: (not r.feasible, -len(r.reached), -r.margin, r.mass))
    return Ranking(tuple(ranked), total, len(long), left_out)


def _judged(assembly: Assembly, arm: Model, task: Task, seed: int) -> Ranked:
    turned = np.array([pose.rpy_rad is not None for pose in task.poses])
    q, off, angle = reaching(arm, np.stack([pose.matrix() for pose in task.poses]), turned, STARTS, seed)
    within = off <= float(task.position_tolerance_m)
    if task.angle_tolerance_rad is not None:
        within &= (angle <= float(task.angle_tolerance_rad)) | ~turned[:, None]
    reached = tuple(pose.name for pose, found in zip(task.poses, within, strict=True) if found.any())
    if len(reached) < len(task.poses):
        return _out_of_reach(assembly, arm, task, reached)
    limits = np.array([body.limits.torque for body in arm.bodies])
    com = np.array(task.payload_com_m)
    choices, margins, weakest = [], [], []
    for k in range(len(task.poses)):
        gravity, load = static_torques(arm, q[k][within[k]], com)
        left = 1.0 - np.abs(gravity + float(task.payload_kg) * load) / limits
        kept = _apart(q[k][within[k]], left.min(axis=1))
        choices.append(q[k][within[k]][kept])
        margins.append(left.min(axis=1)[kept])
        weakest.append(left.argmin(axis=1)[kept])
    velocity = np.array([body.limits.velocity for body in arm.bodies])
    acceleration = np.array([body.limits.acceleration for body in arm.bodies])
    holding = [margin >= 0.0 for margin in margins]
    usable = [held if held.any() else margin == margin.max() for held, margin in zip(holding, margins, strict=True)]
    time, picked = shortest_round([c[u] for c, u in zip(choices, usable, strict=True)], velocity, acceleration)
    torque = [float(m[u][p]) for m, u, p in zip(margins, usable, picked, strict=True)]
    worst = int(np.argmin(torque))
    joint = arm.names[int(weakest[worst][usable[worst]][picked[worst]])]
    spare = 1.0 - time / float(task.cycle_time_s)
    why = ""
    if torque[worst] < 0.0:
        why = f"joint {joint} lacks {-torque[worst]:.0%} of its torque limit at pose {task.poses[worst].name}"
    elif spare < 0.0:
        why = f"a round takes {time:.3g} s, expected {float(task.cycle_time_s):g} s"
    return Ranked(
        assembly,
        arm.n,
        _mass(arm),
        reached,
        torque[worst],
        joint,
        time,
        not why,
        min(torque[worst], spare),
        why,
        np.stack([c[u][p] for c, u, p in zip(choices, usable, picked, strict=True)]),
    )


def _out_of_reach(assembly: Assembly, arm: Model, task: Task, reached: tuple[str, ...]) -> Ranked:
    missed = [pose.name for pose in task.poses if pose.name not in reached]
    why, nothing = f"does not come to {', '.join(missed)}", np.zeros((0, arm.n))
    return Ranked(assembly, arm.n, _mass(arm), reached, np.nan, "", np.nan, False, -np.inf, why, nothing)


def _mass(arm: Model) -> float:
    assert arm.description is not None
    return arm.description.total_mass


def _apart(q: np.ndarray, margin: np.ndarray) -> list[int]:
    """Rows with the largest margins, no two of them the same."""
    kept: list[int] = []
    for k in np.argsort(-margin, kind="stable"):
        if all(np.abs(q[k] - q[other]).max() > APART for other in kept):
            kept.append(int(k))
        if len(kept) == KEPT:
            break
    return kept

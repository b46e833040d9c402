"""Arms of a library in the order of how well they can do a task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from armwright.model import Model
from armwright.modules.assembly import Assembly
from armwright.modules.chains import Rules
from armwright.modules.cycle_time import shortest_round
from armwright.modules.enumerate import arm_of, counted_chains, robot_mass
from armwright.modules.inverse_kinematics import inverse_kinematics
from armwright.modules.library import ModuleLibrary
from armwright.modules.statics import static_torques
from armwright.modules.task import Task
from armwright.progress import Shown, automatic
from armwright.results.result import Result
from armwright.results.table import Table, number

STARTS = 64  # of the descent to each pose: of 800 poses of an arm none was missed, with 24 one in a hundred
DEXTEROUS = 2 / 3  # of an arm's reach: most arms can turn the tip freely there
CHOICES = 8  # joint positions for each pose that the round may choose from
SAME = 0.05  # [rad | m]: joint positions that differ by no more count as one


@dataclass(frozen=True, eq=False)
class Ranked:
    """An arm of modules, and how well it does a task."""

    assembly: Assembly
    joints: int
    mass: float  # [kg]
    reached: tuple[str, ...]  # names of poses that it reaches within tolerance
    torque_margin: (
        float  # share of the torque limits left at rest with the payload, at the worst pose; nan: not reached
    )
    weakest: str  # the joint with that margin
    cycle_time: float  # [s] of one round; nan: not reached
    feasible: bool
    margin: float  # the smaller share left of torque and time; -inf where poses are out of reach
    why_not: str  # "" where it is feasible
    q: np.ndarray  # (poses, n) [rad | m], one row a pose; no rows where poses are out of reach


@dataclass(frozen=True)
class Ranking(Result):
    """Arms in order of cost, the number of candidates, and excluded modules with reasons."""

    ranked: tuple[Ranked, ...]
    total: int  # arms that the connectors allow; COUNTED: that many or more
    long_enough: int  # of them for the furthest pose
    left_out: Mapping[str, str]

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{len(self.ranked)} of {self.total} arms"

    def tables(self) -> list[Table]:
        """A row for each arm, the best first."""
        rows = [
            [
                r.assembly.name,
                *map(number, (r.joints, r.mass, len(r.reached), r.torque_margin)),
                r.weakest,
                number(r.cycle_time),
                r.why_not or "feasible",
            ]
            for r in self.ranked
        ]
        heads = (
            "modules",
            "joints",
            "mass [kg]",
            "poses",
            "torque left [1]",
            "weakest joint",
            "a round [s]",
            "verdict",
        )
        return [Table(self.heading, heads, rows, ("weakest joint", "verdict"))]

    def sentences(self) -> list[str]:
        """Modules that are left out, and why."""
        return [f"module {name} is left out: {reason}" for name, reason in self.left_out.items()]


def rank_assemblies(
    library: ModuleLibrary,
    task: Task,
    *,
    max_joints: int = 6,
    min_joints: int = 1,
    max_links: int = 1,
    limit: int = 1000,
    seed: int = 0,
    progress: Shown = None,
) -> Ranking:
    """Arms that the connectors allow, those that can do a task first, by their margin, then by mass.

    Arms that are too short for the furthest pose are only counted. Of the others `limit` are computed, first those for
    which this pose is at two thirds of their reach.

    Feasible: within tolerance and limits at every pose; torques at rest with the payload within the torque limits;
    one round, rest to rest with the joints' velocity and acceleration limits, within the time. Left out: collisions,
    friction, and the torques of the motion itself.

    Args:
        library: the modules.   task: the poses, the payload and the time.   max_joints: of an arm.   min_joints: of an arm.
        max_links: how many modules without joints may stand on each other, not counting one that ends the arm.
        limit: how many are computed.   seed: of the descents' starts.   progress: True or None: a bar where it is seen;
            False: none; a function is called with (done, of how many).
    Returns:
        ranking: `ranked` arms, of how many in `total`, `long_enough`, and `left_out` modules with the reason.
    Raises:
        DescriptionError: no module with a ground, or limits that leave nothing.
    Example:
        >>> library = aw.modules.read_modules("improv")
        >>> task = aw.modules.read_task("examples/pick.task.toml")
        >>> found = aw.modules.rank_assemblies(library, task, max_joints=4, limit=20)
        >>> found.ranked[0].feasible, found.ranked[0].joints
        (True, 4)
    """
    rules = Rules(max_joints, min_joints, max_links, turned=True)
    every, left_out = counted_chains(library, rules, limit)
    distance = max(float(np.linalg.norm(np.array(pose.xyz_m))) for pose in task.poses)
    distance -= float(task.position_tolerance_m)
    long_enough = [chain for chain in every if chain.reach >= distance]
    ranked = []
    with automatic(progress, f"{library.name}: ranking") as tell:
        for chain in sorted(long_enough, key=lambda chain: (abs(distance / chain.reach - DEXTEROUS), chain.mass))[
            :limit
        ]:
            ranked.append(_judged(*arm_of(chain, library), task, seed))
            tell(len(ranked), min(limit, len(long_enough)))
    ranked.sort(key=lambda r: (not r.feasible, -len(r.reached), -r.margin, r.mass))
    return Ranking(tuple(ranked), len(every), len(long_enough), left_out)


def _judged(assembly: Assembly, arm: Model, task: Task, seed: int) -> Ranked:
    turned = np.array([pose.rpy_rad is not None for pose in task.poses])
    poses = np.stack([pose.matrix() for pose in task.poses])
    q, off, angle = inverse_kinematics(arm, poses, turned, STARTS, seed)
    within = off <= float(task.position_tolerance_m)
    if task.angle_tolerance_rad is not None:
        within &= (angle <= float(task.angle_tolerance_rad)) | ~turned[:, None]
    reached = tuple(pose.name for pose, starts in zip(task.poses, within, strict=True) if starts.any())
    mass = robot_mass(arm)
    if len(reached) < len(task.poses):
        why = f"does not come to {', '.join(pose.name for pose in task.poses if pose.name not in reached)}"
        nothing = np.zeros((0, arm.n))
        return Ranked(assembly, arm.n, mass, reached, np.nan, "", np.nan, False, -np.inf, why, nothing)
    chosen = [_choices(arm, task, q[k][within[k]]) for k in range(len(task.poses))]
    velocity = np.array([body.limits.velocity for body in arm.bodies])
    acceleration = np.array([body.limits.acceleration for body in arm.bodies])
    time, picked = shortest_round([choices for choices, _ in chosen], velocity, acceleration)
    way, left = (np.stack([arrays[k][p] for arrays, p in zip(chosen, picked, strict=True)]) for k in (0, 1))
    pose, joint = np.unravel_index(left.argmin(), left.shape)
    torque, weakest = float(left[pose, joint]), arm.names[joint]
    spare = 1.0 - time / float(task.cycle_time_s)
    why = ""
    if torque < 0.0:
        why = f"joint {weakest} lacks {-torque:.0%} of its torque limit at pose {task.poses[pose].name}"
    elif spare < 0.0:
        why = f"a round takes {time:.3g} s, expected {float(task.cycle_time_s):g} s"
    return Ranked(assembly, arm.n, mass, reached, torque, weakest, time, not why, min(torque, spare), why, way)


def _choices(arm: Model, task: Task, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions (c, n) for a pose that differ, and the share of every torque limit that is left (c, n).

    Only those within the torque limits; if there are none, the one that lacks least.
    """
    limits = np.array([body.limits.torque for body in arm.bodies])
    gravity, load = static_torques(arm, q, np.array(task.payload_com_m))
    left = 1.0 - np.abs(gravity + float(task.payload_kg) * load) / limits
    margin, kept = left.min(axis=1), []
    for k in np.argsort(-margin, kind="stable"):
        if all(np.abs(q[k] - q[other]).max() > SAME for other in kept):
            kept.append(int(k))
        if len(kept) == CHOICES:
            break
    margin = margin[kept]
    usable = margin >= min(0.0, margin.max())
    return q[kept][usable], left[kept][usable]

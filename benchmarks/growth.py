"""Growth of time with joints, rows, lanes, waypoints and poses: exponent k of t ~ nᵏ for work on n of them.

    python benchmarks/growth.py                     all cases, sizes up to 20 s of CPU each
    python benchmarks/growth.py --only rows --most 60

The exponent is the slope of log t over log n between the last two sizes, where what a call costs anyway counts least. Growth
above 1.15 must have a reason, which stands beside its case; one without ends the tool with exit code 1.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

os.environ["ARMWRIGHT_CACHE_DIR"] = tempfile.mkdtemp(prefix="armwright-growth-")  # what is compiled is compiled here

import numpy as np
from arms import random_chain

import armwright as aw

LINEAR = 1.15  # exponents up to which growth needs no reason
ROUNDS = 3
STATES = 1024  # that a kernel computes at once
Work = Callable[[], Any]


@dataclass(frozen=True)
class Case:
    """Timed work: `prepare(n)` gives it; `once` where its first call alone counts."""

    over: str
    name: str
    sizes: tuple[int, ...]
    prepare: Callable[[int], Work]
    reason: str = ""
    once: bool = False


JOINTS, SHORTER = (6, 12, 30, 60, 100), (6, 12, 20, 30)
LANES = (100, 1_000, 10_000, 100_000, 1_000_000)
ROWS = (1_000, 10_000, 100_000, 1_000_000)
POSES = (100, 1_000, 10_000, 100_000, 1_000_000)
TURNS = (20, 100, 1_000, 10_000)
ALL_PAIRS = "an entry for every pair of joints; a program and results that outgrow the caches"


def cases(folder: Path) -> Iterator[Case]:
    """Every case; logs are written to the folder."""
    for name in ("inverse_dynamics", "forward_dynamics", "mass_matrix", "inverse_dynamics_derivatives"):
        pairs = ALL_PAIRS if name in ("mass_matrix", "inverse_dynamics_derivatives") else ""
        sizes = SHORTER if name.endswith("derivatives") else JOINTS
        yield Case("joints", f"{STATES} states of `{name}`", sizes, partial(kernel, name), pairs)
        yield Case("joints", f"`{name}`, traced and compiled", sizes, partial(first_kernel, name), pairs, once=True)
    yield Case(
        "joints", "`aw.simulate`, its first run", SHORTER, first_run, "the plant's linear rates hold pairs", once=True
    )
    yield Case("rows", "`aw.simulate`, a row each 1 ms", ROWS, simulated_rows)
    yield Case("rows", "`read_log`", ROWS, partial(logged, folder, read))
    yield Case("rows", "`identify_arm`", ROWS[1:], partial(logged, folder, identified))
    yield Case("rows", "`validate`, without a simulation", ROWS[1:], partial(logged, folder, validated))
    yield Case("lanes", "`aw.simulate`, 100 steps", LANES[:-1], simulated_lanes)
    yield Case("lanes", "`aw.simulate`, 100 steps, reduced", LANES, partial(simulated_lanes, reduced=True))
    yield Case("waypoints", "`time_optimal`, random turns", TURNS, time_optimal)
    yield Case("waypoints", "`Waypoints`, random turns", TURNS, waypoints)
    yield Case("poses", "`inverse_kinematics`, closed form", POSES, partial(solved, "puma560"))
    yield Case("poses", "`inverse_kinematics`, by iteration", POSES, partial(solved, "panda"))
    yield Case("poses", "`workspace`", POSES[1:], lambda n: partial(aw.kinematics.workspace, aw.load("puma560"), n))


def kernel(name: str, joints: int) -> Work:
    """A kernel of a chain, on the same states again."""
    arm = random_chain(joints).replace(friction=None, efficiency=None)
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (3, STATES, joints))
    method = getattr(aw.compile(arm), name)
    used = states[:1] if name == "mass_matrix" else states
    return lambda: method(*used)


def first_kernel(name: str, joints: int) -> Work:
    """The first call of a kernel, which compiles it."""
    arm = random_chain(joints).replace(friction=None, efficiency=None)
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (3, joints))
    return lambda: getattr(aw.compile(arm), name)(*(states[:1] if name == "mass_matrix" else states))


def first_run(joints: int) -> Work:
    """A short run, compiled."""
    arm = random_chain(joints).replace(friction=None, efficiency=None)
    return lambda: aw.simulate(aw.Scenario(arm=arm, command=np.zeros(joints), duration=0.01, solver=RULE))


RULE = aw.Solver("rk3", 1e-3)


def simulated_rows(rows: int) -> Work:
    """A run of one lane that keeps every step."""
    return lambda: aw.simulate(aw.Scenario(arm=ARM, command=np.zeros(6), duration=1e-3 * rows, solver=RULE))


def simulated_lanes(lanes: int, *, reduced: bool = False) -> Work:
    """A run of lanes that start from places of their own."""
    q = aw.Batch(np.random.default_rng(0).uniform(-0.5, 0.5, (lanes, 6)))
    recording = aw.Recording(what="none", reduce=("energy",)) if reduced else aw.Recording(every=50)
    common: dict[str, Any] = {"command": np.zeros(6), "duration": 0.1, "solver": RULE, "recording": recording}
    return lambda: aw.simulate(aw.Scenario(arm=ARM, start=aw.Start(q=q), **common))


ARM = aw.load("cmu-dd")


LOG = """
title = "{name}"
joints = ["shoulder", "elbow"]
[files.log]
path = "{name}.csv"
[time]
column = "t"
unit = "s"
[[signals]]
quantity = "position"
columns = ["q0", "q1"]
unit = "rad"
side = "joint"
[[signals]]
quantity = "torque"
columns = ["u0", "u1"]
unit = "N m"
side = "joint"
"""


def logged(folder: Path, work: Callable[[Path, aw.Model], Any], rows: int) -> Work:
    """Work on a log of two joints with so many rows, which is written once."""
    arm, path = aw.load("two-link"), folder / f"log{rows}.csv"
    if not path.exists():
        t, draw = np.arange(rows) / 250.0, np.random.default_rng(0)
        speeds, phases = draw.uniform(1.0, 6.0, (5, 1, arm.n)), draw.uniform(0.0, 6.0, (5, 1, arm.n))
        angles = speeds * t[:, None] + phases
        motion = [
            (0.2 * wave).sum(axis=0)
            for wave in (np.sin(angles), speeds * np.cos(angles), -(speeds**2) * np.sin(angles))
        ]
        tau = aw.compile(arm).inverse_dynamics(*motion)
        noisy = tau + 0.01 * draw.normal(size=tau.shape)
        np.savetxt(
            path, np.column_stack([t, motion[0], noisy]), "%.9g", delimiter=",", header="t,q0,q1,u0,u1", comments=""
        )
        path.with_suffix(".log.toml").write_text(LOG.format(name=path.stem), encoding="utf-8")
    return lambda: work(path.with_suffix(".log.toml"), arm)


def read(path: Path, arm: aw.Model) -> Any:
    """The log."""
    return aw.identification.read_log(path)


def identified(path: Path, arm: aw.Model) -> Any:
    """The arm by the log."""
    return aw.identification.identify_arm(aw.identification.read_log(path), arm)


def validated(path: Path, arm: aw.Model) -> Any:
    """The arm beside the log."""
    return aw.identification.validate(arm, aw.identification.read_log(path), simulation=False)


def turns(count: int) -> tuple[np.ndarray, aw.trajectories.MotionLimits]:
    """Waypoints of six joints that turn at random, and limits of velocity and acceleration."""
    points = np.cumsum(np.random.default_rng(count).uniform(-0.3, 0.3, (count, 6)), axis=0)
    limits = aw.trajectories.MotionLimits.of(
        aw.load("puma560"), position=np.inf, torque=np.inf, voltage=np.inf, velocity=1.0, acceleration=5.0
    )
    return points, limits


def time_optimal(count: int) -> Work:
    """A path through waypoints, as fast as its limits allow."""
    points, limits = turns(count)
    path = aw.trajectories.JointPath(points)
    return lambda: aw.trajectories.time_optimal(aw.load("puma560"), path, limits)


def waypoints(count: int) -> Work:
    """A motion through waypoints."""
    points, limits = turns(count)
    return lambda: aw.trajectories.Waypoints(points, limits)


def solved(name: str, poses: int) -> Work:
    """Joint positions of random poses."""
    arm = aw.load(name)
    low, high = np.clip([body.limits.position for body in arm.coordinates], -np.pi, np.pi).T
    q = np.random.default_rng(0).uniform(low, high, (poses, arm.n))
    targets = aw.compile(arm).forward_kinematics(q)
    return lambda: aw.inverse_kinematics(arm, targets)


def timed(case: Case, size: int) -> float:
    """CPU time [s] of a case's work, the least of some; the first call, which may compile, counts only where it is meant."""
    work, found = case.prepare(size), []
    if not case.once:
        work()
    for _ in range(1 if case.once else ROUNDS):
        before, count = time.process_time(), 0
        while count == 0 or time.process_time() - before < 0.02:
            work()
            count += 1
            if case.once:
                break
        found.append((time.process_time() - before) / count)
        if sum(found) > 2.0:
            break
    return min(found)


def main() -> int:
    """Prints a table of all cases; 1 where one grows without a reason."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default="", help="cases whose row begins so, as `rows`")
    parser.add_argument("--most", type=float, default=20.0, help="CPU time [s] of the largest size that is tried")
    asked = parser.parse_args()
    print("| over | what | sizes | time | exponent | why |\n|---|---|---|---|---|---|")
    unexplained = 0
    with tempfile.TemporaryDirectory() as folder:
        for case in cases(Path(folder)):
            if not f"{case.over} {case.name}".startswith(asked.only):
                continue
            times: dict[int, float] = {}
            for size in case.sizes:
                if len(times) > 1 and next_time(times, size) > asked.most:
                    break
                times[size] = timed(case, size)
            slope = exponent(times)
            why = case.reason if slope > LINEAR else ""
            unexplained += slope > LINEAR and not why
            shown = ", ".join(f"{each:.2g} s" if each >= 1 else f"{1e3 * each:.3g} ms" for each in times.values())
            sizes = ", ".join(f"{size:,}" for size in times)
            print(f"| {case.over} | {case.name} | {sizes} | {shown} | {slope:.2f} | {why} |", flush=True)
    return int(unexplained > 0)


def exponent(times: dict[int, float]) -> float:
    """Slope of log t over log n between the last two sizes."""
    (a, ta), (b, tb) = list(times.items())[-2:]
    return math.log(tb / ta) / math.log(b / a)


def next_time(times: dict[int, float], size: int) -> float:
    """Time [s] that a further size is expected to take."""
    last = max(times)
    return times[last] * (size / last) ** max(1.0, exponent(times))


if __name__ == "__main__":
    raise SystemExit(main())

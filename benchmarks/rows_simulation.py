"""A thousand lanes of `cmu-dd` with its motors, beside MuJoCo on the same arm without contacts: ns per step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from peers.mujoco_peer import MuJoCoArm
from records import Record, Task, record
from timing import Check, Contestant, Entry, race, relative_error

import armwright as aw
from armwright.errors import ModelError
from armwright.kernels.target import select_target
from armwright.simulation.loop.compiled import compile_loop

ROBOT = "cmu-dd"
NARROW = "x86-64-v3"
STEP = 1e-3  # [s]
FINE = 4  # steps of the truth, MuJoCo's RK4, in one of ours
EXACT = (
    1e-5  # of a state's or trajectory's largest entry: what orders 3 and 4 leave at 1 ms and time constants of 15 ms
)
FIRST_ORDER = 3e-2  # what Euler leaves
VOLTS = np.array([10.0, 10.0, 10.0, 10.0, 3.0, 3.0])  # commands within ± this: no limit of the arm is reached
EXPECTED = {"Euler": 12.0, "RK4": 40.0}
WORKS = {"RK3, final state": 0, "RK3, trajectories": 1}  # and record_every


def size(quick: bool) -> tuple[int, float, int]:
    """Lanes, duration [s], and how many of the lanes MuJoCo runs: its time a step does not depend on them."""
    return (64, 0.2, 4) if quick else (1000, 2.0, 20)


def tasks(quick: bool) -> list[Task]:
    """A race for final states and one for trajectories."""
    return [Task("simulation", f"{ROBOT} {work}", partial(simulation_records, work, quick)) for work in WORKS]


def simulation_records(work: str, quick: bool, repetitions: int) -> list[Record]:
    """Ours, and ours for AVX2, beside MuJoCo's two integrators."""
    arm, every = aw.load(ROBOT), WORKS[work]
    lanes, duration, count = size(quick)
    steps = round(duration / STEP)
    commands = np.random.default_rng(2).uniform(-1.0, 1.0, (lanes, arm.n)) * VOLTS
    few = commands[:count]
    truth = MuJoCoArm(arm, "RK4", STEP / FINE).trajectories(few, FINE * steps)[:, FINE - 1 :: FINE]

    def check(states: np.ndarray, tolerance: float) -> Check:
        """Of final states, or of whole trajectories."""
        if not np.isfinite(states).all():
            return Check(float("nan"), tolerance)
        return Check(relative_error(states[:count], truth if every else truth[:, -1], 1 + every), tolerance)

    def ours(name: str, target: str | None) -> Contestant:
        loop = compile_loop(arm, target=target)

        def run() -> Any:
            scenario = aw.Scenario(
                arm,
                duration=duration,
                command=aw.Batch(commands),
                solver=aw.Solver(step=STEP),
                recording=aw.Recording(every=every, what="state"),
            )
            return aw.simulate(scenario, loop=loop, threads=1)

        def checked(run: Any) -> Check:
            states = np.concatenate([run["q"].values, run["qd"].values], axis=-1)
            return check(states[:, 1:] if every else states[:, -1], EXACT)

        return Contestant(name, run, lanes * steps, checked)

    def peer(integrator: str) -> Contestant:
        engine, tolerance = MuJoCoArm(arm, integrator, STEP), FIRST_ORDER if integrator == "Euler" else EXACT
        work = engine.trajectories if every else engine.final_states
        name = f"MuJoCo {integrator}, {'rollout' if every else 'mj_step'}"
        return Contestant(name, lambda: work(few, steps), count * steps, lambda states: check(states, tolerance))

    peers = {integrator: peer(integrator) for integrator in EXPECTED}
    entries = []
    for form, contestant in _forms(ours):
        wanted = EXPECTED if not every and not quick and form == "this processor" else {}
        labels = {"arm": ROBOT, "joints": arm.n, "work": work, "form": form, "lanes": lanes}
        entries.append(Entry(labels, {"ours": contestant, **peers}, dict.fromkeys(peers, "ours"), wanted))
    return [record(row) for row in race(entries, repetitions)]


def _forms(ours: Callable[[str, str | None], Contestant]) -> Iterator[tuple[str, Contestant]]:
    """For this processor; for AVX2 where that is another."""
    yield "this processor", ours("this processor", None)
    try:
        narrow = select_target(NARROW)
    except ModelError:
        return
    if narrow.width < select_target().width:
        yield NARROW, ours(NARROW, NARROW)


def notes(quick: bool) -> dict[str, list[str]]:
    lanes, duration, count = size(quick)
    lines = [
        f"{ROBOT}: {lanes:,} lanes of {duration:g} s at {1e3 * STEP:g} ms, motors, back EMF and viscous friction on both "
        f"sides; ours is the whole of aw.simulate, threads=1; MuJoCo runs {count} of the lanes, one thread, from C++ loops: "
        "mj_step(model, data, nstep) for final states (5 % faster than rollout), rollout for trajectories",
        f"error: against {MuJoCoArm.name} RK4 at {1e3 * STEP / FINE:g} ms for the lanes that MuJoCo runs; all lanes finite",
    ]
    return {"simulation": lines}

"""A thousand lanes of `cmu-dd` with its motors, beside MuJoCo on the same arm without contacts: ns per step."""

from __future__ import annotations

from typing import Any

import numpy as np
from peers.mujoco_peer import MuJoCoArm
from timing import Check, Contestant, Pair, relative_error

import armwright as aw
from armwright.simulation.simulator import compile_simulator

ROBOT = "cmu-dd"
STEP = 1e-3  # [s]
FINE = 4  # steps of the truth, MuJoCo's RK4, in one of ours
EXACT = (
    1e-5  # of a state's or trajectory's largest entry: what orders 3 and 4 leave at 1 ms and time constants of 15 ms
)
FIRST_ORDER = 3e-2  # what Euler leaves
VOLTS = np.array([10.0, 10.0, 10.0, 10.0, 3.0, 3.0])  # commands within ± this: no limit of the arm is reached
EXPECTED = {"Euler": 12.0, "RK4": 40.0}


def simulation_pairs(quick: bool) -> tuple[list[list[Pair]], list[str]]:
    """Races of the simulation, and what a reader of the table should know."""
    arm = aw.load(ROBOT)
    lanes, duration = (64, 0.2) if quick else (1000, 2.0)
    steps = round(duration / STEP)
    commands = np.random.default_rng(2).uniform(-1.0, 1.0, (lanes, arm.n)) * VOLTS
    few = commands[:4] if quick else commands[:20]  # MuJoCo's time per step does not depend on how many lanes there are
    truth = MuJoCoArm(arm, "RK4", STEP / FINE).trajectories(few, FINE * steps)[:, FINE - 1 :: FINE]

    def final(states: np.ndarray, tolerance: float) -> Check:
        complete = np.isfinite(states).all()
        return Check(relative_error(states[: len(few)], truth[:, -1]) if complete else np.nan, tolerance)

    def recorded(states: np.ndarray, tolerance: float) -> Check:
        complete = np.isfinite(states).all()
        return Check(relative_error(states[: len(few)], truth, 2) if complete else np.nan, tolerance)

    simulators = {f"{lanes:,} lanes": compile_simulator(arm)}
    simulators["x86-64-v3"] = compile_simulator(arm, target="x86-64-v3")

    def ours(name: str, every: int) -> Contestant:
        def run() -> Any:
            scenario = aw.Scenario(
                arm, duration=duration, step=STEP, command=commands, record_every=every, record="state"
            )
            return aw.simulate(scenario, simulator=simulators[name], threads=1)

        def check(run: Any) -> Check:
            states = np.concatenate([run["q"].values, run["qd"].values], axis=-1)
            return recorded(states[:, 1:], EXACT) if every else final(states[:, -1], EXACT)

        return Contestant(name, run, lanes * steps, check)

    def peer(integrator: str, every: int) -> Contestant:
        engine, tolerance = MuJoCoArm(arm, integrator, STEP), FIRST_ORDER if integrator == "Euler" else EXACT
        work, check = (engine.trajectories, recorded) if every else (engine.final_states, final)
        name = f"MuJoCo {integrator}, {'rollout' if every else 'mj_step'}"
        return Contestant(name, lambda: work(few, steps), len(few) * steps, lambda states: check(states, tolerance))

    races = []
    for work, every in (("RK3, final state", 0), ("RK3, trajectories", 1)):
        peers = {integrator: peer(integrator, every) for integrator in EXPECTED}
        entries = [ours(name, every) for name in (simulators if not every else list(simulators)[:1])]
        races.append(
            [
                Pair(
                    f"{work}",
                    entry,
                    peers[integrator],
                    EXPECTED[integrator] if entry is entries[0] and not every else None,
                )
                for entry in entries
                for integrator in EXPECTED
            ]
        )
    notes = [
        f"{ROBOT}: {lanes:,} lanes of {duration:g} s at {1e3 * STEP:g} ms, motors, back EMF and viscous friction on both "
        f"sides; ours is the whole of aw.simulate, threads=1; MuJoCo runs {len(few)} of the lanes, one thread, from C++ loops: "
        "mj_step(model, data, nstep) for final states (5 % faster than rollout), rollout for trajectories",
        f"error: against {MuJoCoArm.name} RK4 at {1e3 * STEP / FINE:g} ms for the lanes that MuJoCo runs; all lanes finite",
    ]
    return races, notes

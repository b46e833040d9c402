"""`lwa4p` under its cascade at 1 kHz as a tuning simulates it: draws, quantised sensors, sticking friction, reducers only.

The price of each of these is a row without it. `--million` adds a million such simulations, in generations of candidates that
share their arms, beside MuJoCo with dry friction under commands that our controller gave for a hundredth of them.
"""

from __future__ import annotations

import time
import tomllib
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from peers.mujoco_peer import MuJoCoArm
from records import Record, Task, record
from timing import Check, Contestant, Entry, Row, Timing, race

import armwright as aw
from armwright.description.database import parse
from armwright.description.writer import to_toml
from armwright.kernels.target import select_target
from armwright.model import build_model

ROBOT = "lwa4p"
PERIOD, DURATION, TRAVEL = 1e-3, 0.5, 0.4  # [s] of the loop, of a run, and of its motion
TICKS = round(DURATION / PERIOD)
START = np.array([0.2, -0.4, 0.6, 0.3, -0.5, 0.1])  # [rad]
GOAL = START + np.array([0.25, 0.2, -0.25, 0.2, 0.3, -0.3])
POSITION_KP = 12.0  # [1/s]
SPEED_KP = np.array([30.0, 30.0, 20.0, 15.0, 10.0, 8.0])  # [A s/rad]
SPEED_KI = 10.0 * SPEED_KP  # [A/rad]
CURRENT = 11.0  # [A] that the cascade commands at most
COUNTS = 360_000  # of an encoder at the joint: 0.001 degrees
CUTOFF_HZ = 100.0
SMOOTH = 0.1  # [rad/s] over which friction changes its sign where it does not stick: 1 ms follows it in all lanes
REDUCERS = ("rms_error", "peak_torque", "saturation")
ARMS = 500  # of each candidate
GENERATIONS = 20
LANES = 1_000_000
SAME_LANES = 40  # that are simulated again by themselves: their bits are the same
HUNDREDTH = 1000  # lanes whose commands MuJoCo gets, ten times over
EQUAL = 1e-300  # [rad]
NEAR = 0.1  # [rad] that MuJoCo's arm may end from ours: its friction is a soft constraint, and nothing corrects it
NARROW = "x86-64-v3"  # AVX2
AT_MOST = {8: 60.0, 4: 130.0}  # [s] for a million on two cores, by the doubles of a register
FEATURES: dict[str, dict[str, bool]] = {
    "all of it": {},
    "PD in place of the cascade": {"cascade": False},
    "exact sensors": {"quantised": False},
    "one arm, no draws": {"drawn": False},
    "smooth friction": {"sticking": False},
    "rows at both ends, no reducers": {"reduced": False},
    "semi-implicit Euler in place of RK3": {"third_order": False},
}
QUICK_FEATURES = 3  # a smoke run takes every third


def tasks(quick: bool) -> list[Task]:
    """A race of all features and each left out."""
    return [Task("closed loops", f"{ROBOT} closed loops", partial(feature_records, quick))]


def million_tasks(quick: bool) -> list[Task]:
    """The million, and where the processor has wider registers the same for AVX2."""
    native = [Task("closed loops", f"{ROBOT} million closed loops", partial(million_records, quick))]
    if select_target().width <= select_target(NARROW).width:
        return native
    return [
        *native,
        Task("closed loops", f"{ROBOT} million closed loops AVX2", partial(million_records, quick, target=NARROW)),
    ]


def robot(*, sticking: bool = True) -> aw.Model:
    """The arm whose friction has no smoothing speed, or a larger one than its record's."""
    arm = aw.load(ROBOT)
    assert arm.description is not None
    record = tomllib.loads(to_toml(arm.description))
    for joint in record["joints"]:
        joint["friction"].pop("smoothing_rad_per_s")
        if not sticking:
            joint["friction"]["smoothing_rad_per_s"] = SMOOTH
    return build_model(parse(record, arm.name))


def drawn_arms(arm: aw.Model, count: int) -> dict[str, np.ndarray]:
    """Masses within ±30 %, and each joint's friction, all of it together, within a factor of two, (count,) by name."""
    draws, factors, random = {}, {}, np.random.default_rng(6)
    for row in arm.parameters:
        owner, _, key = row.name.partition(".")
        if key == "mass_kg":
            draws[row.name] = row.value * random.uniform(0.7, 1.3, count)
        elif key.startswith("friction.") and row.unit.startswith("N"):
            factors.setdefault(owner, 2.0 ** random.uniform(-1.0, 1.0, count))
            draws[row.name] = row.value * factors[owner]
    return draws


def loop_scenario(
    arm: aw.Model, candidates: int, arms: int, seed: int = 0, *, cascade: bool = True, quantised: bool = True,
    drawn: bool = True, reduced: bool = True, third_order: bool = True, recording: aw.Recording | None = None,
    target: str | None = None,
) -> aw.Scenario:  # fmt: skip
    """Candidates with gains within ±20 % of the start's, each with as many arms, candidate after candidate."""
    factors = np.repeat(np.random.default_rng(seed).uniform(0.8, 1.2, (candidates, 3)), arms, axis=0)
    speed_kp, speed_ki = factors[:, 1:2] * SPEED_KP, factors[:, 2:] * SPEED_KI
    law: Any = aw.JointPID(kp=aw.Batch(POSITION_KP * speed_kp), kd=aw.Batch(speed_kp))
    if cascade:
        position_kp = aw.Batch(factors[:, :1] * np.full(arm.n, POSITION_KP))
        law = aw.Cascade(
            position_kp, aw.Batch(speed_kp), aw.Batch(speed_ki), speed_feedforward=1.0, effort_limit=CURRENT
        )
    sensors = aw.Sensors()
    if quantised:
        sensors = aw.Sensors(counts=COUNTS, side="link", velocity="filtered", cutoff_hz=CUTOFF_HZ)
    draws = drawn_arms(arm, arms) if drawn else {}
    kept = aw.Recording(what="none", reduce=REDUCERS) if reduced else aw.Recording(what="state", every=0)
    return aw.Scenario(
        arm,
        DURATION,
        loop=aw.Loop(law, aw.trajectories.Quintic(START, GOAL, TRAVEL), PERIOD, sensors=sensors),
        start=START,
        solver=aw.Solver("rk3" if third_order else "semi_implicit_euler", target=target),
        recording=kept if recording is None else recording,
        vary={name: aw.Batch(np.tile(values, candidates)) for name, values in draws.items()},
    )


def check(run: Any) -> Check:
    """Check that everything is finite, and the motion followed."""
    errors = run["rms_error"].values if "rms_error" in run else run["q"].values[:, -1] - GOAL
    return Check(float(np.abs(errors).max()) if np.isfinite(errors).all() else float("nan"), NEAR)


def feature_records(quick: bool, repetitions: int) -> list[Record]:
    """One thread; beside each time the price of what is left out, of the medians."""
    candidates, arms = (2, 32) if quick else (4, ARMS)
    lanes = candidates * arms
    entries = []
    for name, left_out in [*FEATURES.items()][:: QUICK_FEATURES if quick else 1]:
        arm = robot(sticking=left_out.get("sticking", True))
        options: dict[str, Any] = {key: value for key, value in left_out.items() if key != "sticking"}
        simulation = aw.simulation.Simulation(loop_scenario(arm, candidates, arms, **options))
        run = partial(simulation.run, threads=1, keep_state=False)
        contestant = Contestant(name, _again(simulation, run), lanes * TICKS, check)
        entries.append(Entry(_labels(name, lanes, 1), {"ours": contestant}, {}))
    records = [record(row) for row in race(entries, repetitions)]
    if all(row["checked"] for row in records):
        whole = records[0]["timings"]["ours"]["median"]
        for row in records[1:]:
            row["facts"]["price"] = whole - row["timings"]["ours"]["median"]
    return records


def _again(simulation: aw.simulation.Simulation, run: Callable[[], Any]) -> Callable[[], Any]:
    """A run from the start, whatever ran before."""

    def runs() -> Any:
        simulation.reset()
        return run()

    return runs


def _labels(work: str, lanes: int, threads: int) -> dict[str, Any]:
    return {"arm": ROBOT, "work": work, "lanes": lanes, "threads": threads}


def million_records(quick: bool, repetitions: int, target: str | None = None) -> list[Record]:
    """A million simulations once, as generations of a tuning: all of their time counts, two threads."""
    made = partial(loop_scenario, target=target)
    lanes, generations = (2000, 2) if quick else (LANES, GENERATIONS)
    candidates, arm = lanes // generations // ARMS, robot()
    count = candidates * ARMS
    first = aw.simulate(made(arm, candidates, ARMS), threads=2)  # compiled, as it is for all but the first tuning
    alone = aw.simulate(made(arm, 1, ARMS), threads=1)
    difference = np.abs(alone["rms_error"].values[:SAME_LANES] - first["rms_error"].values[:SAME_LANES]).max()
    began, errors = time.perf_counter(), []
    for seed in range(generations):
        run = aw.simulate(made(arm, candidates, ARMS, seed), threads=2)
        errors.append(float(run["rms_error"].values.max()))
    seconds = time.perf_counter() - began
    same = Check(float(difference) if np.isfinite(errors).all() else float("nan"), EQUAL)
    ours = Timing("ours", same, [1e9 * seconds / (generations * count * TICKS)])
    level = "" if target is None else ", for AVX2"
    labels = _labels(
        f"{generations} generations of {candidates} candidates and {ARMS} arms{level}", generations * count, 2
    )
    facts = {"seconds": seconds, "wanted": AT_MOST.get(select_target(target).width) if not quick else None}
    peer = mujoco_timing(arm, quick)
    entry = Entry(labels, {"ours": Contestant("ours", lambda: None, 1, lambda _: same)}, {"Euler": "ours"}, facts=facts)
    return [record(Row(entry, {"ours": ours, "Euler": peer}))]


def mujoco_timing(arm: aw.Model, quick: bool) -> Timing:
    """MuJoCo's arm with the record's numbers under commands that our controller gave, one thread, by rollout: no controller,
    no sensors, no draws, no reducers of its own."""
    lanes, times = (20, 1) if quick else (HUNDREDTH, LANES // 100 // HUNDREDTH)
    scenario = loop_scenario(arm, lanes, 1, drawn=False, recording=aw.Recording(every=1, what="all"))
    run = aw.simulate(scenario)
    commands, ends = np.ascontiguousarray(run["u"].values[:, :-1]), run["q"].values[:, -1]
    engine = MuJoCoArm(arm, "Euler", PERIOD, dry=True)
    states, samples = np.zeros(0), []
    for _ in range(times):
        began = time.perf_counter()
        states = engine.trajectories(commands, TICKS, START)
        samples.append(1e9 * (time.perf_counter() - began) / (lanes * TICKS))
    away = float(np.abs(states[:, -1, : arm.n] - ends).max())
    return Timing(f"{MuJoCoArm.name} Euler", Check(away, NEAR), samples)


def notes(quick: bool) -> dict[str, list[str]]:
    return {
        "closed loops": [
            f"{ROBOT} at {1e3 * PERIOD:g} ms for {DURATION:g} s: RK3, position P and speed PI of its own in every candidate, "
            f"encoders of 0.001° at the joints with filtered differences, masses within ±30 % and friction within a factor of "
            f"two by arm, dry friction that sticks, {', '.join(REDUCERS)} of every lane and nothing else; a step that sticks "
            "anywhere in a tile of lanes costs twice one that slides everywhere: here a fifth of the motion stands",
            "price: what the whole costs more than the row without it; one thread",
            f"the million: scenarios, draws and results included; error: of {SAME_LANES} lanes against the same run by "
            f"themselves; {MuJoCoArm.name}, one thread, with the record's numbers and its own dry friction, runs a hundredth by "
            "rollout under commands that our controller gave: no controller, sensors, draws or reducers of its own",
        ]
    }

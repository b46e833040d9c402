"""A thousand lanes of `puma560` with its motors under a PID controller at 1 kHz, beside MuJoCo without one: ns per step."""

from __future__ import annotations

import tomllib
from functools import partial
from typing import Any

import numpy as np
from peers.mujoco_peer import MuJoCoArm
from records import Record, Task, record
from timing import Check, Contestant, Entry, race, relative_error

import armwright as aw
from armwright.description.database import parse
from armwright.description.writer import to_toml
from armwright.model import build_model

ROBOT = "puma560"
CROWD = "two-link"
ANALYSED = ("lwa4p", "puma560")  # whose loops are looked at over the workspace
BANDWIDTH = 75.0  # [rad/s] of their speed loops at each joint's least inertia
STEP = 1e-3  # [s] of the controller and of the integrator
EXPECTED = {"Euler": 15.0, "RK4": 50.0}
EXACT, FIRST_ORDER = 1e-5, 3e-2  # of a state's largest entry: what orders 3 and 4 leave, and what Euler leaves
AMPLITUDE = np.array([0.5, 0.4, 0.4, 0.6, 0.5, 0.6])  # [rad]
EFFECTS: dict[str, dict[str, Any]] = {  # what a tick may have beside the controller
    "PID": {},
    "PID, a delay of 1.5 periods": {"loop": {"timing": aw.Timing(command_delay=1.5 * STEP)}},
    "PID, jitter and losses": {
        "loop": {"timing": aw.Timing(command_delay=0.5 * STEP, jitter=0.4 * STEP, command_loss=0.01)}
    },
    "PID, encoders and filters": {"loop": {"sensors": aw.Sensors(counts=4096, velocity="filtered", cutoff_hz=100.0)}},
    "PID, noise": {"loop": {"sensors": aw.Sensors(position_noise=1e-5)}},
    "PID, substeps 4": {"solver": {"substeps": 4}},
}
BRISTLES = {  # of an ordinary motor, in its own angle
    "law": "lugre",
    "side": "motor",
    "viscous_n_m_s_per_rad": 1e-3,
    "smoothing_rad_per_s": 2.0,
    "coulomb_positive_n_m": 0.1,
    "coulomb_negative_n_m": 0.1,
    "stribeck_torque_n_m": 0.15,
    "stribeck_speed_rad_per_s": 5.0,
    "bristle_stiffness_n_m_per_rad": 2.0,
    "bristle_damping_n_m_s_per_rad": 5e-3,
}
WARMTH = {
    "ambient_c": 25.0,
    "reference_c": 25.0,
    "winding_capacity_j_per_k": 50.0,
    "winding_resistance_k_per_w": 1.0,
    "resistance_temperature_coefficient_per_k": 0.0039,
    "magnet_temperature_coefficient_per_k": -0.0011,
}
SPRING_HZ, SPRING_DAMPING = (
    10.0,
    0.1,
)  # of each link on its elastic gear, the others still: what 1 ms follows on a light wrist


def drives(arm: aw.Model) -> dict[str, dict[str, list[Any]]]:
    """Tables of the joints, one each, with all that drives may have beside their motors."""
    n, turn = arm.n, 2.0 * np.pi * SPRING_HZ
    links = np.diag(aw.mass_matrix(arm.replace(rotors=None), np.zeros(n)))
    springs = [
        {"stiffness_n_m_per_rad": turn**2 * link, "damping_n_m_s_per_rad": 2.0 * SPRING_DAMPING * turn * link}
        for link in links.tolist()
    ]
    return {
        "PID, inductance": {"motor": [{"inductance_h": 2e-3}] * n},
        "PID, LuGre friction": {"friction": [BRISTLES] * n},
        "PID, elastic gears": {"elasticity": springs},
        "PID, temperature": {"motor": [{"thermal": WARMTH}] * n},
    }


def driven(arm: aw.Model, tables: dict[str, list[Any]]) -> aw.Model:
    """The arm without its friction, and with these tables in its joints."""
    assert arm.description is not None
    record = tomllib.loads(to_toml(arm.description))
    for k, joint in enumerate(record["joints"]):
        joint.pop("friction", None)
        for name, rows in tables.items():
            joint[name] = joint.get(name, {}) | rows[k]
    return build_model(parse(record, arm.name))


QUICK_EFFECTS = 4  # a smoke run takes every fourth


def size(quick: bool) -> tuple[int, float, int]:
    """Lanes, duration [s], and how many of the lanes MuJoCo runs: its time a step does not depend on them."""
    return (64, 0.1, 2) if quick else (1000, 1.0, 10)


def tasks(quick: bool) -> list[Task]:
    """A race for the controller alone, with every added effect beside it."""
    return [
        Task("control", f"{ROBOT} under PID", partial(control_records, quick)),
        Task("control", f"{CROWD} million lanes", partial(crowd_records, quick)),
        Task("control", "loops over the workspace", partial(analysis_records, quick)),
    ]


def crowd_records(quick: bool, repetitions: int) -> list[Record]:
    """Lanes of which nothing is kept but what reducers make of them: time goes with their number."""
    arm, ticks = aw.load(CROWD), 10
    control = aw.JointPID(kp=50.0, kd=5.0)
    entries = []
    for lanes in (1000, 10_000) if quick else (100_000, 1_000_000):
        q0 = np.random.default_rng(4).uniform(-0.5, 0.5, (lanes, arm.n))
        simulation = aw.simulation.Simulation(
            aw.Scenario(
                arm,
                duration=ticks * STEP,
                start=aw.Batch(q0),
                loop=aw.Loop(controller=control, reference=np.zeros(arm.n), period=STEP),
                recording=aw.Recording(what="none", reduce=["rms_error"]),
            )
        )

        def checked(run: Any, lanes: int = lanes) -> Check:
            errors = run["rms_error"].values
            return Check(0.0 if errors.shape == (lanes, arm.n) and np.isfinite(errors).all() else float("nan"), EXACT)

        run = partial(simulation.run, threads=1, keep_state=False)
        labels = {
            "arm": CROWD,
            "joints": arm.n,
            "work": f"{CROWD}, PID, reducers only",
            "form": "this processor",
            "lanes": lanes,
        }
        entries.append(Entry(labels, {"ours": Contestant(f"{lanes} lanes", run, lanes * ticks, checked)}, {}, {}))
    return [record(row) for row in race(entries, repetitions)]


def analysis_records(quick: bool, repetitions: int) -> list[Record]:
    """Loops over the workspace: inertias at all poses, margins and the lowest rate at the extreme ones; time by the pose."""
    poses, entries = 1000 if quick else 100_000, []
    for name in (CROWD,) if quick else ANALYSED:
        arm = aw.load(name)
        least = aw.loops.joint_inertias(arm, poses).free.min(axis=0)
        volts = [body.drive.gear_ratio * (body.drive.torque_constant or 1.0) for body in arm.coordinates]
        gains = BANDWIDTH * least / np.abs(volts)
        control = aw.Cascade(position_kp=BANDWIDTH / 4.0, speed_kp=gains, speed_ki=BANDWIDTH / 6.0 * gains)
        loop = aw.Loop(control, period=STEP, timing=aw.Timing("one-tick"), sensors=aw.Sensors(velocity="difference"))

        def checked(found: Any, poses: int = poses) -> Check:
            right = len(found.inertias.q) == poses and found.stable and found.period_stable > STEP
            return Check(0.0 if right else float("nan"), EXACT)

        run = partial(aw.loops.analyse_loops, aw.Scenario(arm, 1.0, loop=loop), poses)
        labels = {
            "arm": name,
            "joints": arm.n,
            "work": f"loops analysed, cascade, {poses:,} poses",
            "form": "this processor",
            "lanes": poses,
        }
        entries.append(Entry(labels, {"ours": Contestant(f"{poses} poses", run, poses, checked)}, {}, {}))
    return [record(row) for row in race(entries, repetitions)]


def control_records(quick: bool, repetitions: int) -> list[Record]:
    """Ours with each effect, beside MuJoCo's two integrators fed with the commands that our controller gave."""
    arm = aw.load(ROBOT).replace(friction=None)
    lanes, duration, count = size(quick)
    steps = round(duration / STEP)
    random = np.random.default_rng(3)
    kp = random.uniform(0.8, 1.2, (lanes, 1)) * np.array([60.0, 120.0, 60.0, 30.0, 30.0, 30.0])
    control = aw.JointPID(kp=aw.Batch(kp), ki=aw.Batch(2.0 * kp), kd=aw.Batch(0.1 * kp))
    reference = aw.trajectories.Sine(np.zeros(6), AMPLITUDE, 1.0)

    def scenario(effect: dict[str, Any], what: str, every: int) -> aw.Scenario:
        loop = aw.Loop(controller=control, reference=reference, period=STEP, **effect.get("loop", {}))
        solver = aw.Solver(**effect.get("solver", {}))
        recording = aw.Recording(every=every, what=what)
        return aw.Scenario(effect.get("arm", arm), duration, loop=loop, solver=solver, recording=recording)

    reference_run = aw.simulate(scenario({}, "all", every=1))
    commands = np.ascontiguousarray(reference_run["u"].values[:count, :-1])
    ends = np.concatenate([reference_run["q"].values[:count, -1], reference_run["qd"].values[:count, -1]], axis=-1)

    def check(states: np.ndarray, tolerance: float) -> Check:
        return Check(relative_error(states, ends, 1) if np.isfinite(states).all() else float("nan"), tolerance)

    def ours(effect: str) -> Contestant:
        simulation = aw.simulation.Simulation(scenario(effects[effect], "state", every=0))

        def checked(run: Any) -> Check:
            states = np.concatenate([run["q"].values[:count, -1], run["qd"].values[:count, -1]], axis=-1)
            if effect == "PID":
                return check(states, EXACT)
            return Check(0.0 if np.isfinite(states).all() else float("nan"), EXACT)  # another motion: finite is all

        return Contestant(effect, partial(simulation.run, threads=1, keep_state=False), lanes * steps, checked)

    def peer(integrator: str) -> Contestant:
        engine, tolerance = MuJoCoArm(arm, integrator, STEP), FIRST_ORDER if integrator == "Euler" else EXACT
        run = partial(engine.trajectories, commands, steps)
        return Contestant(f"MuJoCo {integrator}", run, count * steps, lambda states: check(states[:, -1], tolerance))

    peers = {integrator: peer(integrator) for integrator in EXPECTED}
    effects = EFFECTS | {name: {"arm": driven(arm, tables)} for name, tables in drives(arm).items()}
    entries = []
    for effect in [*effects][:: QUICK_EFFECTS if quick else 1]:
        wanted = EXPECTED if effect == "PID" and not quick else {}
        labels = {"arm": ROBOT, "joints": arm.n, "work": effect, "form": "this processor", "lanes": lanes}
        entries.append(Entry(labels, {"ours": ours(effect), **peers}, dict.fromkeys(peers, "ours"), wanted))
    return [record(row) for row in race(entries, repetitions)]


def notes(quick: bool) -> dict[str, list[str]]:
    lanes, duration, count = size(quick)
    return {
        "control": [
            f"{ROBOT} with its motors, without friction: {lanes:,} lanes of {duration:g} s, RK3 and controller at {1e3 * STEP:g} "
            f"ms, gains of its own in every lane; ours is a whole compiled run, threads=1; {MuJoCoArm.name} runs {count} lanes "
            "by rollout, one thread, with the commands that our controller gave: no controller of its own, and no effect",
            "loops analysed: ns for each pose of inertias, margins, lowest rate and noise together; 100,000 ns are 10 s in all",
            "error: our final states against MuJoCo's under the same commands; where delays, sensors or drives make another "
            "motion, that it is finite; inductance, friction, gears and temperature are those of all six joints",
        ]
    }

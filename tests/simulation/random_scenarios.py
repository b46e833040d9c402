"""Random scenarios from a seed, with the motion that is right: what the law of accuracy is held against."""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray

import armwright as aw
from armwright.actuators.gear import sticks
from armwright.simulation.integrate.step_control import floors
from armwright.simulation.plant.state import state_layout
from physics.arms import FORMS
from reference.example_robots import robot_files
from simulation.exact import ExactPlant
from simulation.plants import MOTOR, chain

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
from auto_steps import (
    command as share_of_limits,  # pyright: ignore[reportMissingImports]
    with_motors,  # pyright: ignore[reportMissingImports]
)

ROWS = 0.02  # [s] from row to row
OF_WHEEL = (
    *("TwoDofs", "borinot_flying_arm_2", "finger_edu", "hextilt_flying_arm_5", "quadruped", "so100", "solo"),
    *("talos_left_arm", "ur10_robot", "ur3_robot", "ur5_robot", "xarm7", "z1"),
)
FRICTIONS = ("none", "none", "viscous", "viscous", "dry", "dry", "stribeck", "smoothed")
LIMITS = {"torque_n_m": 16.0}
SHORT = 3.0  # [s] up to which CVODES is the truth of a sampled loop: it takes half a second for each
DOUBTFUL = 1e-9  # relative tolerance of a second truth, which tells how sure the first is
RTOL, ATOL, TIGHT = 1e-11, 1e-13, aw.Solver(accuracy=1e-8, max_substeps=10**6)  # of truths in sampled loops


class NoSuchArm(Exception):
    """The robot's file is not installed."""


@dataclass(frozen=True)
class Case:
    """A scenario, its features, and what it needs to be followed exactly."""

    seed: int
    name: str
    scenario: aw.Scenario
    features: frozenset[str]
    changes: tuple[tuple[float, dict[str, Any]], ...]  # of inputs over time, as `ExactPlant.run` takes them

    @property
    def kind(self) -> str:
        """Loop or none, and the roughest of sticking, contacts, smooth."""
        rough = next((each for each in ("sticking", "contacts") if each in self.features), "smooth")
        return f"{'sampled' if 'sampled' in self.features else 'open loop'}, {rough}"


def case(seed: int) -> Case:
    """The scenario of a seed.

    Raises:
        NoSuchArm: it is one of a wheel that is not installed.
    """
    draw = np.random.default_rng([seed, 29])
    name = str(draw.choice(["random", "built-in", "wheel"], p=[0.6, 0.2, 0.2]))
    if name == "random":
        arm = _random_arm(draw)
    else:
        name = str(draw.choice(FORMS if name == "built-in" else OF_WHEEL))
        arm = aw.load(name) if name in FORMS else _of_wheel(name)
    features = _features(arm)
    longest = 20.0 if arm.n == 1 else 12.0 if arm.n < 4 else 6.0
    duration = 60.0 if draw.random() < 0.08 and arm.n < 3 else round(float(draw.uniform(2.0, longest)), 1)
    if arm.n > 3 and arm.coordinates[0].drive.command == "torque":
        duration = min(duration, 3.0)  # then it is chaos
    start = aw.Start(draw.uniform(-1.0, 1.0, arm.n), draw.uniform(-0.5, 0.5, arm.n) * (draw.random() < 0.5))
    common: dict[str, Any] = {"duration": duration, "start": start, "recording": aw.Recording(period=ROWS)}
    changes: tuple[tuple[float, dict[str, Any]], ...] = ()
    if draw.random() < 0.3:
        duration = common["duration"] = min(duration, 6.0)
        common["loop"] = _loop(arm, draw, start.q)
        features |= {"sampled"}
    else:
        full = share_of_limits(arm) * draw.uniform(0.2, 2.5)
        rows = int(draw.integers(1, 6))
        times = [0.0, *np.sort(np.round(draw.uniform(0.0, duration, rows - 1), 3))]
        commands = [full * draw.uniform(-1.0, 1.0, arm.n) for _ in times]
        common["command"] = aw.Schedule(times, np.array(commands), list(arm.names)) if rows > 1 else commands[0]
        changes = tuple((float(t), {"command": u}) for t, u in zip(times, commands, strict=True))
        features |= {"steps"} if rows > 1 else frozenset()
        braked = [body.joint for body in arm.coordinates if body.brake is not None]
        if braked:
            at = round(0.6 * duration, 3)
            applied = np.array([np.zeros(len(braked)), np.ones(len(braked))])
            common["inputs"] = aw.Inputs(brake=aw.Schedule([0.0, at], applied, braked))
            changes = _with_brake(changes, at, len(braked))
            features |= {
                "brake",
                *(["sticking"] if any(body.brake and body.brake.is_rigid for body in arm.bodies) else []),
            }
    return Case(seed, name, aw.Scenario(arm, **common), frozenset(features), changes)


def _with_brake(changes: Any, at: float, count: int) -> tuple[tuple[float, dict[str, Any]], ...]:
    """Changes of commands, and brakes that are applied from a time on."""
    times = sorted({at, *(t for t, _ in changes)})
    of_time = dict(changes)
    return tuple((t, {**of_time.get(t, {}), "brake": np.full(count, float(t >= at))}) for t in times)


def _features(arm: aw.Model) -> set[str]:
    """Features of an arm by name."""
    bodies = arm.coordinates
    tests = {
        "sticking": any(sticks(body) for body in bodies),
        "stops": any(body.stops is not None for body in bodies),
        "elastic": any(body.elasticity is not None for body in bodies),
        "play": any(body.elasticity is not None and body.elasticity.backlash is not None for body in bodies),
        "gear loss": any(body.drive.efficiency is not None for body in bodies),
        "cogging": any(body.drive.cogging is not None for body in bodies),
        "winding": any(body.drive.inductance is not None for body in bodies),
        "stribeck": any(body.friction is not None and body.friction.stribeck is not None for body in bodies),
    }
    tests["contacts"] = tests["stops"] or tests["play"]
    return {name for name, has in tests.items() if has}


def _random_arm(draw: np.random.Generator) -> aw.Model:
    """One to three rods with motors; a third of them have little friction and nothing else."""
    command, count = str(draw.choice(["torque", "torque", "voltage"])), int(draw.choice([1, 1, 2, 2, 3]))
    if draw.random() < 0.35:
        viscous = {"viscous_n_m_s_per_rad": float(draw.choice([0.0, 1e-3, 1e-2, 0.1]))}
        joints: list[dict[str, Any]] = [{"command": "torque", "limits": LIMITS, "friction": viscous}] * count
    else:
        joints = [_random_joint(draw, command) for _ in range(count)]
    return chain(joints, gravity=float(draw.choice([0.0, 9.81, 9.81])))


def _random_joint(draw: np.random.Generator, command: str) -> dict[str, Any]:
    """A joint's own keys."""
    some = lambda low, high: float(np.exp(draw.uniform(np.log(low), np.log(high))))  # noqa: E731
    motor: dict[str, Any] = {**MOTOR, "gear_ratio": some(20.0, 100.0)}
    limits: dict[str, Any] = {"voltage_v": 48.0} if command == "voltage" else dict(LIMITS)
    joint: dict[str, Any] = {"command": command, "motor": motor, "limits": limits}
    friction: dict[str, Any] = {}
    law = str(draw.choice(FRICTIONS))
    if law != "none":
        friction["viscous_n_m_s_per_rad"] = some(0.005, 1.0)
    if law in ("dry", "stribeck", "smoothed"):
        friction |= {f"coulomb_{way}_n_m": some(0.3, 5.0) for way in ("positive", "negative")}
    if law == "stribeck":
        most = max(friction["coulomb_positive_n_m"], friction["coulomb_negative_n_m"])
        friction |= {"stribeck_torque_n_m": most * some(1.1, 1.8), "stribeck_speed_rad_per_s": some(0.02, 0.5)}
    if law == "smoothed":
        friction["smoothing_rad_per_s"] = some(0.005, 0.1)
    if draw.random() < 0.2:
        friction["viscous_n_m_s_per_rad"] = max(friction.get("viscous_n_m_s_per_rad", 0.0), 1.0)  # it does not race
        motor["cogging"] = {"amplitude_n_m": some(0.003, 0.03), "periods": int(draw.integers(5, 43)), "phase_rad": 0.3}
    if friction:
        joint["friction"] = friction
    if draw.random() < 0.3:
        limits["position_rad"] = [-some(1.05, 2.0), some(1.05, 2.0)]
        joint["stops"] = {"stiffness_n_m_per_rad": some(1e3, 1e5), "damping_n_m_s_per_rad": some(5.0, 100.0)}
        if draw.random() < 0.3:
            joint["stops"]["damping_n_m_s_per_rad"] = 0.0
    if draw.random() < 0.25:
        joint["elasticity"] = {"stiffness_n_m_per_rad": some(500.0, 2e4), "damping_n_m_s_per_rad": some(1.0, 20.0)}
        if draw.random() < 0.5:
            joint["elasticity"]["backlash_rad"] = some(5e-4, 2e-2)
        if friction and draw.random() < 0.4:
            friction["side"] = "motor"
            for key in friction.keys() - {"side"}:  # torques, speeds and their ratio in the motor's own radians
                power = -2 if key.startswith("viscous") else 1 if key.endswith("_rad_per_s") else -1
                friction[key] *= motor["gear_ratio"] ** power
    if draw.random() < 0.2:
        motor["gear_efficiency"] = float(draw.uniform(0.6, 0.95))
    if command == "voltage" and draw.random() < 0.15:
        motor["inductance_h"] = some(2e-4, 5e-3)
    if draw.random() < 0.15:
        joint["brake"] = {"holding_torque_n_m": some(5.0, 60.0)}
        if draw.random() < 0.5:
            bristle = {"stiffness_n_m_per_rad": 1e4, "damping_n_m_s_per_rad": 20.0, "release_time_s": 0.02}
            joint["brake"] |= bristle
    return joint


@cache
def _of_wheel(name: str) -> aw.Model:
    """A robot of `example-robot-data` with motors."""
    file = next((file for path, file in robot_files().items() if Path(path).stem == name), None)
    if file is None:
        raise NoSuchArm(f"{name}: example-robot-data is not installed")
    with tempfile.TemporaryDirectory() as folder:
        arm = with_motors(file, Path(folder))
    assert arm is not None
    return arm


def _loop(arm: aw.Model, draw: np.random.Generator, q: np.ndarray) -> aw.Loop:
    """PD control or a cascade, of some hertz, to a pose nearby."""
    w = 2 * np.pi * draw.uniform(0.7, 2.5)
    inertia = np.diag(aw.mass_matrix(arm, q)).astype(float)
    per_unit = np.array([_torque_per_unit(body) for body in arm.coordinates])  # [N m] of a command of 1
    kp, kd = inertia * w**2 / per_unit, 1.4 * inertia * w / per_unit
    if draw.random() < 0.6:
        controller: Any = aw.JointPID(kp=kp, kd=kd, gravity=bool(draw.random() < 0.5))
    else:
        controller = aw.Cascade(position_kp=0.5 * w, speed_kp=kd, speed_ki=0.3 * w * kd)
    period = float(draw.choice([1e-3, 2e-3, 4e-3]))
    return aw.Loop(controller, reference=q + draw.uniform(-0.6, 0.6, arm.n), period=period)


def _torque_per_unit(body: Any) -> float:
    """Torque [N m] of a joint's motor at rest for a command of 1 V, A or N m."""
    drive = body.drive
    per_ampere = 1.0 if drive.command == "torque" else abs(float(drive.gear_ratio) * float(drive.torque_constant))
    return per_ampere / float(drive.resistance) if drive.command == "voltage" else per_ampere


def truth(case: Case, rtol: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """q and q̇, (rows, n) each, as they are."""
    scenario = case.scenario
    if "sampled" not in case.features:
        times = np.arange(round(scenario.duration / ROWS) + 1) * ROWS
        plant, start = ExactPlant(scenario.arm, brakes="brake" in case.features), scenario.start
        states = plant.run(times, start.q, start.qd, case.changes, **({} if rtol is None else {"rtol": rtol}))
        return states[:, : scenario.arm.n], states[:, scenario.arm.n : 2 * scenario.arm.n]
    if "sticking" in case.features:
        solver = TIGHT
    elif scenario.duration <= SHORT:
        solver = aw.Solver("cvodes")
    else:
        solver = aw.Solver("rk45", rtol=RTOL, atol=ATOL, max_substeps=10**6)
    run = aw.simulate(replace(scenario, solver=solver))
    return run.q.values, run.qd.values


@dataclass(frozen=True)
class Verdict:
    """Error of a run and its own estimate of it, in parts of its accuracy."""

    error: float
    estimate: float | None  # its `global_error`; None if it states none
    sensitive: bool  # it says that its motion amplifies errors
    stalled: bool
    doubt: float  # how unsure the truth is
    rule: str

    @property
    def kept(self) -> bool:
        """True if the error is within the accuracy, or the run says how large it is, or that none can say."""
        estimated = self.estimate is not None and self.estimate > 1.0 and 1 / 3 < self.estimate / self.error < 3.0
        if self.doubt > 0.3 * self.error:  # the truth is lost itself, and with it the number
            estimated = self.estimate is not None and self.estimate > 1.0
        return self.error <= 1.0 or estimated or self.sensitive


def judged(case: Case, solver: aw.Solver | None = None) -> Verdict:
    """The verdict over a run with default steps, or those of a solver."""
    scenario = case.scenario if solver is None else replace(case.scenario, solver=solver)
    run = aw.simulate(scenario)
    accuracy, exact = float(run.attrs["accuracy"]), truth(case)
    error = wrong_by(run, exact, scenario.arm) / accuracy
    doubt = 0.0
    if error > 1.0 and "sampled" not in case.features:
        again = truth(case, DOUBTFUL)
        doubt = wrong_by(dict(zip(("q", "qd"), again, strict=True)), exact, scenario.arm) / accuracy
    stalled = bool(np.any(np.isfinite(run["stalled_at"].values))) if "stalled_at" in run else False
    return Verdict(error, global_error(run, accuracy), is_sensitive(run), stalled, doubt, str(run.attrs["rule"]))


def wrong_by(run: Any, exact: tuple[np.ndarray, np.ndarray], arm: aw.Model) -> float:
    """The largest error of q and q̇ over rows and joints, in parts of each one's range, or the least range of its unit."""
    of_state = floors(state_layout(arm, False))
    least = of_state[: arm.n], of_state[arm.n : 2 * arm.n]
    worst = 0.0
    for name, right, floor in zip(("q", "qd"), exact, least, strict=True):
        found = np.asarray(run[name])
        error = np.abs(found - right).max(axis=0) / np.maximum(np.ptp(right, axis=0), floor)
        worst = max(worst, float(np.nan_to_num(error, nan=np.inf).max()))
    return worst


def global_error(run: xarray.Dataset, accuracy: float) -> float | None:
    """The largest `global_error` that a run states, in parts of its accuracy."""
    stated = run["global_error"].values if "global_error" in run else run.attrs.get("global_error")
    return None if stated is None else float(np.nanmax(np.asarray(stated, float))) / accuracy


def is_sensitive(run: xarray.Dataset) -> bool:
    """True if a run says that its motion amplifies errors."""
    return any("sensitive" in str(note) for note in run.attrs["notes"])

"""Writes docs/data/auto-steps.csv: what steps of their own choice are wrong by and cost, beside rk3 at 1 ms.

    .venv/bin/python tools/auto_steps.py

Every built-in arm, and fifteen of the `example-robot-data` wheel with motors that are sized by their effort limits, swing under
constant voltages, currents or torques, and follow a motion under a PID at 1 kHz. CVODES is the truth; in a loop and where
friction sticks, which it does not follow, steps of an accuracy that is a hundred thousand times as high. The cost is the
processor's time for the same run of many lanes, beside that of rk3 at 1 ms, the default before steps were chosen. The last two
columns are how often the dynamics are evaluated, and how long it takes, where 64 lanes estimate their error, beside where not.
"""

from __future__ import annotations

import csv
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray

import armwright as aw
from armwright.actuators.gear import sticks
from armwright.errors import ArmwrightError
from armwright.simulation.companion import FINER, lanes_again
from armwright.simulation.integrate.stepping import ACCURACY

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / "docs" / "data" / "auto-steps.csv"
HEAD = (
    "arm",
    "joints",
    "rule",
    "substeps a ms",
    "largest error",
    "evaluations a ms",
    "largest error of rk3 at 1 ms",
    "cost beside it",
    "evaluations with the estimate, 64 lanes",
    "time with it",
)
OTHERS = 15  # robots of the wheel
MOST_JOINTS = 10
DURATION = 0.5  # [s]
SHARE = 0.2  # of each limit that is commanded
STAGES = {"rk45": 7, "rk3": 3, "rodas3": 3}  # evaluations a step
VOLTS, RATIO, CONSTANT, INERTIA = 48.0, 100.0, 0.1, 2e-5  # [V] [-] [N m/A] [kg m²] of the motors
SPARE = 2.0  # stall torque in effort limits
LANES, JUDGED, TIMED = (
    256,
    64,
    5,
)  # of runs whose time is taken, alone and with the estimate of their error; and how many
RATE, POSES, BANDWIDTH = 1000, 100, 20.0  # of the loop [Hz], for its design, and of each joint [rad/s]
LEAST = 1e-12  # range of a joint that sticks
UNLIMITED = 10.0  # of a limit that is not stated [V | A | N m | N]


def arms() -> Iterator[tuple[str, aw.Model]]:
    """Names and arms: the built-in ones, then robots of the wheel with motors."""
    from armwright.description.database import builtin_names
    from reference.example_robots import robot_files

    for name in builtin_names():
        yield name, aw.load(name)
    count, families = 0, set[str]()
    for name, file in robot_files().items():
        if count == OTHERS:
            return
        if (family := Path(name).stem.split("_")[0]) in families:  # a robot in other configurations
            continue
        with tempfile.TemporaryDirectory() as folder:
            arm = with_motors(file, Path(folder))
        if arm is not None:
            count += 1
            families.add(family)
            yield Path(name).stem, arm


def with_motors(file: Path, folder: Path) -> aw.Model | None:
    """A robot with motors in its revolute joints; None of one that does not load as it is, is long, or has other joints."""
    try:
        bare = aw.load(file)
    except ArmwrightError:
        return None
    bodies = bare.coordinates
    if bare.n > MOST_JOINTS or not all(body.kind.name == "revolute" and body.limits.torque < np.inf for body in bodies):
        return None
    text = 'source = "estimate"\ncommand = "voltage"\n'
    for body in bodies:
        resistance = VOLTS * RATIO * CONSTANT / (SPARE * max(float(body.limits.torque), 1.0))
        motor = f"gear_ratio = {RATIO}, rotor_inertia_kg_m2 = {INERTIA}, torque_constant_n_m_per_a = {CONSTANT}"
        text += f'[joints."{body.joint}"]\nlimits = {{ voltage_v = {VOLTS} }}\n'
        text += f"motor = {{ {motor}, resistance_ohm = {resistance} }}\n"
    copied = Path(shutil.copy(file, folder / "robot.urdf"))
    (folder / "robot.drive.toml").write_text(text, encoding="utf-8")
    try:
        return aw.load(copied)
    except ArmwrightError:
        return None


def command(arm: aw.Model) -> np.ndarray:
    """A share of the arm's limits, another one at every joint."""
    limits = np.array([getattr(body.limits, body.drive.command) for body in arm.coordinates], dtype=float)
    return np.where(np.isfinite(limits), limits, UNLIMITED) * SHARE * np.cos(np.arange(arm.n))


def swinging(arm: aw.Model) -> aw.Scenario:
    """The arm under these commands."""
    return aw.Scenario(arm, DURATION, command=command(arm))


def controlled(arm: aw.Model) -> aw.Scenario:
    """The arm under a PID at 1 kHz that moves every joint by a tenth of a radian or a hundredth of a metre."""
    steps = np.array([0.1 if body.kind.name == "revolute" else 0.01 for body in arm.coordinates])
    motion = aw.trajectories.Quintic(np.zeros(arm.n), steps, 0.8 * DURATION)
    law = aw.JointPID(kp=np.ones(arm.n), kd=np.ones(arm.n), gravity=True)
    scenario = aw.Scenario(arm, DURATION, loop=aw.Loop(law, motion, 1.0 / RATE, sensors=aw.Sensors(velocity="exact")))
    return aw.loops.design_gains(scenario, poses=POSES, bandwidth=BANDWIDTH).scenario


def ran(scenario: aw.Scenario, solver: aw.Solver) -> xarray.Dataset:
    """A run of the scenario by that solver."""
    return aw.simulate(replace(scenario, solver=solver))


def costs(scenario: aw.Scenario, lanes: int, solvers: Sequence[aw.Solver], what: str = "state") -> list[float]:
    """The least processor's time [s] of a run of many lanes by each solver, in turns."""
    start = aw.Start(aw.Batch(np.tile(scenario.initial_state[:, : scenario.arm.n], (lanes, 1))))
    many = replace(scenario, start=start, recording=aw.Recording(what=what))
    runs = [aw.simulation.Simulation(replace(many, solver=solver)) for solver in solvers]
    times: list[list[float]] = [[] for _ in runs]
    for _ in range(TIMED):
        for run, taken in zip(runs, times, strict=True):
            run.reset()
            begun = time.process_time()
            run.run(threads=1, keep_state=False)
            taken.append(time.process_time() - begun)
    return [min(taken) for taken in times]


def largest_error(run: xarray.Dataset, truth: xarray.Dataset) -> float:
    """Of positions and speeds over time, in parts of each one's range."""
    pairs = [(run[name].values, truth[name].values) for name in ("q", "qd")]
    return max(
        float((np.abs(ours - exact).max(axis=0) / np.maximum(np.ptp(exact, axis=0), LEAST)).max())
        for ours, exact in pairs
    )


def short(error: float) -> str:
    """A number of two digits without what its exponent does not need."""
    return f"{error:.1e}".replace("e-0", "e-")


def row(name: str, scenario: aw.Scenario) -> tuple[object, ...]:
    """A row of the table."""
    arm, sampled = scenario.arm, scenario.loop is not None
    exact = aw.Solver("cvodes")
    if sampled or any(sticks(body) for body in arm.bodies):
        exact = aw.Solver(accuracy=1e-8, max_substeps=10**6, global_error=False)
    truth, run = ran(scenario, exact), ran(scenario, aw.Solver())
    steps = float(run["steps_tried"]) / (1e3 * DURATION)
    alone, old = aw.Solver(global_error=False), aw.Solver("rk3", substeps=1) if sampled else aw.Solver("rk3", 1e-3)
    try:
        coarse = short(largest_error(ran(scenario, old), truth))
        ours, theirs = costs(scenario, LANES, (alone, old))
        beside = f"{ours / theirs:.2f}"
    except ArmwrightError:
        coarse, beside = "refused", ""
    finer = float(ran(scenario, aw.Solver(accuracy=FINER * ACCURACY, global_error=False))["steps_tried"]) / (
        1e3 * DURATION
    )
    judged, unjudged = costs(scenario, JUDGED, (aw.Solver(), alone))
    rule, error = run.attrs["rule"], largest_error(run, truth)
    return (
        name, arm.n, rule, f"{steps:.2f}", short(error), f"{steps * STAGES[rule]:.1f}", coarse, beside,
        f"{1.0 + len(lanes_again(JUDGED, np.ones(JUDGED))) / JUDGED * finer / steps:.2f}", f"{judged / unjudged:.2f}",
    )  # fmt: skip


def main() -> None:
    """Writes the table, a row at a time."""
    sys.path.insert(0, str(ROOT / "tests"))
    rows = []
    for name, arm in arms():
        for end, scenario in (("", swinging), (", 1 kHz loop", controlled)):
            try:
                rows.append(row(name + end, scenario(arm)))
            except ArmwrightError as error:
                rows.append((name + end, arm.n, "", "", error.what or "stopped", "", "", "", "", ""))
            print(*rows[-1], flush=True)
    with TABLE.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([HEAD, *rows])


if __name__ == "__main__":
    main()

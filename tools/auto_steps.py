"""Writes docs/data/auto-steps.csv: what steps of their own choice are wrong by and cost, beside rk3 at 1 ms.

    .venv/bin/python tools/auto_steps.py

Every built-in arm, and twenty of the `example-robot-data` wheel with motors that are sized by their effort limits, swing under
constant voltages, currents or torques. CVODES is the truth; where friction sticks, which it does not follow, steps of an accuracy
that is a hundred thousand times as high. The cost is the processor's time for the same run of many lanes, beside that of rk3
at 1 ms, the default before steps were chosen.
"""

from __future__ import annotations

import csv
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import xarray

import armwright as aw
from armwright.actuators.gear import sticks
from armwright.errors import ArmwrightError

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
)
OTHERS = 20  # robots of the wheel
MOST_JOINTS = 10
DURATION = 0.5  # [s]
SHARE = 0.2  # of each limit that is commanded
STAGES = {"rk45": 7, "rk3": 3, "rodas3": 3}  # evaluations a step
VOLTS, RATIO, CONSTANT, INERTIA = 48.0, 100.0, 0.1, 2e-5  # [V] [-] [N m/A] [kg m²] of the motors
SPARE = 2.0  # stall torque in effort limits
LANES, TIMED = 256, 5  # of runs whose time is taken, and how many of them
LEAST = 1e-12  # range of a joint that sticks
UNLIMITED = 10.0  # of a limit that is not stated [V | A | N m | N]


def arms() -> Iterator[tuple[str, aw.Model]]:
    """Names and arms: the built-in ones, then robots of the wheel with motors."""
    from armwright.description.database import builtin_names
    from reference.example_robots import robot_files

    for name in builtin_names():
        yield name, aw.load(name)
    count = 0
    for name, file in robot_files().items():
        if count == OTHERS:
            return
        with tempfile.TemporaryDirectory() as folder:
            arm = with_motors(file, Path(folder))
        if arm is not None:
            count += 1
            yield Path(name).stem, arm


def with_motors(file: Path, folder: Path) -> aw.Model | None:
    """A robot with motors in its revolute joints; None of one that does not load as it is, is long, or has other joints."""
    try:
        bare = aw.load(file)
    except ArmwrightError:
        return None
    bodies = bare.coordinates
    if bare.n > MOST_JOINTS or not all(body.kind == "revolute" and body.limits.torque < np.inf for body in bodies):
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


def swing(arm: aw.Model, solver: aw.Solver) -> xarray.Dataset:
    """The arm under these commands."""
    return aw.simulate(aw.Scenario(arm, DURATION, command=command(arm), solver=solver))


def cost(arm: aw.Model, solvers: Sequence[aw.Solver]) -> list[float]:
    """The least processor's time [s] of a run of many lanes by each solver, in turns."""
    commands = aw.Batch(np.tile(command(arm), (LANES, 1)))
    rows = aw.Recording(what="state")
    runs = [
        aw.Simulation(aw.Scenario(arm, DURATION, command=commands, solver=solver, recording=rows)) for solver in solvers
    ]
    times: list[list[float]] = [[] for _ in runs]
    for _ in range(TIMED):
        for run, taken in zip(runs, times, strict=True):
            run.reset()
            start = time.process_time()
            run.run(threads=1, keep_state=False)
            taken.append(time.process_time() - start)
    return [min(taken) for taken in times]


def largest_error(run: xarray.Dataset, truth: xarray.Dataset) -> float:
    """Of positions and speeds over time, in parts of each one's range."""
    pairs = [(run[name].values, truth[name].values) for name in ("q", "qd")]
    return max(
        float((np.abs(ours - exact).max(axis=0) / np.maximum(np.ptp(exact, axis=0), LEAST)).max())
        for ours, exact in pairs
    )


def row(name: str, arm: aw.Model) -> tuple[object, ...]:
    """A row of the table."""
    sticky = any(sticks(body) for body in arm.bodies)
    truth = swing(arm, aw.Solver(accuracy=1e-8, max_substeps=10**6) if sticky else aw.Solver("cvodes"))
    run = swing(arm, aw.Solver())
    steps = float(run["steps_tried"]) / (1e3 * DURATION)
    old = aw.Solver("rk3", 1e-3)
    try:
        coarse = f"{largest_error(swing(arm, old), truth):.1e}"
        ours, theirs = cost(arm, (aw.Solver(), old))
        beside = f"{ours / theirs:.2f}"
    except ArmwrightError:
        coarse, beside = "refused", ""
    rule = run.attrs["rule"]
    error = largest_error(run, truth)
    return name, arm.n, rule, f"{steps:.2f}", f"{error:.1e}", f"{steps * STAGES[rule]:.1f}", coarse, beside


def main() -> None:
    """Writes the table, a row at a time."""
    sys.path.insert(0, str(ROOT / "tests"))
    rows = []
    for name, arm in arms():
        try:
            rows.append(row(name, arm))
        except ArmwrightError as error:
            rows.append((name, arm.n, "", "", f"CVODES: {error.what or 'stopped'}", "", "", ""))
        print(*rows[-1])
    with TABLE.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([HEAD, *rows])


if __name__ == "__main__":
    main()

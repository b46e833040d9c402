"""Prints how an argument walks through the files of the package during a call: stays, files, folders and returns.

    .venv/bin/python tools/walks.py [--steps] [simulate | identify_arm | tune | inverse_kinematics | export_controller …]

Followed are the main argument and what is made from it, by their types (`FOLLOWED`). They reach a function that gets one of
them as an argument; `self` counts. Each function counts once, when it is reached first: a loop is no longer walk. Functions of
one file that are reached one after the other are one stay; a return is a stay in a file that the walk has left before. The calls
run once before, so that imports and compiling are no part of the walk. Another checkout's package is measured with its `src` on
PYTHONPATH.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import CodeType
from typing import Any

import numpy as np

import armwright

PACKAGE = Path(armwright.__file__).parent
SCENARIO = """
robot = "two-link"
duration_s = 0.3
loop.period_s = 1e-3
loop.controller = { kind = "joint_pid", kp = [400, 200], kd = [40, 20] }
loop.reference = { kind = "quintic", start = [0, 0], goal = [0.3, -0.2], duration = 0.2 }
"""
FOLLOWED = {
    "simulate": ("Scenario", "Loop", "NativeLoop", "Simulation", "Plant", "LoopState", "SimulationState"),
    "identify_arm": (
        *(
            "Log",
            "LogRun",
            "Census",
            "Block",
            "Stretch",
            "LogStretch",
            "Span",
            "Bridged",
            "_Bridged",
            "EvenRows",
            "Match",
        ),
        *("Preparation", "RunFilters", "Stream", "Samples", "LoggedMotion", "Equations", "Part", "LogPart", "Factor"),
        *("FitProblem", "_Fitted", "FittedLog", "ArmFit", "RecordParameters", "ArmEstimate"),
    ),
    "tune": ("Scenario", "Loop", "Space", "Objective", "Uncertainty", "TuningResult"),
    "inverse_kinematics": ("Model", "JointChain", "PoseSolver", "PoseSolutions"),
    "export_controller": ("Scenario", "Loop", "Plant", "Program"),
}


def walk(call: Callable[[], Any], followed: tuple[str, ...]) -> list[str]:
    """Files of the package that followed objects stay in, one after the other, relative to it."""
    steps: list[str] = []
    reached: set[CodeType] = set()

    def step(frame: Any, event: str, _: Any) -> None:
        code = frame.f_code
        if event != "call" or code in reached or not code.co_filename.startswith(str(PACKAGE)):
            return
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        if any(type(frame.f_locals.get(name)).__name__ in followed for name in names):
            reached.add(code)
            file = str(Path(code.co_filename).relative_to(PACKAGE))
            if not steps or steps[-1] != file:
                steps.append(file)

    call()
    sys.setprofile(step)
    try:
        call()
    finally:
        sys.setprofile(None)
    return steps


def found(home: str) -> Any:
    """A function or type by its home file: `simulation.simulation.simulate`."""
    room, _, name = home.rpartition(".")
    return getattr(importlib.import_module(f"armwright.{room}"), name)


def log_file(folder: Path) -> Path:
    """A log of the arm on a sum of sines, with a run for fitting and one that is held out."""
    arm, rng, t = found("model.load.load")("two-link"), np.random.default_rng(0), np.arange(2000) / 100.0
    phase = 2 * np.pi * np.outer(t, np.arange(1, 6)) / 20.0
    a, b = rng.normal(size=(2, 5, arm.n))
    w = 2 * np.pi * np.arange(1, 6)[:, None] / 20.0
    q, qd = np.sin(phase) @ a + np.cos(phase) @ b, np.cos(phase) @ (w * a) - np.sin(phase) @ (w * b)
    qdd = -np.sin(phase) @ (w**2 * a) - np.cos(phase) @ (w**2 * b)
    tau = found("kernels.compiled.compile_arm")(arm).inverse_dynamics(q, qd, qdd) + 0.1 * rng.normal(size=q.shape)
    heads = ["t", *(f"{name}{k}" for name in ("q", "tau") for k in range(arm.n))]
    table = np.column_stack([t, q, tau])
    np.savetxt(folder / "log.csv", table, delimiter=",", header=",".join(heads), comments="", fmt="%.12g")
    kinds = ("position", heads[1 : 1 + arm.n], "rad"), ("torque", heads[1 + arm.n :], "N m")
    signals = [f'{{ quantity = "{a}", columns = {b}, unit = "{c}", side = "joint" }}' for a, b, c in kinds]
    (folder / "arm.log.toml").write_text(
        f'robot = "two-link"\nhold_out = 0.25\nfiles.log.path = "log.csv"\n'
        f'time = {{ column = "t", unit = "s" }}\nsignals = [{", ".join(signals)}]\n'
    )
    return folder / "arm.log.toml"


def calls(folder: Path) -> dict[str, Callable[[], Any]]:
    """The calls that are measured, by name."""
    (folder / "a.scenario.toml").write_text(SCENARIO)
    scenario = found("scenarios.file.read_scenario")(folder / "a.scenario.toml")
    arm, log = found("model.load.load")("puma560"), found("identification.logs.read.read_log")(log_file(folder))
    pose = found("kernels.compiled.compile_arm")(arm).forward_kinematics(np.full(arm.n, 0.3))
    options = {"lanes": 8, "progress": False}
    options["margins"] = found("tuning.options.MarginConstraint")(poses=20)
    options["search"] = found("tuning.options.Search")(generations=2, candidates=8)
    return {
        "simulate": lambda: found("simulation.simulation.simulate")(scenario),
        "identify_arm": lambda: found("identification.arm.identify.identify_arm")(log),
        "tune": lambda: found("tuning.tune.tune")(scenario, **options),
        "inverse_kinematics": lambda: found("ik.solve.inverse_kinematics")(arm, pose),
        "export_controller": lambda: found("export.controller.write.export_controller")(scenario, folder / "c"),
    }


def main() -> None:
    """Prints the table."""
    chosen = [name for name in sys.argv[1:] if not name.startswith("-")] or list(FOLLOWED)
    print(f"{'call':20}{'stays':>8}{'files':>8}{'folders':>9}{'returns':>9}")
    with tempfile.TemporaryDirectory() as folder:
        measured = calls(Path(folder))
        for name in chosen:
            steps = walk(measured[name], FOLLOWED[name])
            files = Counter(steps)
            folders = {str(Path(each).parent) for each in steps}
            print(f"{name:20}{len(steps):8}{len(files):8}{len(folders):9}{len(steps) - len(files):9}")
            if "--steps" in sys.argv:
                print("\n".join(f"    {each}" for each in steps))


if __name__ == "__main__":
    main()

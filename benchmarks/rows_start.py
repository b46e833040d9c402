"""How long a user waits: imports, the first kernel from a cold and a warm cache, compile time against joints. Fresh processes."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from arms import random_states, timed_arm
from records import Record, Task
from rows_kernels import WORKS, pinocchio
from start import LIBRARIES
from timing import relative_error

import armwright as aw

SCRIPT = Path(__file__).with_name("start.py")
TIMES, QUICK_TIMES = 5, 1
KERNELS = ("inverse_dynamics", "forward_dynamics")
JOINTS, QUICK_JOINTS = (12, 30, 60, 100), (3,)
LONG = 30  # joints up to which compiling is measured several times
TOLERANCE = 1e-9


def tasks(quick: bool) -> list[Task]:
    """Fresh processes: some that start, one or more for every kernel that is compiled."""
    times = QUICK_TIMES if quick else TIMES
    starts = [
        Task("start", "start import armwright", lambda _: import_records(times)),
        Task("start", "start first kernel", lambda _: first_records(times)),
    ]
    compiles = [
        Task(
            "compile",
            f"compile {name} chain-{n}",
            partial(compile_records, name, n, 3 if n <= LONG and not quick else 1),
        )
        for n in (QUICK_JOINTS if quick else JOINTS)
        for name in KERNELS
    ]
    return starts + compiles


def import_records(times: int) -> list[Record]:
    """`import armwright` alone."""
    found = [fresh("import") for _ in range(times)]
    right = all(each["silent"] and each["is"] == aw.__version__ for each in found)
    return [_record({"work": "import armwright"}, 0.0 if right else np.nan, {"all": [f["seconds"] for f in found]})]


def first_records(times: int) -> list[Record]:
    """The first kernel of `puma560`, with nothing kept and with everything kept, in turns."""
    arm = aw.load("puma560")
    ramp = np.linspace(-1.0, 1.0, arm.n)
    truth = np.array(aw.inverse_dynamics(arm, ramp, ramp, ramp), dtype=float)
    found: dict[str, list[dict[str, Any]]] = {"cold": [], "warm": []}
    for _ in range(times):
        with tempfile.TemporaryDirectory() as cache:
            for which in found:
                found[which].append(fresh("first", cache=cache))
    made = []
    for which, runs in found.items():
        error = max(relative_error(np.array(run["tau"]), truth) for run in runs)
        names = [library.split(".")[0] for library in LIBRARIES]
        parts = {"ours": [r["ours"] for r in runs], "of it kernel": [r["kernel"] for r in runs]}
        parts |= {f"import {name}": [r[name] for r in runs] for name in names}
        parts["all"] = [run["ours"] + sum(run[name] for name in names) for run in runs]
        made.append(_record({"work": f"first kernel of puma560, {which} cache"}, error, parts))
    return made


def compile_records(name: str, joints: int, times: int, _: int) -> list[Record]:
    """Tracing and compiling one kernel with nothing kept."""
    arm = f"chain-{joints}"
    states, work = random_states(timed_arm(arm), 1), WORKS[name]
    truth = getattr(pinocchio(arm), name)(*(states[key] for key in work.inputs))[0]
    found = [fresh("compile", name, arm, cache="") for _ in range(times)]
    error = max(relative_error(np.array(run["result"]), truth) for run in found)
    labels = {"arm": arm, "joints": joints, "work": name, "operations": found[0]["operations"]}
    return [_record(labels, error, {"all": [run["seconds"] for run in found]})]


def fresh(*arguments: str, cache: str | None = None) -> dict[str, Any]:
    """What a new process says; `cache` is where it keeps code, "" nowhere."""
    environment = os.environ | ({"ARMWRIGHT_CACHE_DIR": cache} if cache is not None else {})
    command = [sys.executable, str(SCRIPT), *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def _record(labels: dict[str, Any], error: float, parts: dict[str, list[float]]) -> Record:
    """A row; its samples are milliseconds, its parts the best and the median of each."""
    passed = bool(error <= TOLERANCE)
    timings = {}
    for part, seconds in parts.items():
        samples = [1e3 * each for each in seconds]
        timings[part] = {"name": part, "error": error, "tolerance": TOLERANCE, "passed": passed}
        if passed:
            kept = [float(f"{sample:.4g}") for sample in samples]
            timings[part] |= {"median": statistics.median(samples), "best": min(samples), "samples": kept}
    return {"labels": labels, "timings": timings, "ratios": {}, "facts": {}, "checked": passed}


def notes(quick: bool) -> dict[str, list[str]]:
    several, once = (QUICK_TIMES, 1) if quick else (TIMES, 3)
    return {
        "start": [
            f"fresh processes, best of {several}, from the first statement on: Python's own start is not in it; ours: reading "
            "the robot's file, tracing, compiling or linking, and the call"
        ],
        "compile": [
            f"fresh processes, best of {once} up to {LONG} joints, one beyond; tracing in it; operations: of the traced program"
        ],
    }

"""Waiting times of a user: imports, first kernel from a cold and a warm cache, compile time against joints. Fresh processes."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from arms import random_states, timed_arm
from prompt import prompted
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
COMMANDS = {  # what a user waits for, and the packages that it cannot do without, as a test of the command line has them
    "--help": "typer.rich_utils, typer.core, typer.main",
    "info puma560": "typer.rich_utils, typer._adapters, pydantic, numpy, casadi, rich.table",
    "check puma560": "typer.rich_utils, typer._adapters, pydantic, numpy, casadi, rich.table",
    "simulate puma560 --voltage 0,0,0,0,0,0 --duration 0.1": (
        "typer.rich_utils, typer._adapters, pydantic, numpy, casadi, rich.table, llvmlite.binding, xarray;"
        "xarray.Dataset({'t': ('t', [0.0])})"  # which imports what xarray asks about arrays
    ),
}
WANTED = {  # [ms] at most
    "import armwright": {"all": 250.0},
    "first kernel of puma560, cold cache": {"all": 400.0},
    "first kernel of puma560, warm cache": {"kernel": 50.0},
    "armwright --help": {"above packages": 100.0},
    "armwright info": {"above packages": 300.0},
    "armwright check": {"above packages": 400.0},
    "armwright simulate": {"above packages": 700.0},
}


def tasks(quick: bool) -> list[Task]:
    """Fresh processes: some that start, one or more for every kernel that is compiled."""
    times = QUICK_TIMES if quick else TIMES
    starts = [
        Task("start", "start import armwright", lambda _: import_records(times)),
        Task("start", "start first kernel", lambda _: first_records(times)),
    ]
    if sys.platform != "win32":  # which has no pseudo-terminals of this kind
        starts.append(Task("start", "start armwright sim", lambda _: prompt_records(times)))
        starts.append(Task("commands", "start commands", lambda _: command_records(times)))
    if quick:
        return [*starts, *(_compile_task(KERNELS[0], joints, 1) for joints in QUICK_JOINTS)]
    return [*starts, *(_compile_task(name, n, 3 if n <= LONG else 1) for n in JOINTS for name in KERNELS)]


def _compile_task(name: str, joints: int, times: int) -> Task:
    return Task("compile", f"compile {name} chain-{joints}", partial(compile_records, name, joints, times))


def import_records(times: int) -> list[Record]:
    """`import armwright` alone."""
    results = repeated(times, "import")
    right = all(each["silent"] and each["is"] == aw.__version__ for each in results)
    return [_record({"work": "import armwright"}, 0.0 if right else np.nan, {"all": [f["seconds"] for f in results]})]


def first_records(times: int) -> list[Record]:
    """The first kernel of `puma560`, with nothing kept and with everything kept, in turns."""
    arm = aw.load("puma560")
    ramp = np.linspace(-1.0, 1.0, arm.n)
    truth = np.array(aw.inverse_dynamics(arm, ramp, ramp, ramp), dtype=float)
    results: dict[str, list[dict[str, Any]]] = {"cold": [], "warm": []}
    fresh("first", code="")  # leaves Python's bytecode
    for _ in range(times):
        with tempfile.TemporaryDirectory() as code:
            for which in results:
                results[which].append(fresh("first", code=code))
    records = []
    for which, runs in results.items():
        error = max(relative_error(np.array(run["tau"]), truth) for run in runs)
        names = [library.split(".")[0] for library in LIBRARIES]
        parts = {name: [run[name] for run in runs] for name in ("load", "kernel")}
        parts |= {f"import {name}": [r[name] for r in runs] for name in names}
        parts["all"] = [sum(run[name] for name in ("load", "kernel", *names)) for run in runs]
        records.append(_record({"work": f"first kernel of puma560, {which} cache"}, error, parts))
    return records


def prompt_records(times: int) -> list[Record]:
    """`armwright sim` until it asks, at a pseudo-terminal, Python's own start in it; once before, to fill the caches."""
    results = [prompted() for _ in range(times + 1)][1:]
    error = 0.0 if all(answered for _, answered in results) else np.nan
    return [_record({"work": "armwright sim to its prompt"}, error, {"all": [seconds for seconds, _ in results]})]


def command_records(times: int) -> list[Record]:
    """CPU time of commands whose kernels are cached, in turns with that of importing the packages that they need."""
    records = []
    with tempfile.TemporaryDirectory() as code:
        for command, packages in COMMANDS.items():
            both = [["-m", "armwright", *command.split()], ["-c", f"import {packages}"]]
            # the first one compiles
            turns = [[_cpu(arguments, code) for arguments in both] for _ in range(times + 1)][1:]
            parts = {"all": [ours for ours, _ in turns], "import packages": [theirs for _, theirs in turns]}
            parts["above packages"] = [statistics.median(ours - theirs for ours, theirs in turns)]
            records.append(_record({"work": f"armwright {command.split()[0]}"}, 0.0, parts))
    return records


def _cpu(arguments: list[str], code: str) -> float:
    """CPU time [s] of a new Python process that ends well."""
    environment = os.environ | {"PYTHONPYCACHEPREFIX": bytecode().name, "ARMWRIGHT_CACHE_DIR": code}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before = os.times()
    subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, check=True)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def compile_records(name: str, joints: int, times: int, _: int) -> list[Record]:
    """Tracing and compiling one kernel with nothing kept."""
    arm = f"chain-{joints}"
    states, work = random_states(timed_arm(arm), 1), WORKS[name]
    truth = getattr(pinocchio(arm), name)(*(states[key] for key in work.inputs))[0]
    results = repeated(times, "compile", name, arm, code="")
    error = max(relative_error(np.array(run["result"]), truth) for run in results)
    labels = {"arm": arm, "joints": joints, "work": name, "operations": results[0]["operations"]}
    return [_record(labels, error, {"all": [run["seconds"] for run in results]})]


def repeated(times: int, *arguments: str, code: str | None = None) -> list[dict[str, Any]]:
    """Output of so many new processes, one after the other; one before them leaves Python's bytecode."""
    return [fresh(*arguments, code=code) for _ in range(1 + times)][1:]


def fresh(*arguments: str, code: str | None = None) -> dict[str, Any]:
    """Output of a new process; `code` is where it keeps compiled kernels, "" nowhere."""
    environment = os.environ | {"PYTHONPYCACHEPREFIX": bytecode().name}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    if code is not None:
        environment["ARMWRIGHT_CACHE_DIR"] = code
    command = [sys.executable, str(SCRIPT), *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@cache
def bytecode() -> tempfile.TemporaryDirectory[str]:
    """Folder of the processes for Python's bytecode, as every installed package has it after it was first used."""
    return tempfile.TemporaryDirectory()


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
    facts = {"at_most": WANTED[labels["work"]]} if labels["work"] in WANTED else {}
    return {"labels": labels, "timings": timings, "ratios": {}, "facts": facts, "checked": passed}


def notes(quick: bool) -> dict[str, list[str]]:
    several, once = (QUICK_TIMES, 1) if quick else (TIMES, 3)
    return {
        "commands": [
            f"new processes, CPU time, kernels cached, least of {several} of each number, in turns with a process that only "
            "imports the packages that it needs (`COMMANDS` in benchmarks/rows_start.py); above packages: the median of the "
            "turns' differences"
        ],
        "start": [
            f"fresh processes, best of {several} of each number, from the first statement on: Python's own start is not in "
            "it, and its bytecode of all packages is there, as after any first use",
            "load: `aw.load`, that is our modules of descriptions and models, reading and checking the robot's file; kernel: "
            "`aw.compile` and the first call of `inverse_dynamics`, that is our modules of dynamics and kernels, tracing, "
            "compiling or reading from the cache, linking, computing; all: both and the libraries, one behind the other",
            "pydantic: with a first record of no more than a number, for which it imports most of itself and looks for "
            "plugins in all packages that are installed",
            "armwright sim: from the command until it asks, typed at a pseudo-terminal; Python's own start is in it",
        ],
        "compile": [
            f"fresh processes, best of {once} up to {LONG} joints, one beyond; tracing in it; operations: of the traced program"
        ],
    }

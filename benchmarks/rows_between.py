"""A batch between other work: ns per state by default, on one thread and on all, each call behind some other work."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from arms import random_states, timed_arm
from machine import processors
from records import Record, Task, record
from rows_kernels import WORKS, batch, checked, pinocchio
from timing import Contestant, Entry, Row, Timing

import armwright as aw

ROBOT = "puma560"
KERNELS = ("inverse_dynamics", "mass_matrix", "inverse_dynamics_derivatives")
SIZES, QUICK_SIZES = (1024, 4096, 16384, 65536), (1024,)
CHECKED = 512  # states that are compared; the others must be finite
TOUCHED = np.zeros(3_000_000)  # 24 MB, more than a core's caches hold
TURNS = 5  # samples of each contestant in a repetition
WORST = 1.1  # times the time of the best number of threads
OTHER_WORK: dict[str, Callable[[], object]] = {
    "nothing": lambda: None,
    "24 MB touched": lambda: TOUCHED.__iadd__(1.0),
    "4 ms of sleep": lambda: time.sleep(4e-3),
}


def tasks(quick: bool) -> list[Task]:
    """A race for every kernel, number of states and kind of work between."""
    return [
        Task("between", f"{ROBOT} {name} batch of {size} between other work", partial(between_records, name, size))
        for name in (KERNELS[:1] if quick else KERNELS)
        for size in (QUICK_SIZES if quick else SIZES)
    ]


def between_records(name: str, size: int, repetitions: int) -> list[Record]:
    """A row for each kind of work between: the default beside one thread and all of them."""
    states = random_states(timed_arm(ROBOT), size)
    inputs = [states[key] for key in WORKS[name].inputs]
    check = checked(getattr(pinocchio(ROBOT), name)(*(values[:CHECKED] for values in inputs)))
    contestants = {}
    for column, threads in (("default", None), ("one", 1), ("all", processors())):
        dyn = aw.compile(timed_arm(ROBOT))
        if threads is not None:
            dyn.threads = threads
        contestants[column] = batch(column, getattr(dyn, name), inputs, check)
    rows = []
    for between, work in OTHER_WORK.items():
        labels = {"arm": ROBOT, "work": name, "states": size, "between": between}
        entry = Entry(labels, contestants, {"one": "default", "all": "default"})
        rows.append(Row(entry, _timed(contestants, work, TURNS * repetitions)))
    records = [record(row) for row in rows]
    for each in records:
        times = {column: timing["median"] for column, timing in each["timings"].items() if timing["passed"]}
        each["facts"] = {"times of the best": times["default"] / min(times.values())} if "default" in times else {}
    return records


def _timed(contestants: dict[str, Contestant], between: Callable[[], object], turns: int) -> dict[str, Timing]:
    """Single calls in turns, the other work before each of them outside its time."""
    timings = {column: Timing(each.name, each.check(each.run()), []) for column, each in contestants.items()}
    for _ in range(turns):
        for column, each in contestants.items():
            between()
            start = time.perf_counter()
            each.run()
            timings[column].samples.append(1e9 * (time.perf_counter() - start) / each.units)
    return timings


def notes(quick: bool) -> dict[str, list[str]]:
    """Notes of the chapter for its reader."""
    return {
        "between": [
            "single calls, each behind the other work, which is not timed; into arrays that are used again",
            f"wanted of the default: at most {WORST:g} times the median of the best number of threads",
        ]
    }

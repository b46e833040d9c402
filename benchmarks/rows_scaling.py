"""`puma560` over batch sizes and threads: ns per state, and how many cores the threads really have."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from arms import random_states, timed_arm
from machine import cores, processors
from peak import ROUNDS, fma_loop
from records import Record, Task, record
from rows_kernels import WORKS, batch, checked, compiled, looped, pinocchio, pinocchio_loop
from timing import Check, Contestant, Entry, race

import armwright as aw
from armwright.kernels.batch import PART

ROBOT = "puma560"
KERNELS = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "inverse_dynamics_derivatives")
SIZES, QUICK_SIZES = (1, 8, 64, 512, 4096, 32768, 262144), (1, 64)
MANY, QUICK_MANY = 65536, 4096  # states that threads share
LONG_ROUNDS = 20 * ROUNDS  # so that waking a thread is nothing beside them
CHECKED = 512  # states that are compared; the others must be finite


def tasks(quick: bool) -> list[Task]:
    """A race for every kernel and batch size, and one for every kernel's threads."""
    kernels = KERNELS[:1] if quick else KERNELS
    sizes = [
        Task("batch size", f"{ROBOT} {name} batch of {size}", partial(size_records, name, size))
        for name in kernels
        for size in (QUICK_SIZES if quick else SIZES)
    ]
    threads = [Task("threads", f"{ROBOT} {name} threads", partial(thread_records, name, quick)) for name in kernels]
    return [*sizes, Task("threads", "fused multiply-adds threads", peak_records), *threads]


def size_records(name: str, size: int, repetitions: int) -> list[Record]:
    """One size, beside the peer's loop over as many of those states as are compared."""
    inputs, truth, check = _states(name, size)
    contestants = {"batch": batch("a batch", getattr(compiled(ROBOT), name), inputs, check)}
    native = pinocchio_loop(ROBOT)
    if native is not None:
        few = [values[:CHECKED] for values in inputs]
        contestants["pinocchio_loop"] = looped(native, name, few, truth, check)
    beside = {"pinocchio_loop": "batch"} if native is not None else {}
    labels = {"arm": ROBOT, "joints": timed_arm(ROBOT).n, "work": name, "states": size}
    return [record(row) for row in race([Entry(labels, contestants, beside)], repetitions)]


def thread_records(name: str, quick: bool, repetitions: int) -> list[Record]:
    """One thread and more of them, in one race with as many of bare multiply-adds: what the machine could give in that minute."""
    many = QUICK_MANY if quick else MANY
    inputs, _, check = _states(name, many)

    def contestant(count: int) -> Contestant:
        dyn = aw.compile(timed_arm(ROBOT))
        dyn.threads = count
        return batch(f"{count} threads", getattr(dyn, name), inputs, check)

    return _threads({"arm": ROBOT, "work": name, "states": many}, contestant, repetitions, beside=_bare)


def peak_records(repetitions: int) -> list[Record]:
    """The machine's limit on one thread and more: what threads could bring at best."""
    return _threads({"arm": "", "work": "fused multiply-adds, nothing else", "states": 1}, _bare, repetitions)


def _bare(count: int) -> Contestant:
    """Fused multiply-adds and nothing else, on so many threads."""
    loops = [fma_loop(compiled(ROBOT).target, LONG_ROUNDS) for _ in range(count)]
    pool = ThreadPoolExecutor(count)

    def run() -> None:
        list(pool.map(lambda loop: loop[0](), loops))

    def check(_: Any) -> Check:
        return Check(max(float(np.abs(out - 2.0).max()) for _, out in loops), 1e-12)

    return Contestant(f"{count} threads", run, count * LONG_ROUNDS * loops[0][1].size, check)


def _threads(
    labels: dict[str, Any],
    contestant: Callable[[int], Contestant],
    repetitions: int,
    beside: Callable[[int], Contestant] | None = None,
) -> list[Record]:
    counts = thread_counts()
    columns = {("threads", "one"): contestant, ("bare", "bare one"): beside}
    runs = {pair: {count: make(count) for count in counts} for pair, make in columns.items() if make is not None}
    entries = []
    for count in counts:  # how many times as fast as one thread: the one's time over that of the several
        contestants = {
            name: run for (several, one), by in runs.items() for name, run in ((several, by[count]), (one, by[1]))
        }
        entries.append(Entry({**labels, "threads": count}, contestants, {one: several for several, one in runs}))
    return [record(row) for row in race(entries, repetitions)]


def thread_counts() -> list[int]:
    """1, 2, 4, … and all processors that this process may use."""
    every = processors()
    return sorted({*(2**k for k in range(every.bit_length()) if 2**k <= every), every})


def _states(name: str, count: int) -> tuple[list[np.ndarray], Any, Callable[[Any], Check]]:
    work = WORKS[name]
    states = random_states(timed_arm(ROBOT), count)
    inputs = [states[key] for key in work.inputs]
    truth = getattr(pinocchio(ROBOT), name)(*(values[:CHECKED] for values in inputs))
    return inputs, truth, checked(truth)


def notes(quick: bool) -> dict[str, list[str]]:
    physical, text = cores()
    return {
        "batch size": [
            "from Python: a call costs microseconds, whatever is in it; Pinocchio's loop is called the same way, through ctypes"
        ],
        "threads": [
            f"{processors()} of {os.cpu_count()} processors may be used, on {physical or 'an unknown number of'} cores: {text}",
            "the rows of fused multiply-adds tell what more threads bring where nothing but arithmetic is done: two that share "
            "a core share its ports, and two threads then stay near 1; beside a kernel: what they gained in the same race",
            f"a thread is given {PART:,} operations on whole tiles at least, some 0.3 ms",
        ],
    }

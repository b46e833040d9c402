"""One call from Python of one state, 8 and 64: plain and bound, beside Pinocchio's own functions and the general path."""

from __future__ import annotations

import time
from functools import partial

import numpy as np
from arms import random_states, timed_arm
from records import Record, Task, record
from rows_kernels import WORKS, checked, compiled, first, pinocchio, pinocchio_single
from timing import Contestant, Entry, race

import armwright as aw

ARMS, QUICK_ARMS = ("puma560", "panda"), ("puma560",)
STATES = (1, 8, 64)
PINOCCHIO = 1.8  # times as fast as Pinocchio from Python
BOUND = 0.83  # of a bound call's speed, for a batch: 1.2 times its time
ASKED = ("inverse_dynamics", "mass_matrix", "forward_dynamics")


def tasks(quick: bool) -> list[Task]:
    """A race for every arm and kernel, of all numbers of states."""
    names = ASKED[:1] if quick else WORKS
    arms = QUICK_ARMS if quick else ARMS
    return [Task("calls", f"calls {arm} {name}", partial(call_records, arm, name)) for arm in arms for name in names]


def call_records(arm: str, name: str, repetitions: int) -> list[Record]:
    """A row for each number of states."""
    work, dyn, wheel = WORKS[name], compiled(arm), pinocchio(arm)
    states = random_states(timed_arm(arm), max(STATES))
    kernel = dyn.kernel(name)
    entries = []
    for count in STATES:
        inputs = [np.ascontiguousarray(states[key][:count]) for key in work.inputs]
        check = checked(getattr(wheel, name)(*inputs))
        lead = (count,)
        if count == 1:
            inputs, check, lead = [values[0].copy() for values in inputs], first(check), ()
        held = getattr(aw.compile(timed_arm(arm)), name)  # before its first call
        for _ in range(2):  # the second call makes the native function
            held(*inputs)
            getattr(dyn, name)(*inputs)
        bound = dyn.bind(name, lead=lead, **dict(zip(work.inputs, inputs, strict=True)))
        contestants = {
            "plain": Contestant("plain", partial(getattr(dyn, name), *inputs), 1, check),
            "held": Contestant("held", partial(held, *inputs), 1, check),
            "bound": Contestant("bound", bound, 1, check),
            "general": Contestant("general path", partial(kernel, *inputs), 1, check),
        }
        expected = {} if count == 1 else {"bound": BOUND}
        if count == 1:
            alone = checked(getattr(wheel, name)(*(values[None] for values in inputs)))
            contestants["pinocchio_python"] = pinocchio_single(wheel, name, inputs, alone)
            expected = {"pinocchio_python": PINOCCHIO} if name in ASKED else {}
        beside = {column: "plain" for column in contestants if column != "plain"}
        labels = {"arm": arm, "joints": dyn.arm.n, "work": name, "states": count}
        entries.append(Entry(labels, contestants, beside, expected))
    # All work is this process's own: time that it waits for a processor does not count.
    return [record(row) for row in race(entries, repetitions, clock=time.process_time)]


def notes(quick: bool) -> dict[str, list[str]]:
    """Notes of the chapter for its reader."""
    return {
        "calls": [
            "plain: `dyn.inverse_dynamics(q, qd, qdd)`, which allocates its result; bound: `dyn.bind`, into arrays that are used "
            "again; general path: in Python, for lists, broadcasting and other types, here with the same arrays; one thread",
            "wanted: one state 1.8 times as fast as Pinocchio's `rnea`, `crba` and `aba` from Python; 8 and 64 states at most "
            "1.2 times the bound call (bound ÷ plain at least 0.83); times of this process alone, without what it waits",
        ]
    }

"""Results larger than the cache: ns per state of few and of many states, beside a fill of as many bytes."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from arms import random_states, timed_arm
from records import Record, Task, record
from rows_kernels import TOLERANCE, batch, compiled
from timing import Check, Contestant, Entry, race, relative_error

from armwright import dynamics
from armwright.kernels.llvm import STREAMED

ROWS = (
    ("puma560", "regressor"),
    ("puma560", "mass_matrix"),
    ("puma560", "inverse_dynamics_derivatives"),
    ("chain-20", "inverse_dynamics_derivatives"),
    ("chain-30", "mass_matrix"),
)
FEW, SOME, PLAIN, MANY, QUICK_MANY = 256, 1024, 4096, 65536, 1024  # states
CHECKED = 4  # states that are compared with the plain function; the others must be finite


def tasks(quick: bool) -> list[Task]:
    """A race for every arm and kernel."""
    return [
        Task("large results", f"{arm} {name} large", partial(large_records, arm, name, quick))
        for arm, name in (ROWS[:1] if quick else ROWS)
    ]


def large_records(arm: str, name: str, quick: bool, repetitions: int) -> list[Record]:
    """One row: few states, 1024, 4096 with and without new arrays, many, and a fill of the many results' bytes, in one race."""
    model, dyn, many = timed_arm(arm), compiled(arm), QUICK_MANY if quick else MANY
    states = random_states(model, many)
    ports = dyn.kernel(name).program.inputs
    inputs = [states[port.name] for port in ports]
    plain = getattr(dynamics, name)
    rows = [_parts(plain(model, *(values[k] for values in inputs))) for k in range(CHECKED)]
    check = _checked([np.array(part) for part in zip(*rows, strict=True)])
    contestants = {
        column: batch(f"{count} states", getattr(dyn, name), [values[:count].copy() for values in inputs], check)
        for column, count in (("few", FEW), ("some", SOME), ("again", min(PLAIN, many)), ("many", many))
    }
    contestants["plain"] = plain_call(getattr(dyn, name), [values[:PLAIN].copy() for values in inputs], check)
    size = sum(port.size for port in dyn.kernel(name).program.outputs)
    filled = np.zeros(many * size)
    contestants["fill"] = Contestant("a fill", lambda: filled.fill(1.0), many, lambda _: Check(0.0, TOLERANCE))
    labels = {"arm": arm, "joints": model.n, "work": name, "states": many, "bytes": 8 * size}
    entry = Entry(labels, contestants, {"few": "many", "fill": "many", "again": "plain"})
    return [record(row) for row in race([entry], repetitions, clock=time.process_time)]


def plain_call(run: Callable[..., Any], inputs: list[np.ndarray], check: Callable[[Any], Check]) -> Contestant:
    """A batch into new arrays, as most programs ask for it."""
    return Contestant("a plain call", lambda: run(*inputs), len(inputs[0]), check)


def _parts(result: Any) -> tuple[np.ndarray, ...]:
    return result if isinstance(result, tuple) else (result,)


def _checked(truths: list[np.ndarray]) -> Callable[[Any], Check]:
    """Compares the first states with the plain function; all of the result must be finite."""

    def check(result: Any) -> Check:
        errors = [
            relative_error(part[:CHECKED], true, true.ndim - 1) if np.isfinite(part).all() else np.nan
            for part, true in zip(_parts(result), truths, strict=True)
        ]
        return Check(float(np.max(errors)), TOLERANCE)

    return check


def notes(quick: bool) -> dict[str, list[str]]:
    """Notes of the chapter for its reader."""
    return {
        "large results": [
            f"few: {FEW} states; one thread, into arrays that are used again; CPU time",
            f"plain: a call of {PLAIN} states that gives new arrays; again: the same into arrays that are used again",
            f"from {STREAMED >> 20} MiB of results on they are written past the cache, where rows have more than 32 columns",
            "a fill: `ndarray.fill`, of as many bytes as the many results have",
            "error: against the plain functions",
        ]
    }

"""Cost of chosen steps and of sticking: ns for a simulated ms, beside rk3 with a fixed step on the same arm.

Lanes have different commands, so that each chooses other steps. What a step given by hand pays for its note, which tells of one
that is too coarse, is its time beside that of the same run without the note.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import xarray
from records import Record, Task, record
from timing import Check, Contestant, Entry, race

import armwright as aw

ARMS = ("cmu-dd", "lwa4p", "puma560")
DURATION = 0.2  # [s]
PUSH = 2.0  # commands within ± this [V | A]
LARGEST_DIFFERENCE = 0.1  # of a range: how far these runs, of the same rule, may be from each other


def tasks(quick: bool) -> list[Task]:
    """One race an arm."""
    return [Task("auto", f"{name} auto", partial(auto_records, name, quick)) for name in ARMS]


def auto_records(name: str, quick: bool, repetitions: int) -> list[Record]:
    """A row: rk3, with its note and without, auto, and rk3 of the arm whose friction sticks."""
    arm, lanes = aw.load(name), size(quick)
    commands = np.random.default_rng(5).uniform(-PUSH, PUSH, (lanes, arm.n))
    fixed = runner(arm, aw.Solver("rk3"), commands)
    truth = fixed()["q"].values

    def check(run: xarray.Dataset) -> Check:
        away = np.abs(run["q"].values[:, -1] - truth[:, -1]) / np.ptp(truth, axis=1).clip(1e-3)
        return Check(float(away.max()) if np.isfinite(away).all() else float("nan"), LARGEST_DIFFERENCE)

    works = {"rk3": fixed, "auto": runner(arm, aw.Solver(), commands)}
    works["unnoted"] = runner(arm, aw.Solver("rk3"), commands, Unnoted)
    works["sticking"] = runner(sticking(arm), aw.Solver("rk3"), commands)
    ticks = round(lanes * DURATION / 1e-3)
    checks = {"sticking": lambda run: Check(float(not np.isfinite(run["q"].values).all()), 0.5)}
    contestants = {which: Contestant(which, work, ticks, checks.get(which, check)) for which, work in works.items()}
    labels = {"arm": name, "joints": arm.n, "work": "a simulated ms", "lanes": lanes}
    entry = Entry(labels, contestants, {"auto": "rk3", "rk3": "unnoted", "sticking": "rk3"}, {})
    return [record(row) for row in race([entry], repetitions)]


def sticking(arm: aw.Model) -> aw.Model:
    """The arm with friction and gear loss that no speed smooths."""
    bodies = [
        replace(
            body,
            friction=None if body.friction is None else replace(body.friction, smoothing=None),
            drive=replace(body.drive, smoothing=None),
        )
        for body in arm.bodies
    ]
    return replace(arm, bodies=tuple(bodies))


class Unnoted(aw.simulation.Simulation):
    """Simulation that never looks whether its step is too coarse."""

    def _note_coarse_step(self, *_: object) -> None:
        """Nothing."""


def runner(
    arm: aw.Model,
    solver: aw.Solver,
    commands: np.ndarray,
    kind: type[aw.simulation.Simulation] = aw.simulation.Simulation,
) -> Callable[[], xarray.Dataset]:
    """Runs the lanes, compiled before."""
    kept = aw.Recording(every=20, what="state")
    scenario = aw.Scenario(arm, duration=DURATION, command=aw.Batch(commands), solver=solver, recording=kept)
    simulation = kind(scenario)

    def run() -> xarray.Dataset:
        simulation.reset()
        return simulation.run(threads=1, keep_state=False)

    return run


def size(quick: bool) -> int:
    """Lanes."""
    return 64 if quick else 1024


def notes(quick: bool) -> dict[str, list[str]]:
    lines = [
        f"{size(quick):,} lanes of {DURATION:g} s, constant commands within ±{PUSH:g}, one thread, rows every 20 ms; "
        "sticking: the same arm without smoothing speeds",
    ]
    return {"auto": lines}

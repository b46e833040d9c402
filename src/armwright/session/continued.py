"""`simulate continue`: all that goes on where the last simulation ended, and one run of the two.

The plant begins in the last row of the run before, with its motors, currents, bristles, temperatures and bus; a controller
that is wired as it was, with what it remembered, and with the command that was in force there.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.session.state import State
from armwright.simulation.results.spoken import PARTIAL

if TYPE_CHECKING:
    import xarray as xr

MEMORY, COMMAND = "controller_memory", "command_before"  # attributes of a controlled run, as it ended
WIRED = "controller_settings"  # attribute: what `wiring_told` said
WORLD = ("gravity_z", "payload")  # attributes: what `world_told` said
LAST = (MEMORY, COMMAND, WIRED, PARTIAL, *WORLD)  # attributes that are the later part's
TIME = re.compile(r"\bt = (?P<seconds>[-+\d.e]+) s\b")
ROWS = re.compile(r"\bof the rows(?! from)")


@dataclass(frozen=True, eq=False)
class Resumed:
    """A control law that goes on with what it remembered.

    Attributes:
        law: the law.   memory: (k,) its state before it sees the first sample.
    """

    law: Any
    memory: np.ndarray

    def fitted(self, arm: Any, period: float) -> Resumed:
        """The same of the law, where it asks for arm and period."""
        return replace(self, law=self.law.fitted(arm, period)) if hasattr(self.law, "fitted") else self

    def init(self, arm: Any, y: Any) -> np.ndarray:
        """What was remembered."""
        return np.array(self.memory, dtype=float)

    def step(self, t: Any, r: Any, y: Any, s: Any) -> Any:
        """The law's own."""
        return self.law.step(t, r, y, s)


def wiring_told(state: State) -> str:
    """What a controller's memory belongs to, in words: law, gains and sampling time."""
    if state.wiring is None:
        return ""
    gains = " ".join(f"{name}={text}" for name, text in sorted(state.wiring.settings.items()))
    return f"{state.wiring.kind} {gains} every {state.dac_period!r} s"


def world_told(state: State) -> dict[str, str]:
    """What a run is moved by besides its drives, in words: gravity, and what the hand holds."""
    held = state.loaded.payload
    told = "none" if held is None else repr((held.mass, held.com, held.inertia, held.frame or state.arm.tip))
    return dict(zip(WORLD, (f"{float(state.arm.gravity[2])!r} m/s²", told), strict=True))


def was_moved(state: State, before: xr.Dataset) -> bool:
    """Whether theta or omega is another than at the end of the run before."""
    return any(not np.array_equal(before[name].values[-1], own) for name, own in (("q", state.q), ("qd", state.qd)))


def beginning(state: State, before: xr.Dataset | None) -> dict[str, Any]:
    """Where a scenario begins: in theta and omega, or in all states at the end of the run before."""
    if before is None or was_moved(state, before):
        return {"q0": state.q, "qd0": state.qd}
    return {"initial": before.isel(time=[-1])}


def resumed(state: State, law: Any, before: xr.Dataset | None) -> dict[str, Any]:
    """The controller of a scenario; one that goes on knows what it remembered, and the command in force before."""
    if before is None or not _goes_on(state, before):
        return {"controller": law}
    command = np.asarray(before.attrs[COMMAND], dtype=float)
    return {"controller": Resumed(law, np.asarray(before.attrs[MEMORY], dtype=float)), "initial_command": command}


def _goes_on(state: State, before: xr.Dataset) -> bool:
    known = {MEMORY, COMMAND} <= set(before.attrs) and before.attrs.get(WIRED) == wiring_told(state)
    return known and not was_moved(state, before)


def begun_anew(state: State, before: xr.Dataset) -> list[str]:
    """What does not go on, in words."""
    from armwright.simulation.plant.plant import Plant

    found = []
    if was_moved(state, before) and Plant.of(state.arm).size > 2 * state.arm.n:
        found.append("what the drives remember besides theta and omega")
    if state.wiring is not None and before.attrs.get(WIRED) and not _goes_on(state, before):
        found.append(f"the state of {state.wiring.kind}")
    return found


def joined_runs(before: xr.Dataset, behind: xr.Dataset, anew: list[str]) -> xr.Dataset:
    """A run and its continuation as one; the row where they meet is the later one's, whose commands hold from there on.

    Args:
        before, behind: the runs.   anew: what began anew where they meet, for the notes.
    """
    import xarray as xr

    met = float(before["time"][-1])
    shifted = behind.assign_coords(time=("time", behind["time"].values + met, behind["time"].attrs))
    whole = xr.concat(
        [before.isel(time=slice(None, -1)), shifted], "time",
        data_vars="all", coords="minimal", compat="override", join="override", combine_attrs="override",
    )  # fmt: skip
    whole = whole.transpose("time", "joint")
    notes = [*part_notes(before, 0.0), *part_notes(behind, met)]
    notes = list({TIME.sub("", note): note for note in reversed(notes)}.values())[::-1]  # of the same note the first
    notes += [f"{what} began anew at t = {met:g} s" for what in anew]
    changed = [name for name in WORLD if before.attrs.get(name) != behind.attrs.get(name) and name in before.attrs]
    notes += [
        f"{name.removesuffix('_z')} was changed at t = {met:g} s, between two parts of the run" for name in changed
    ]
    if any(not np.array_equal(before[name].values[-1], behind[name].values[0]) for name in ("q", "qd")):
        notes.append(f"theta or omega was set at t = {met:g} s, between two parts of the run")
    shared = set(before.attrs) & set(behind.attrs) - set(LAST)
    attrs = {name: value for name, value in before.attrs.items() if name in shared and value == behind.attrs[name]}
    attrs["notes"] = "\n".join(notes)
    whole.attrs = attrs | {name: behind.attrs[name] for name in LAST if name in behind.attrs}
    return whole


def part_notes(run: xr.Dataset, start: float) -> list[str]:
    """A part's notes, with the times that they have in the whole: the part begins at `start` [s] there."""
    later = TIME.sub(lambda told: f"t = {float(told['seconds']) + start:g} s", str(run.attrs.get("notes", "")))
    span = f"of the rows from {start:g} to {start + float(run['time'][-1]):g} s"
    return ROWS.sub(span, later).splitlines()

"""`simulate continue`: start of the scenario in the state that the last simulation ended in, and one run of both parts."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.results.aliases import LOOP_STATE, PARTIAL
from armwright.session.state import State
from armwright.simulation.loop.state import END, LoopState

if TYPE_CHECKING:
    import xarray as xr

WIRED = "controller_settings"  # attribute: what `wiring_told` said
WORLD = ("gravity_z", "payload")  # attributes: what `world_told` said
PLANT = ("x", "u", "frozen")  # blocks of a loop's state that are the plant's
LAST = (WIRED, PARTIAL, *WORLD)  # attributes that are the later part's
TIME = re.compile(r"\bt = (?P<seconds>[-+\d.e]+) s\b")
ROWS = re.compile(r"\bof the rows(?! from)")


def wiring_told(state: State) -> str:
    """Law, gains and sampling time of the controller, to which its memory belongs; "" without one."""
    if state.wiring is None:
        return ""
    gains = " ".join(f"{name}={text}" for name, text in sorted(state.wiring.settings.items()))
    return f"{state.wiring.kind} {gains} every {state.dac_period!r} s"


def world_told(state: State) -> dict[str, str]:
    """Gravity and payload of a run, in words."""
    held = state.loaded.payload
    told = "none" if held is None else repr((held.mass, held.com, held.inertia, held.frame or state.arm.tip))
    return dict(zip(WORLD, (f"{float(state.arm.gravity[2])!r} m/s²", told), strict=True))


def was_moved(state: State, before: xr.Dataset) -> bool:
    """True if theta or omega was set since the end of the run before."""
    return any(not np.array_equal(before[name].values[-1], own) for name, own in (("q", state.q), ("qd", state.qd)))


def start_of(state: State, before: xr.Dataset | None, period: float) -> dict[str, Any]:
    """Fields of the scenario that say where it starts: theta and omega, or the state at the end of the run before.

    Of that state, another controller or another period takes the plant and its commands alone.

    Args:
        state: the session's.   before: the run that it goes on from, if any.   period: [s] of a tick.
    """
    end = _end_of(state, before)
    if end is None:
        return {"q0": state.q, "qd0": state.qd}
    if end.period == period and before is not None and before.attrs.get(WIRED, "") == wiring_told(state):
        return {"start": end}
    plant = {name: values for name, values in end.blocks.items() if name in PLANT}
    tick = end.tick if end.period == period else 0  # another period counts anew; `joined_runs` shifts the times
    return {"start": LoopState(tick, period, end.single, end.entries, plant)}


def begun_anew(state: State, before: xr.Dataset) -> list[str]:
    """States that do not go on, in words."""
    from armwright.simulation.plant.plant import Plant

    end, wired, found = _end_of(state, before), before.attrs.get(WIRED), []
    if end is None and Plant.of(state.arm).size > 2 * state.arm.n:
        found.append("what the drives remember besides theta and omega")
    if state.wiring is not None and wired and (end is None or wired != wiring_told(state)):
        found.append(f"the state of {state.wiring.kind}")
    return found


def _end_of(state: State, before: xr.Dataset | None) -> LoopState | None:
    """State of the loop at the end of a run; None if theta or omega was set since, or the run does not have it."""
    return None if before is None or was_moved(state, before) else LoopState.of_run(before)


def joined_runs(before: xr.Dataset, behind: xr.Dataset, anew: list[str]) -> xr.Dataset:
    """A run and its continuation as one; the row where they meet is the later one's, whose commands hold from there on.

    Args:
        before, behind: the runs.   anew: what began anew where they meet, for the notes.
    """
    import xarray as xr

    met = float(before["time"][-1])
    shift = met - float(behind["time"][0])
    shifted = behind.assign_coords(time=("time", behind["time"].values + shift, behind["time"].attrs))
    parts = (before.isel(time=slice(None, -1)), shifted)
    whole = xr.concat(
        [part.drop_vars(LOOP_STATE, errors="ignore") for part in parts], "time",
        data_vars="all", coords="minimal", compat="override", join="override", combine_attrs="override",
    )  # fmt: skip
    whole = whole.transpose("time", "joint")
    if LOOP_STATE in behind:
        whole[LOOP_STATE] = behind[LOOP_STATE].assign_attrs({END: float(whole["time"][-1])})
    notes = [*part_notes(before, 0.0), *part_notes(behind, shift)]
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


def part_notes(run: xr.Dataset, shift: float) -> list[str]:
    """A part's notes, with the times that they have in the whole: `shift` [s] later."""
    later = TIME.sub(lambda told: f"t = {float(told['seconds']) + shift:g} s", str(run.attrs.get("notes", "")))
    span = f"of the rows from {shift + float(run['time'][0]):g} to {shift + float(run['time'][-1]):g} s"
    return ROWS.sub(span, later).splitlines()

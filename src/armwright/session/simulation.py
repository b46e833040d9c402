"""`simulate`: runs the scenario of the session's variables, and appends it to the run that it continues."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import armwright as aw
from armwright.errors import ScenarioError, SessionError
from armwright.model.joint_signals import joint_units
from armwright.results.aliases import LOOP_END, LOOP_STATE, PARTIAL
from armwright.results.notes import limit_notes_of, notes_of
from armwright.session.arguments import quoted
from armwright.session.controllers import built_controller
from armwright.session.listing import Output, TextLine, by_joint
from armwright.session.state import SessionState
from armwright.session.workspace import Workspace
from armwright.simulation.inputs.schedule import Schedule

if TYPE_CHECKING:
    import xarray as xr

WHOLE = 1e-9  # of a period: this near to a whole number of steps is one
CONTROLLER = "controller_settings"  # attribute of a run: controller, gains and sampling time
WORLD = ("gravity_z", "payload")  # attributes of a run
PLANT = ("x", "u", "frozen")  # blocks of a loop's state that are the plant's
OF_THE_LAST = (CONTROLLER, PARTIAL, *WORLD)  # attributes of joined runs that are those of the last one


def simulate(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`simulate`: new or continued, from zero or from theta and omega, by a schedule or with constant commands."""
    state = session.state
    if arguments["zero"] == "yes":
        zero = np.zeros(state.arm.n)
        state = state.replace(q=zero, qd=zero)
    before = state.run if arguments["start"] == "continue" else None
    scenario = scenario_of(state, arguments["schedule"], arguments["steps"], arguments["every"], before)
    steps = round(float(scenario.duration or 0.0) / state.step)
    run, steps = _run(session, state, scenario, arguments, steps, before)
    run.attrs |= _attributes(state)
    session.play(run)
    joined = run if before is None else joined_runs(state, before, run)
    last = {name: np.array(run[name].values[-1], dtype=float) for name in ("q", "qd", "qdd", "u") if name in run}
    session.state = state = state.replace(**last, run=joined)
    word = f"partial: {joined.attrs[PARTIAL]}; " if PARTIAL in joined.attrs else ""
    line = TextLine(f"{word}{steps} steps of {state.step * 1e3:g} ms, t = {float(joined['time'][-1]):g} s", "good")
    vectors = (("theta", "q", state.q), ("omega", "qd", state.qd), ("alpha", "qdd", state.qdd))
    table = by_joint("", state.arm.names, [(name, joint_units(state.arm, q), values) for name, q, values in vectors])
    known = [] if before is None else notes_of(before)
    return [line, table, *(TextLine(note, "note") for note in notes_of(joined) if note not in known)]


def scenario_of(
    state: SessionState,
    schedule: str | Path | None,
    steps: int | None,
    every: int | None = None,
    before: xr.Dataset | None = None,
) -> aw.Scenario:
    """The scenario of `simulate`.

    Args:
        state: the session's.   schedule: CSV file of DACOut over time, or of the drives' own commands without a controller;
            None: constant.   steps: number of time steps; None: until the schedule's last row.
        every: steps from one recorded row to the next; None: every step, or every sample of a controller.
        before: the run that is continued; None: a new one, from theta and omega.
    Raises:
        ArmwrightError: a file that is no schedule of this arm, times that do not fit, a step too large.
    """
    arm = state.arm
    if steps is None and schedule is None:
        raise SessionError("missing", place="simulate steps", expected="steps=…, the number of time steps")
    if state.controller is None:
        rows = None if schedule is None else aw.simulation.read_schedule(schedule, arm.names, joint_units(arm, "u"))
        asked = state.u if rows is None else at_dac_ticks(rows, state.dac_period)
    else:
        scale = np.array(state.controller.scale)
        rows = None if schedule is None else aw.simulation.read_schedule(schedule, arm.names, ["V"] * arm.n)
        asked = state.dac * scale if rows is None else Schedule(rows.times, rows.commands * scale, rows.names)
        steps = None if steps is None else _whole_samples(state, steps, "steps")
    if steps is None:
        assert rows is not None
        duration = _last_row(state, rows)
    else:
        duration = steps * state.step
    if every is not None and round(duration / state.step) % every:
        expected = f"a divisor of the {round(duration / state.step)} steps"
        raise SessionError(place="simulate every", value=every, expected=expected)
    rows_every = every or 1
    if every is not None and state.controller is not None:
        rows_every = _whole_samples(state, every, "every") // _substeps(state)
    start = start_of(state, before, state.step if state.controller is None else state.dac_period)
    # the schedule's times count from here
    if isinstance(asked, Schedule) and isinstance(start, aw.simulation.LoopState):
        asked = _delayed(asked, start.time)
    recording = aw.Recording(rows_every)
    if state.controller is None:
        solver = aw.Solver(step=state.step)
        return aw.Scenario(arm, duration, asked, start=start, solver=solver, recording=recording)
    loop = aw.Loop(built_controller(state, state.controller), asked, state.dac_period)
    solver = aw.Solver(substeps=_substeps(state))
    return aw.Scenario(arm, duration, loop=loop, start=start, solver=solver, recording=recording)


def _delayed(rows: Schedule, by: float) -> Schedule:
    """The schedule `by` seconds later; its first row holds until then."""
    if by == 0.0:
        return rows
    return Schedule(np.append(0.0, rows.times + by), np.vstack([rows.commands[:1], rows.commands]), rows.names)


def at_dac_ticks(rows: Schedule, period: float) -> Schedule:
    """The schedule at the output of a DAC: a row waits for the next tick; of several waiting rows the last one is used."""
    ticks = np.ceil(rows.times / period - WHOLE)
    if np.allclose(ticks * period, rows.times, rtol=1e-12, atol=0.0):
        return rows
    last = np.append(np.diff(ticks) > 0, True)
    return Schedule(ticks[last] * period, rows.commands[last], rows.names)


def _last_row(state: SessionState, rows: Schedule) -> float:
    """[s] until the schedule's last row, a whole number of steps, or of samples of a controller."""
    tick = state.step if state.controller is None else state.dac_period
    end = float(rows.times[-1])
    if end == 0.0:
        what = "the schedule's only row is at 0 s, which gives no end"
        raise SessionError(what, place="simulate steps", expected="steps=…")
    return float(np.ceil(end / tick - WHOLE)) * tick


def _substeps(state: SessionState) -> int:
    """Time steps in a DACSampTimePeriod."""
    ratio = state.dac_period / state.step
    if round(ratio) < 1 or abs(ratio - round(ratio)) > WHOLE * ratio:
        expected = f"a multiple of TimeStep, {state.step:g} s, while there is a controller"
        raise SessionError(place="DACSampTimePeriod", value=state.dac_period, expected=expected)
    return round(ratio)


def _whole_samples(state: SessionState, steps: int, name: str) -> int:
    substeps = _substeps(state)
    if steps % substeps:
        expected = f"a multiple of {substeps}, the steps of the controller's sample"
        raise SessionError(place=f"simulate {name}", value=steps, expected=expected)
    return steps


def _run(
    session: Workspace,
    state: SessionState,
    scenario: aw.Scenario,
    arguments: dict[str, Any],
    steps: int,
    before: xr.Dataset | None,
) -> tuple[xr.Dataset, int]:
    """The run and its number of time steps; on Ctrl-C the part of it that was done, where someone is there to see it.

    That part is run again, which gives the same bits, and recorded as a command of so many steps.
    """
    ticks_done = 0

    def progress(ticks: int, of: int) -> None:
        nonlocal ticks_done
        ticks_done = ticks
        if session.progress is not None:
            session.progress(ticks, of)

    try:
        return _in_terms_of_the_session(aw.simulate(scenario, progress=progress), state), steps
    except ScenarioError as error:
        raise error.renamed(lambda place: "TimeStep" if place == "step" else place, _without_rules) from None
    except KeyboardInterrupt:
        part = ticks_done * (1 if scenario.controller is None else scenario.substeps)
        part -= part % (arguments["every"] or 1)
        if session.ask is None or not 0 < part < steps:
            raise
    if session.show is not None:
        text = f"interrupted after {part} of {steps} steps; these are kept (Ctrl-C again: they are not)"
        session.show(TextLine(text, "note"))
    scenario = scenario_of(state, arguments["schedule"], part, arguments["every"], before)
    run = _in_terms_of_the_session(aw.simulate(scenario), state)
    run.attrs[PARTIAL] = f"interrupted after {part} of {steps} steps"
    words = {**{name: arguments[name] for name in ("start", "zero", "schedule", "every")}, "steps": part}
    words |= {"zero": "yes" if arguments["zero"] == "yes" else None}
    typed = [f"{name}={quoted(str(value))}" for name, value in words.items() if value is not None]
    session.recorded_line = " ".join(["simulate", *typed])
    return run, part


def _in_terms_of_the_session(run: xr.Dataset, state: SessionState) -> xr.Dataset:
    """The run with notes that name TimeStep, which the session always has, in place of a scenario's steps."""
    from armwright.simulation.fixed_steps import COARSE, OR_NONE
    from armwright.simulation.plant.recommended_step import written_step

    def named(note: str) -> str:
        if COARSE not in note:
            return note
        period = state.dac_period
        note = re.sub(r"substeps = (\d+)", lambda n: f"{written_step(period / int(n[1]), (period,)):g} s", note)
        return note.replace("a step of", "a TimeStep of").replace(OR_NONE, "")

    run.attrs["notes"] = "\n".join(map(named, notes_of(run)))
    return run


def _without_rules(text: str) -> str:
    """A sentence without the rules and substeps that a session does not let choose."""
    from armwright.simulation.plant.step_limits import OTHER_STEPS

    return re.sub(r", by substeps = \d+", "", text.replace(f"; or {OTHER_STEPS}", ""))


def check_continue(session: Workspace, arguments: dict[str, Any]) -> None:
    """Refuses to continue without a simulation.

    Raises:
        SessionError: there was none.
    """
    if arguments.get("start") == "continue" and session.state.run is None:
        raise SessionError("there is no simulation to continue", place="simulate continue", expected="simulate new")


def needs_run(command: str) -> Callable[[Workspace, dict[str, Any]], None]:
    """A check for a simulation, before the prompts of a command."""

    def check(session: Workspace, arguments: dict[str, Any]) -> None:
        last_run(session, command)

    return check


def last_run(session: Workspace, command: str) -> xr.Dataset:
    """The simulation of the session.

    Raises:
        SessionError: there was none.
    """
    if session.state.run is None:
        raise SessionError("there is no simulation yet", place=command, expected="simulate new first")
    return session.state.run


def write_graphic_file(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`write-graphic-file FILE`: the arm in motion, as a file that shows it."""
    run = last_run(session, "write-graphic-file")
    aw.animate(run, session.state.arm, arguments["file"])
    return [TextLine(f"wrote {arguments['file']}", "good")]


def save_run(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`save-simulation FILE`: the run as .nc, .csv, .parquet, .mcap or .mat."""
    run = last_run(session, "save-simulation")
    aw.save(run, arguments["file"])
    session.saved = run
    return [TextLine(f"wrote {arguments['file']}", "good")]


def start_of(state: SessionState, before: xr.Dataset | None, period: float) -> aw.Start | aw.simulation.LoopState:
    """Initial state of the scenario: theta and omega, or the end of the previous run.

    With another controller or another period only the plant and its commands continue.

    Args:
        state: the session's.   before: the run that is continued, if any.   period: [s] of a tick.
    """
    end = _end_of(state, before)
    if end is None or before is None:
        return aw.Start(state.q, state.qd)
    if end.period == period and before.attrs.get(CONTROLLER, "") == _attributes(state)[CONTROLLER]:
        return end
    plant = {name: values for name, values in end.blocks.items() if name in PLANT}
    # with another period ticks count from 0; `joined_runs` shifts the times
    tick = end.tick if end.period == period else 0
    return aw.simulation.LoopState(tick, period, end.single, end.entries, plant)


def _end_of(state: SessionState, before: xr.Dataset | None) -> aw.simulation.LoopState | None:
    """State of the loop at the end of a run; None if theta or omega was set since, or the run does not have it."""
    if before is None or not np.array_equal((before["q"].values[-1], before["qd"].values[-1]), (state.q, state.qd)):
        return None
    return aw.simulation.LoopState.of_run(before)


def _attributes(state: SessionState) -> dict[str, str]:
    """Attributes that distinguish a run's parts: controller ("" without one), gravity and payload."""
    controller, payload = "", state.loaded.payload
    if state.controller is not None:
        gains = " ".join(f"{name}={text}" for name, text in sorted(state.controller.gains.items()))
        controller = f"{state.controller.kind} {gains} every {state.dac_period!r} s"
    load = "none"
    if payload is not None:
        load = repr((payload.mass, payload.com, payload.inertia, payload.frame or state.arm.tip))
    gravity = f"{float(state.arm.gravity[2])!r} m/s²"
    return {CONTROLLER: controller, **dict(zip(WORLD, (gravity, load), strict=True))}


def joined_runs(state: SessionState, before: xr.Dataset, run: xr.Dataset) -> xr.Dataset:
    """A run and its continuation as one; at the common time the later run's row is used, with the commands that follow.

    Args:
        state: of the session, before the later run.   before, run: the two.
    """
    import xarray as xr

    met = float(before["time"][-1])
    shift = met - float(run["time"][0])
    later = run.assign_coords(time=("time", run["time"].values + shift, run["time"].attrs))
    parts = [part.drop_vars(LOOP_STATE, errors="ignore") for part in (before.isel(time=slice(None, -1)), later)]
    whole = xr.concat(
        parts, "time", data_vars="all", coords="minimal", compat="override", join="override", combine_attrs="override"
    ).transpose("time", "joint")
    if LOOP_STATE in run:
        whole[LOOP_STATE] = run[LOOP_STATE].assign_attrs({LOOP_END: float(whole["time"][-1])})
    shared = {
        name: value for name, value in before.attrs.items() if name not in OF_THE_LAST and value == run.attrs.get(name)
    }
    whole.attrs = shared | {name: run.attrs[name] for name in OF_THE_LAST if name in run.attrs}
    changed = [name for name in WORLD if before.attrs.get(name, run.attrs[name]) != run.attrs[name]]
    notes = []
    for part in (before, run):
        of_limits = limit_notes_of(state.arm, part)  # with times and shares of the part
        notes += [note for note in notes_of(part) if note not in of_limits]
    notes += limit_notes_of(state.arm, whole)
    notes += [f"{what} began anew at t = {met:g} s" for what in _begun_anew(state, before)]
    notes += [
        f"{name.removesuffix('_z')} was changed at t = {met:g} s, between two parts of the run" for name in changed
    ]
    if not all(np.array_equal(before[name].values[-1], run[name].values[0]) for name in ("q", "qd")):
        notes.append(f"theta or omega was set at t = {met:g} s, between two parts of the run")
    whole.attrs["notes"] = "\n".join(dict.fromkeys(notes))
    return whole


def _begun_anew(state: SessionState, before: xr.Dataset) -> list[str]:
    """States that do not continue, in words."""
    from armwright.simulation.plant.plant import Plant

    end, names = _end_of(state, before), []
    if end is None and Plant.of(state.arm).size > 2 * state.arm.n:
        names.append("what the drives remember besides theta and omega")
    controller = before.attrs.get(CONTROLLER)
    if state.controller is not None and controller and (end is None or controller != _attributes(state)[CONTROLLER]):
        names.append(f"the state of {state.controller.kind}")
    return names

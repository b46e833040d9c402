"""`simulate`: the scenario that the session's variables say, run, and joined to what it goes on from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import armwright as aw
from armwright.errors import ScenarioError, SessionError
from armwright.model.joint_signals import joint_units
from armwright.session.continued import (
    PARTIAL,
    WIRED,
    begun_anew,
    joined_runs,
    part_notes,
    start_of,
    wiring_told,
    world_told,
)
from armwright.session.listing import Line, Shown, by_joint
from armwright.session.state import State
from armwright.session.wiring import law
from armwright.simulation.inputs.schedule import Schedule

if TYPE_CHECKING:
    import xarray as xr

    from armwright.session.session import Session

WHOLE = 1e-9  # of a period: this near to a whole number of steps is one


def simulate(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`simulate`: new or continued, from zero or from theta and omega, by a schedule or with the voltage as it is."""
    state = session.state
    continued = given["start"] == "continue"
    if given["zero"] == "yes":
        zero = np.zeros(state.arm.n)
        state = state.replace(q=zero, qd=zero)
    before = state.run if continued else None
    scenario = scenario_of(state, given["schedule"], given["steps"], given["every"], before)
    steps = round(float(scenario.duration or 0.0) / state.step)
    try:
        run, steps = _run(session, state, scenario, given, steps, before)
    except ScenarioError as error:
        raise SessionError(str(error).replace("record_every", "every")) from error  # as it is called here
    run.attrs |= {WIRED: wiring_told(state), **world_told(state)}
    joined = run if before is None else joined_runs(before, run, begun_anew(state, before))
    session.state = after(state, joined, run)
    return _told(session.state, joined, steps, before)


def scenario_of(
    state: State,
    schedule: str | Path | None,
    steps: int | None,
    every: int | None = None,
    before: xr.Dataset | None = None,
) -> aw.Scenario:
    """What `simulate` runs, as Python has it.

    Args:
        state: the session's.   schedule: CSV file of DACOut over time, or of the drives' own commands where nothing listens
            to DACOut; None: it stays as it is.   steps: how many time steps; None: until the schedule's last row.
        every: rows are kept every so many steps; None: every step, or every sample of a controller.
        before: the run that it goes on from; None: a new one, from theta and omega.
    Raises:
        ArmwrightError: a file that is no schedule of this arm, times that do not fit, a step too large.
    """
    arm = state.arm
    if steps is None and schedule is None:
        raise SessionError("simulate: steps is missing: how many time steps; expected steps=…")
    if state.wiring is None:
        rows = None if schedule is None else aw.read_schedule(schedule, arm.names, joint_units(arm, "u"))
        drive: dict[str, Any] = {"command": state.u, "step": state.step}
        if rows is not None:
            drive = {"schedule": held(rows, state.dac_period), "step": state.step}
    else:
        scale = np.array(state.wiring.scale)
        rows = None if schedule is None else aw.read_schedule(schedule, arm.names, ["V"] * arm.n)
        asked = state.dac * scale if rows is None else Schedule(rows.times, rows.commands * scale, rows.names)
        drive = {
            "controller": law(state), "reference": asked, "sample_period": state.dac_period, "substeps": _substeps(state),
        }  # fmt: skip
        steps = None if steps is None else _whole_samples(state, steps, "steps")
    if steps is None:
        assert rows is not None
        duration = _last_row(state, rows)
    else:
        duration = steps * state.step
    _check_every(every, round(duration / state.step))
    rows_every = every or 1
    if every is not None and state.wiring is not None:
        rows_every = _whole_samples(state, every, "every") // _substeps(state)
    start = start_of(state, before, state.step if state.wiring is None else state.dac_period)
    if rows is not None and "start" in start:  # its times count from here
        key = "schedule" if state.wiring is None else "reference"
        drive[key] = _later(drive[key], start["start"].time)
    return aw.Scenario(arm, duration=duration, record_every=rows_every, **start, **drive)


def _later(rows: Schedule, by: float) -> Schedule:
    """The schedule `by` seconds later; its first row holds until then."""
    if by == 0.0:
        return rows
    return Schedule(np.append(0.0, rows.times + by), np.vstack([rows.commands[:1], rows.commands]), rows.names)


def _check_every(every: int | None, steps: int) -> None:
    if every is not None and steps % every:
        raise SessionError(f"simulate: every = {every} does not divide the {steps} steps; expected one that does")


def held(rows: Schedule, period: float) -> Schedule:
    """The schedule as a DAC gives it: a row is put out at the DAC's next tick, the last one of those that came before it."""
    ticks = np.ceil(rows.times / period - WHOLE)
    if np.allclose(ticks * period, rows.times, rtol=1e-12, atol=0.0):
        return rows
    last = np.append(np.diff(ticks) > 0, True)
    return Schedule(ticks[last] * period, rows.commands[last], rows.names)


def _last_row(state: State, rows: Schedule) -> float:
    """[s] until the schedule's last row, a whole number of steps, or of samples of a controller."""
    tick = state.step if state.wiring is None else state.dac_period
    end = float(rows.times[-1])
    if end == 0.0:
        raise SessionError(
            "simulate: the schedule's only row is at 0 s and does not say when to stop; expected steps=…"
        )
    return float(np.ceil(end / tick - WHOLE)) * tick


def _substeps(state: State) -> int:
    """Time steps in a DACSampTimePeriod."""
    ratio = state.dac_period / state.step
    if round(ratio) < 1 or abs(ratio - round(ratio)) > WHOLE * ratio:
        raise SessionError(
            f"DACSampTimePeriod = {state.dac_period:g} s is no whole number of time steps of {state.step:g} s; "
            "expected a multiple of TimeStep while a controller listens to DACOut"
        )
    return round(ratio)


def _whole_samples(state: State, steps: int, name: str) -> int:
    substeps = _substeps(state)
    if steps % substeps:
        raise SessionError(
            f"simulate: {name} = {steps} is no whole number of the controller's samples; expected a multiple of {substeps}"
        )
    return steps


def _run(
    session: Session, state: State, scenario: aw.Scenario, given: dict[str, Any], steps: int, before: xr.Dataset | None
) -> tuple[xr.Dataset, int]:
    """The run, and how many time steps it has; on Ctrl-C that part of it which was done, where someone is there to see it.

    What was done is run again, which gives the same bits, and recorded as a command of so many steps.
    """
    done = 0

    def progress(now: int, of: int) -> None:
        nonlocal done
        done = now
        if session.progress is not None:
            session.progress(now, of)

    try:
        return aw.simulate(scenario, progress=progress), steps
    except KeyboardInterrupt:
        part = done * (1 if scenario.controller is None else scenario.substeps)
        part -= part % (given["every"] or 1)
        if session.ask is None or not 0 < part < steps:
            raise
    if session.tell is not None:
        session.tell(
            Line(f"interrupted after {part} of {steps} steps; these are kept (Ctrl-C again: they are not)", "note")
        )
    run = aw.simulate(scenario_of(state, given["schedule"], part, given["every"], before))
    run.attrs[PARTIAL] = f"interrupted after {part} of {steps} steps"
    words = [f"start={given['start']}", *(["zero=yes"] if given["zero"] == "yes" else [])]
    words += [f'schedule="{given["schedule"]}"'] if given["schedule"] is not None else []
    words += [f"every={given['every']}"] if given["every"] is not None else []
    session.told_as(" ".join(["simulate", *words, f"steps={part}"]))
    return run, part


def after(state: State, joined: xr.Dataset, run: xr.Dataset) -> State:
    """The state at the end of a run: theta, omega, alpha, and what the drives are told."""
    last = {name: np.array(run[name].values[-1], dtype=float) for name in ("q", "qd", "qdd", "u") if name in run}
    return state.replace(**last, run=joined)


def _told(state: State, run: xr.Dataset, steps: int, before: xr.Dataset | None) -> list[Shown]:
    """What came of a simulation, with the notes that were not there before it."""
    arm, end = state.arm, float(run["time"][-1])
    word = f"partial: {run.attrs[PARTIAL]}; " if PARTIAL in run.attrs else ""
    shown: list[Shown] = [Line(f"{word}{steps} steps of {state.step * 1e3:g} ms, t = {end:g} s", "good")]
    columns = [(name, joint_units(arm, q), v) for name, q, v in (
        ("theta", "q", state.q), ("omega", "qd", state.qd), ("alpha", "qdd", state.qdd),
    )]  # fmt: skip
    shown.append(by_joint("", arm.names, columns))
    known = () if before is None else part_notes(before, 0.0)
    return [*shown, *(Line(note, "note") for note in str(run.attrs.get("notes", "")).splitlines() if note not in known)]


def check_before(session: Session, given: dict[str, Any]) -> None:
    """Refuses to continue what is not there.

    Raises:
        SessionError: there was no simulation.
    """
    if given.get("start") == "continue" and session.state.run is None:
        raise SessionError("simulate continue: there is no simulation to continue; expected simulate new")


def needs_run(command: str) -> Callable[[Session, dict[str, Any]], None]:
    """What a command of this name that shows a simulation asks for before its questions."""

    def ready(session: Session, given: dict[str, Any]) -> None:
        the_run(session, command)

    return ready


def the_run(session: Session, command: str) -> xr.Dataset:
    """The simulation of the session.

    Raises:
        SessionError: there was none.
    """
    if session.state.run is None:
        raise SessionError(f"{command}: there is no simulation yet; expected simulate new first")
    return session.state.run


def write_graphic_file(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`write-graphic-file FILE`: the arm in motion, as a file that shows it."""
    run = the_run(session, "write-graphic-file")
    aw.animate(run, session.state.arm, given["file"])
    return [Line(f"wrote {given['file']}", "good")]


def save_run(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`save-simulation FILE`: the run as .nc, .csv or .parquet."""
    aw.save(the_run(session, "save-simulation"), given["file"])
    return [Line(f"wrote {given['file']}", "good")]

"""`armwright simulate`: the motion of an arm for drive commands or a scenario file."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import typer

import armwright as aw
from armwright.cli.arguments import (
    SCENARIO,
    Allow,
    Command,
    Current,
    Duration,
    Position,
    RobotOrScenario,
    Schedule,
    Torque,
    Velocity,
    Voltage,
    commands_of,
    flag,
    naming_options,
    option,
    output_option,
    refuse_options,
    refuse_without_file,
    start_of,
)
from armwright.cli.outcome import TOML, check_file, naming_file, say_notes
from armwright.entry import as_motion
from armwright.errors import Interrupted, ScenarioError
from armwright.progress import progress
from armwright.terminal import console, gathering

if TYPE_CHECKING:
    import xarray as xr

    from armwright.simulation.scenario import Scenario


def simulate(
    robot: RobotOrScenario,
    schedule: Schedule = None,
    voltage: Voltage = None,
    current: Current = None,
    torque: Torque = None,
    command: Command = None,
    duration: Duration = None,
    accuracy: float | None = option("E", "How wrong the motion may be, in parts of its range; default 1e-3."),
    step: float | None = option("S", "A fixed step in s; by default steps are as long as the accuracy allows."),
    integrator: str | None = option(
        "NAME", "Rule: auto (default), rk3 (with a step), rk4, semi_implicit_euler, rk45, rodas3 or cvodes."
    ),
    q0: Position = None,
    qd0: Velocity = None,
    allow: Allow = None,
    reference: Path | None = option(
        "FILE", "Motion that a scenario's loop follows: .motion.toml, or .csv or .nc of `armwright plan`."
    ),
    record_every: int | None = option("K", "Record every K-th step, default 1; 0: only start and end."),
    record_period: float | None = option("S", "Time in s from row to row; default 1e-3 without a step."),
    output: Path | None = output_option("FILE", "Where the run goes: .nc (NetCDF), .csv, .parquet, .mcap or .mat."),
    plot: Path | None = option("FILE", "Draw it: .png, .svg, .pdf, or .html to zoom into."),
    log: Path | None = option("FILE.log.toml", "Describe the run of -o as a log for identify, or add it to one."),
    hold_out: bool = flag("--hold-out", "Of --log: the run is for the verdict, not for a fit."),
) -> None:
    """Simulate an arm: drive commands in, motion out; or run a scenario file.

    Commands come from a schedule, or are constant: one value for each joint, separated by commas, or one for all joints.
    Each is in its drive's own unit, as `armwright info` shows it. Without -o and --plot the state at the end is shown, of
    lanes its mean, least and most.

    A file that ends in .scenario.toml replaces these options: robot, controller, reference, timing, lanes. The files that
    it names must be in its folder or below, or in a folder given by --allow. With --reference its loop follows a motion
    file, or a motion written by `armwright plan`. With --log the run of -o becomes a log, as of a real arm.

    \b
    Examples:
      armwright simulate cmu-dd --voltage 8,12,8,4,2,1 --duration 2
      armwright simulate cmu-dd --voltage 5 --duration 1 --plot run.png
      armwright simulate cmu-dd --schedule volts.csv -o run.nc
      armwright simulate lwa4p --current 0 --start 0,30deg,0,0,0,0 --duration 1
      armwright simulate swing.scenario.toml -o run.nc
      armwright simulate swing.scenario.toml --allow ../robots -o run.nc
      armwright simulate arm.scenario.toml --reference pick.motion.toml --plot run.png
      armwright simulate excited.scenario.toml -o excited.csv --log arm.log.toml
    """
    if output is not None:
        from armwright.results.recording import check_recording

        check_recording(output)
    if plot is not None:
        from armwright.results.plot import check_plot

        check_plot(plot)
    _check_log(log, output, hold_out)
    constants = {"voltage": voltage, "current": current, "torque": torque, "command": command}
    if robot.endswith(SCENARIO):
        options = {**constants, "schedule": schedule, "duration": duration, "integrator": integrator, "step": step}
        others = {"start": q0, "start-velocity": qd0, "record-every": record_every, "record-period": record_period}
        refuse_options(robot, {**options, **others, "accuracy": accuracy})
        scenario = aw.read_scenario(robot, allow=allow or ())
        if reference is not None:
            scenario = following(scenario, reference, robot)
        if plot is not None and scenario.recording.what == "none":
            expected = "'all' or 'state', or no --plot, which draws rows"
            raise ScenarioError(place="recording.what", value="none", expected=expected, file=robot)
        with naming_file(robot):
            _run(scenario, output, plot, log, hold_out)
        return
    refuse_without_file(allow)
    if reference is not None:
        expected = "a scenario file, whose controller follows it"
        raise ScenarioError("without a controller", place="--reference", value=str(reference), expected=expected)
    arm = aw.load(robot)
    with naming_options():
        scenario = aw.Scenario(
            arm,
            duration=duration,
            command=commands_of(arm, schedule, constants),
            start=start_of(arm, q0, qd0),
            solver=aw.Solver(cast(Any, integrator or "auto"), step, accuracy=accuracy),
            recording=aw.Recording(record_every, period=record_period),
        )
        _run(scenario, output, plot, log, hold_out)


def _check_log(log: Path | None, output: Path | None, hold_out: bool) -> None:
    """Refuses --log without a file of rows, and --hold-out without --log.

    Raises:
        ScenarioError: names the option.
    """
    if hold_out and log is None:
        raise ScenarioError("goes with --log", place="--hold-out", expected="both")
    if log is None:
        return
    from armwright.identification.logs.write import ROWS

    check_file(log, TOML)
    if output is None or output.suffix.lower() not in ROWS:
        raise ScenarioError(place="--log", value=str(log), expected=f"-o FILE beside it, one of {', '.join(ROWS)}")


def following(scenario: Scenario, reference: Path, file: str) -> Scenario:
    """The scenario with a motion as the reference of its loop."""
    if scenario.loop is None:
        raise ScenarioError("without a loop", place="--reference", value=str(reference), expected="[loop]", file=file)
    motion = as_motion(reference, scenario.arm)
    return replace(scenario, loop=replace(scenario.loop, reference=motion))


def _run(
    scenario: Scenario, output: Path | None, plot: Path | None, log: Path | None = None, hold_out: bool = False
) -> None:

    stopped = False
    with progress(f"simulating {scenario.arm.name}", "steps") as tell:
        start = time.perf_counter()
        try:
            run = aw.simulate(scenario, progress=tell)
        except Interrupted as stop:  # what was finished is worth keeping
            run, stopped = stop.run, True
        spent = time.perf_counter() - start
        if output is not None:
            aw.save(run, output)
        if output is not None and log is not None and not stopped:
            aw.identification.write_log(run, output, log, scenario.arm, hold_out=hold_out)
        if plot is not None:
            aw.plot(run, plot)
    _show(scenario, run, spent, [path for path in (output, None if stopped else log, plot) if path is not None])
    if stopped:
        raise typer.Exit(130)


def _show(scenario: Scenario, run: xr.Dataset, spent: float, written: list[Path]) -> None:
    from armwright.cli.tables import end_state, lanes_that_stopped

    screen = console(soft_wrap=True)
    step, what = scenario.tick, "steps" if scenario.controller is None else "periods"
    lanes = "" if scenario.lane_count is None else f" in {run.sizes['lane']} lanes"
    stopped = lanes_that_stopped(run) if "lane" in run.dims else 0
    lanes += f", of which {stopped} diverged or ran out of steps" if stopped else ""
    end = float(run["time"][-1]) if "time" in run.coords else scenario.ticks * step
    extent = f"{round(end / step)} {what} of {step * 1e3:g} ms"
    if scenario.solver.rule == "auto":
        extent = f"{float(run['steps_tried'].mean()):.0f} steps" + (f" in {extent}" if scenario.sampled else "")
    screen.print(f"{scenario.arm.name}: {end:g} s in {extent}{lanes}, compiled and run in {spent:.2f} s")
    for path in written:
        screen.print(f"wrote {path}")
    if not written or gathering() is not None:
        screen.print(end_state(run) or "")
    say_notes(str(run.attrs.get("notes", "")).splitlines())

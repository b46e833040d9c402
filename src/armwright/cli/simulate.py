"""`armwright simulate`: voltages in, motion out."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armwright.cli.arguments import Robot, vector
from armwright.errors import DivergenceError, Interrupted, ScenarioError

if TYPE_CHECKING:
    import xarray as xr

    from armwright.model import Model
    from armwright.simulation.scenario import Scenario
    from armwright.simulation.scenario_parts import Start

SCENARIO = ".scenario.toml"
Numbers = str | None


def option(names: str, metavar: str, text: str) -> Any:
    """An option without a default that would be worth showing."""
    return typer.Option(*names.split(), metavar=metavar, help=text, show_default=False)


def simulate(
    robot: Robot,
    schedule: Annotated[
        Path | None, option("--schedule", "FILE", "CSV: t in s and one column a joint, held from row to row.")
    ] = None,
    voltage: Annotated[Numbers, option("--voltage", "V1,V2,…", "Constant voltages in V.")] = None,
    current: Annotated[Numbers, option("--current", "I1,I2,…", "Constant currents in A.")] = None,
    torque: Annotated[Numbers, option("--torque", "T1,T2,…", "Constant motor torques at the joints in N m.")] = None,
    command: Annotated[
        Numbers, option("--command", "U1,U2,…", "Constant commands, each in its own joint's unit.")
    ] = None,
    duration: Annotated[
        float | None, option("--duration", "S", "How long, in s; by default until the schedule's last row.")
    ] = None,
    step: Annotated[float | None, option("--step", "S", "Step of the integrator in s; default 1e-3.")] = None,
    integrator: Annotated[
        str | None, option("--integrator", "NAME", "rk3 (by default), rk4, semi_implicit_euler, rk45 or cvodes.")
    ] = None,
    q0: Annotated[
        Numbers, option("--q0", "Q1,Q2,…", "Where it starts, in rad (or 30deg, pi/2) or m; default 0.")
    ] = None,
    qd0: Annotated[Numbers, option("--qd0", "W1,W2,…", "How fast it starts, in rad/s or m/s; default 0.")] = None,
    record_every: Annotated[
        int | None,
        option("--record-every", "K", "Record every K-th step, default 1; 0: only start and end."),
    ] = None,
    output: Annotated[
        Path | None, option("--output -o", "FILE", "Where the run goes: .nc (NetCDF), .csv or .parquet.")
    ] = None,
    plot: Annotated[
        Path | None, option("--plot", "FILE", "Where its plot goes: .png, .svg, .pdf, or .html to zoom into.")
    ] = None,
) -> None:
    """Move an arm: drive commands in, motion out; or run a scenario file.

    Commands come from a schedule, or are constant: one value a joint with commas between, or one for all joints. Each
    is in its drive's own unit, as `armwright info` shows it. Without -o and --plot the state at the end is shown,
    of lanes its mean, least and most.

    A file that ends in .scenario.toml says all of it instead: robot, controller, reference, timing, lanes.

    \b
    Examples:
      armwright simulate cmu-dd --voltage 8,12,8,4,2,1 --duration 2
      armwright simulate cmu-dd --voltage 5 --duration 1 --plot run.png
      armwright simulate cmu-dd --schedule volts.csv -o run.nc
      armwright simulate lwa4p --current 0 --q0 0,30deg,0,0,0,0 --duration 1
      armwright simulate swing.scenario.toml -o run.nc
    """
    import armwright as aw
    from armwright.results.plot import check_plot
    from armwright.results.recording import check_recording

    if output is not None:
        check_recording(output)
    if plot is not None:
        check_plot(plot)
    constants = {"voltage": voltage, "current": current, "torque": torque, "command": command}
    if robot.endswith(SCENARIO):
        given = {**constants, "schedule": schedule, "duration": duration, "integrator": integrator}
        given |= {"q0": q0, "qd0": qd0, "step": step, "record-every": record_every}
        for name, value in given.items():
            if value is not None:
                raise ScenarioError(f"{robot}: --{name}, but a scenario file says all of it; expected one or the other")
        scenario = aw.read_scenario(robot)
        if plot is not None and scenario.recording.what == "none":
            raise ScenarioError(
                f"{robot}: --plot draws rows, and [recording] what = 'none' keeps none; expected 'all' or 'state', or no --plot"
            )
        try:
            _run(scenario, output, plot)
        except (ScenarioError, DivergenceError) as error:  # of the run, which does not know the file
            raise type(error)(f"{robot}: {error}") from None
        return
    arm = aw.load(robot)
    scenario = aw.Scenario(
        arm,
        duration=duration,
        command=commands_of(arm, schedule, constants),
        start=start_of(arm, q0, qd0),
        solver=aw.Solver(integrator or "rk3", step),
        recording=aw.Recording(1 if record_every is None else record_every),
    )
    _run(scenario, output, plot)


def _run(scenario: Scenario, output: Path | None, plot: Path | None) -> None:
    import armwright as aw
    from armwright.cli.progress import progress

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
        if plot is not None:
            aw.plot(run, plot)
    _show(scenario, run, spent, [path for path in (output, plot) if path is not None])
    if stopped:
        raise typer.Exit(130)


def start_of(arm: Model, q0: str | None, qd0: str | None) -> Start:
    """Initial positions and speeds from the options --q0 and --qd0."""
    import armwright as aw
    from armwright.model.joint_signals import joint_units

    return aw.Start(
        None if q0 is None else vector("--q0", q0, arm.names, joint_units(arm, "q")),
        None if qd0 is None else vector("--qd0", qd0, arm.names, joint_units(arm, "qd")),
    )


def commands_of(arm: Model, schedule: Path | None, constants: dict[str, str | None]) -> Any:
    """The one way in which the arm is driven, as `Scenario` takes it.

    Raises:
        ScenarioError: none, or more than one, or one that the arm's drives do not take.
    """
    import armwright as aw
    from armwright.model.joint_signals import joint_units

    units = joint_units(arm, "u")
    given = [f"--{name}" for name, text in constants.items() if text is not None] + ["--schedule"] * (
        schedule is not None
    )
    kinds = list(dict.fromkeys(body.drive.command for body in arm.coordinates))
    own = f"--{kinds[0]}" if len(kinds) == 1 else "--command"
    if len(given) != 1:
        what = " and ".join(given) if given else "no command"
        raise ScenarioError(f"{arm.name}: {what} given; expected one of --schedule FILE and {own} {','.join(units)}")
    if schedule is not None:
        return aw.read_schedule(schedule, arm.names, units)
    name, text = next((name, text) for name, text in constants.items() if text is not None)
    for body in arm.coordinates:
        if name not in ("command", body.drive.command):
            raise ScenarioError(
                f"{arm.name}: --{name}, but joint {body.joint!r} is driven by {body.drive.command}; expected {own}"
            )
    return vector(f"--{name}", text, arm.names, units)


def _show(scenario: Scenario, run: xr.Dataset, spent: float, written: list[Path]) -> None:
    from rich.console import Console

    from armwright.cli.tables import end_state, lanes_that_stopped

    console = Console(highlight=False, markup=False, soft_wrap=True)
    step, what = scenario.tick, "steps" if scenario.controller is None else "periods"
    lanes = "" if scenario.lane_count is None else f" in {run.sizes['lane']} lanes"
    stopped = lanes_that_stopped(run) if "lane" in run.dims else 0
    lanes += f", of which {stopped} left the finite numbers or ran out of steps" if stopped else ""
    end = float(run["time"][-1]) if "time" in run.coords else scenario.ticks * step
    console.print(
        f"{scenario.arm.name}: {end:g} s in {round(end / step)} {what} of {step * 1e3:g} ms{lanes}, "
        f"compiled and run in {spent:.2f} s"
    )
    for path in written:
        console.print(f"wrote {path}")
    if not written:
        console.print(end_state(run) or "")
    for note in str(run.attrs.get("notes", "")).splitlines():
        print(f"armwright: note: {note}", file=sys.stderr)

"""`armwright step-study`: the largest integration step that is accurate enough."""

from __future__ import annotations

import time
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING, Annotated

import typer

from armwright.cli.arguments import (
    SCENARIO,
    Allow,
    Command,
    Current,
    Duration,
    Position,
    Robot,
    Schedule,
    Torque,
    Velocity,
    Voltage,
    commands_of,
    naming_options,
    option,
    refuse_allow,
    refuse_options,
    start_of,
)
from armwright.errors import ScenarioError
from armwright.terminal import result

if TYPE_CHECKING:
    from armwright.simulation.step_study import StepStudy, Trial


def step_study(
    robot: Robot,
    schedule: Schedule = None,
    voltage: Voltage = None,
    current: Current = None,
    torque: Torque = None,
    command: Command = None,
    duration: Duration = None,
    step: Annotated[
        float | None,
        option("--step", "S", "The step in s around which steps are tried, from 4 times it down; by default 0.001."),
    ] = None,
    steps: Annotated[
        int, typer.Option("--steps", metavar="K", help="How many steps are tried, each half of the last.")
    ] = 8,
    integrator: Annotated[
        str | None, option("--integrator", "NAME", "rk3 (by default), rk4 or semi_implicit_euler.")
    ] = None,
    accuracy: Annotated[
        str,
        typer.Option("--accuracy", metavar="E1,E2,…", help="Errors to recommend for, in rad and rad/s (m and m/s)."),
    ] = "1e-3,1e-6,1e-9",
    q0: Position = None,
    qd0: Velocity = None,
    allow: Allow = None,
) -> None:
    """Find the largest integration step that is accurate enough, against CVODES.

    Commands are given as for `armwright simulate`; a file that ends in .scenario.toml replaces them, and may name files in
    its folder or below, or in a folder given by --allow. Its controller keeps its sample period, and substeps are tried.
    Errors are the largest over time, joints and lanes.

    \b
    Examples:
      armwright step-study cmu-dd --voltage 8,12,8,4,2,1 --duration 1
      armwright step-study puma560 --voltage 5 --duration 0.5 --integrator rk4 --accuracy 1e-6
      armwright step-study swing.scenario.toml
    """
    import armwright as aw
    from armwright.cli.progress import progress

    constants = {"voltage": voltage, "current": current, "torque": torque, "command": command}
    if robot.endswith(SCENARIO):
        options = {**constants, "schedule": schedule, "duration": duration, "step": step}
        refuse_options(robot, {**options, "q0": q0, "qd0": qd0})
        scenario = aw.read_scenario(robot, allow=allow or ())
        if integrator is not None:
            with naming_options("solver.integrator"):
                solver = aw.Solver(integrator, scenario.solver.step, scenario.solver.substeps)
            scenario = replace(scenario, solver=solver)
    else:
        refuse_allow(allow)
        arm = aw.load(robot)
        with naming_options():
            scenario = aw.Scenario(
                arm,
                duration=duration,
                command=commands_of(arm, schedule, constants),
                start=start_of(arm, q0, qd0),
                solver=aw.Solver(integrator or "auto", step),
            )
    named = ("solver.integrator", "accuracies", "steps") if robot.endswith(SCENARIO) else ()
    with naming_options(*named), progress(f"trying steps for {scenario.arm.name}"):
        start = time.perf_counter()
        study = aw.simulation.step_study(scenario, steps=steps, accuracies=_accuracies(accuracy))
        spent = time.perf_counter() - start
    _show(study, spent)


def _accuracies(text: str) -> list[float]:
    """Numbers with commas between.

    Raises:
        ScenarioError: something that is no number.
    """
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        expected = "numbers with commas between, such as 1e-3,1e-6"
        raise ScenarioError(place="--accuracy", value=text, expected=expected) from None


def _show(study: StepStudy, spent: float) -> None:
    from armwright.cli.tables import console_for_tables, table

    result(study)
    console = console_for_tables()
    title = f"{study.name}: {study.integrator} (order {study.order}) against {study.reference}, in {spent:.1f} s"
    heads = ["step [ms]", "error in q [rad | m]", "error in qd [rad/s | m/s]", "order seen", "evaluations a second"]
    parted = any(isfinite(trial.counts_differ_at) for trial in study.trials)
    taken = [trial for trial in study.trials if not trial.refused]
    refused = [trial for trial in study.trials if trial.refused]
    autos = [trial for trial in (study.auto, *study.by_auto.values()) if not trial.refused]
    rows = [_row(trial, parted) for trial in (*taken, *autos)]
    if refused:
        span = dict.fromkeys(f"{1e3 * trial.step:.4g}" for trial in (refused[0], refused[-1]))
        rows = [[" to ".join(span), "too large", "", "", "", *([""] if parted else [])], *rows]
    console.print(table(title, [*heads, *(["other counts from [s]"] if parted else [])], rows))
    if refused:
        console.print(str(refused[-1].refused))
    if parted:
        console.print(
            f"Where a count is another one than by {study.reference}, as the smallest error makes it, rows behind are not "
            "compared."
        )
    if study.floor > 0.0 and study.floor > 0.25 * min(trial.error for trial in study.trials):
        console.print(f"The reference, {study.reference}, is itself wrong by some {study.floor:.0e}.")
    for accuracy in study.recommended:
        console.print(f"for an accuracy of {accuracy:g}: {_advice(study, accuracy)}")


def _row(trial: Trial, parted: bool) -> list[str]:
    """Cells of a step that was tried."""
    from armwright.cli.tables import number
    from armwright.simulation.integrate.stepping import ACCURACY

    step = f"{1e3 * trial.step:.4g}"
    if trial.accuracy is not None:
        accuracy = "" if trial.accuracy == ACCURACY else f" for {trial.accuracy:g}"
        step = f"auto{accuracy}, {trial.rule}, {1e3 * trial.step:.3g} on average"
    errors = (f"{trial.error_q:.1e}", f"{trial.error_qd:.1e}")
    cells = [step, *errors, number(round(trial.order, 2)), f"{trial.evaluations:,.0f}"]
    return [*cells, *([number(trial.counts_differ_at)] if parted else [])]


def _advice(study: StepStudy, accuracy: float) -> str:
    """The setting that keeps an accuracy."""
    trial = study.recommended[accuracy]
    if trial is not None:
        substeps = f" ({trial.substeps} substeps)" if trial.substeps > 1 else ""
        return f"a step of {1e3 * trial.step:.4g} ms{substeps}"
    none = "no step that was tried"
    if study.auto.error <= accuracy:
        return f"{none}; auto keeps it, with no step given"
    auto = study.by_auto.get(accuracy)
    if auto is None or auto.refused:
        return none
    return f"{none}; auto with an accuracy of {auto.accuracy:g} is wrong by {auto.error:.0e}"

"""`armwright step-study`: the largest integration step that is accurate enough."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

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
    naming_options,
    numbers,
    option,
    refuse_options,
    refuse_without_file,
    start_of,
)
from armwright.cli.outcome import exit_if, until_stopped
from armwright.progress import progress


def step_study(
    robot: RobotOrScenario,
    schedule: Schedule = None,
    voltage: Voltage = None,
    current: Current = None,
    torque: Torque = None,
    command: Command = None,
    duration: Duration = None,
    step: float | None = option(
        "S", "The step in s around which steps are tried, from 4 times it down; by default 0.001."
    ),
    steps: int = option(
        "K", "How many steps are tried, each half of the last.", 8, names="--step-count", show_default=True
    ),
    integrator: str | None = option("NAME", "Rule: rk3 (default), rk4 or semi_implicit_euler."),
    accuracy: str = option(
        "E1,E2,…",
        "Errors to recommend for, in rad and rad/s (m and m/s).",
        "1e-3,1e-6,1e-9",
        names="--accuracies",
        show_default=True,
    ),
    q0: Position = None,
    qd0: Velocity = None,
    allow: Allow = None,
) -> None:
    """Find the largest integration step that is accurate enough, against CVODES.

    Commands are given as for `armwright simulate`; a file that ends in .scenario.toml replaces them, and may name files in
    its folder or below, or in a folder given by --allow. Its controller keeps its sample period, and substeps are tried.
    Errors are the largest over time, joints and lanes. After Ctrl-C (exit code 130) the steps until then are shown.

    \b
    Examples:
      armwright step-study cmu-dd --voltage 8,12,8,4,2,1 --duration 1
      armwright step-study puma560 --voltage 5 --duration 0.5 --integrator rk4 --accuracies 1e-6
      armwright step-study swing.scenario.toml
    """
    from armwright.cli.tables import show

    accuracies: Any = numbers("--accuracies", accuracy, "numbers with commas between, such as 1e-3,1e-6")
    constants = {"voltage": voltage, "current": current, "torque": torque, "command": command}
    if robot.endswith(SCENARIO):
        options = {**constants, "schedule": schedule, "duration": duration, "step": step}
        refuse_options(robot, {**options, "start": q0, "start-velocity": qd0})
        scenario = aw.read_scenario(robot, allow=allow or ())
        if integrator is not None:
            with naming_options("solver.integrator"):
                solver = aw.Solver(cast(Any, integrator), scenario.solver.step, scenario.solver.substeps)
            scenario = replace(scenario, solver=solver)
    else:
        refuse_without_file(allow)
        arm = aw.load(robot)
        with naming_options():
            scenario = aw.Scenario(
                arm,
                duration=duration,
                command=commands_of(arm, schedule, constants),
                start=start_of(arm, q0, qd0),
                solver=aw.Solver(cast(Any, integrator or "auto"), step),
            )
    named = ("solver.integrator", "accuracies", "steps") if robot.endswith(SCENARIO) else ()
    with naming_options(*named), progress(f"trying steps for {scenario.arm.name}") as tell:
        study, stopped = until_stopped(
            lambda: aw.simulation.step_study(scenario, steps=steps, accuracies=accuracies, progress=tell)
        )
    show(study)
    exit_if(stopped)

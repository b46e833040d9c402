"""`armwright validate`: a robot file compared with a log, and a verdict."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from armwright.cli.arguments import SCENARIO, Allow, argument, as_options, flag, option, refuse_without_file
from armwright.cli.outcome import PAGE, check_file, exit_unless, write
from armwright.cli.tables import show
from armwright.progress import progress
from armwright.terminal import say

FAILS = 1  # the exit code where the record does not keep its limits


def validate(
    robot: str = argument(
        "ROBOT|SCENARIO", "Path of a robot's file, name of a built-in arm, or path of a .scenario.toml."
    ),
    log: Path = argument("FILE.log.toml", "The log to compare with."),
    limits: Path | None = option(
        "LIMITS.toml", "What has to be reached; by default R² ≥ 0.9 of torques, or a fit of 70 %."
    ),
    run: list[str] | None = option(
        "NAME", "A run to judge, may be repeated; by default those marked hold-out, else all."
    ),
    window: float | None = option(
        "S", "Time in s after which a free simulation starts again from the log; default 0.5."
    ),
    cutoff: float | None = option("HZ", "Cut-off of the low-pass; by default that of the record's fit."),
    no_simulation: bool = flag("--no-simulation", "Predict torques only."),
    report: Path | None = option("FILE.html", "Write a page with plots, which needs no network."),
    allow: Allow = None,
) -> None:
    """Compare a robot file with a log: torque prediction, free simulation, and a verdict.

    It judges the runs that the log marks use = "hold-out"; without any it judges all runs, and says so. The verdict is
    stored beside the record, as ARM.verdict.toml, with the checksums of record and log. Exit code: 0 passes, 1 fails its
    limits, 2 input that cannot be used.

    \b
    Examples:
      armwright validate arm.toml arm.log.toml
      armwright validate arm.toml arm.log.toml --limits limits.toml --report report.html
      armwright validate swing.scenario.toml arm.log.toml
    """
    from armwright.identification.validation.verdict import check_verdict, write_verdict

    check_file(report, PAGE)
    if robot.endswith(SCENARIO):
        subject, record = aw.read_scenario(robot, allow=allow or ()), robot
    else:
        refuse_without_file(allow)
        subject, record = robot, None
    check_verdict(record or robot)
    with as_options("window", "run", "cutoff"), progress(f"comparing {robot} with {log.name}") as tell:
        found = aw.identification.validate(
            subject,
            log,
            limits=limits,
            runs=run,
            window=window,
            cutoff=cutoff,
            simulation=not no_simulation,
            record=record,
            progress=tell,
        )
    show(found)
    if found.record is not None:
        say(f"wrote {write_verdict(found)}")
    write(report, found.report)
    exit_unless(found.passed)

"""`armwright shadow`: a model run beside its arm, over a log or on the bus of the drives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import armwright as aw
from armwright.cli.arguments import (
    argument,
    as_options,
    flag,
    node_numbers,
    numbers,
    only,
    option,
    output_option,
    refuse,
    robot_argument,
)
from armwright.cli.outcome import PAGE, check_file, exit_unless, write
from armwright.cli.tables import show
from armwright.errors import ScenarioError
from armwright.progress import progress

INTERFACES = ("virtual", "socketcan", "udp_multicast")  # before the colon of a bus


def shadow(
    robots: list[str] | None = robot_argument(
        "Path of the arm's record, or name of a built-in arm; by default the robot that the log names.", None
    ),
    source: str = argument(
        "LOG|BUS", "The arm's log, FILE.log.toml; or the bus of its drives, such as socketcan:can0."
    ),
    run: list[str] | None = option("NAME", "A run, may be repeated; by default all."),
    deviation: str | None = option(
        "D1,D2,…", "Standard deviations of the residual torques; by default of the verdict."
    ),
    factor: float | None = option("K", "Deviations that a residual may reach; default 8."),
    report: Path | None = option("FILE.html", "Write a page with plots, which needs no network."),
    live: bool = flag("--live", "Show the residuals live, at the pace of the log."),
    duration: float | None = option("S", "Duration in s of listening to a bus; by default until it is silent."),
    output: Path | None = output_option(
        "FILE", "Where rows and residuals of a bus go: .nc, .csv, .parquet, .mcap or .mat."
    ),
    nodes: str | None = option("N1,N2,…", "Node numbers of the joints on a bus; default from 3."),
    counts: float | None = option(
        "N", "Counts in a turn of a joint on a bus; default 360,000.", names="--counts-per-turn"
    ),
    period: float | None = option("S", "Period in s from SYNC to SYNC of a bus; by default by the clock."),
) -> None:
    """Run a model beside its arm, with alarms for contacts and wrong payloads.

    Limits of the alarms come from the record's verdict (see `armwright validate`), else from the fit or the standard
    deviations in the record. No row depends on a later one, so alarms come as early as beside the real arm. On a bus it
    only listens, and sends nothing. Its drives answer each SYNC with statusword, actual torque and position, as those of an
    LWA 4P or of `armwright twin`. Values that cannot be are reported and bridged. Exit code: 0 no alarm, with every joint
    judged practically all the time and the model never far from the arm; 1 otherwise; 2 input that cannot be used.

    \b
    Examples:
      armwright shadow arm.toml today.log.toml
      armwright shadow arm.toml today.log.toml --report shadow.html
      armwright shadow arm.toml today.log.toml --run pick --live
      armwright shadow lwa4p today.log.toml --deviation 2,2,2,2,1,1
      armwright shadow arm.toml socketcan:can0 --duration 60 -o bus.mcap
    """
    from armwright.shadow.alarms import FACTOR

    robot = only(robots)
    factor = FACTOR if factor is None else factor
    deviations: Any = numbers("--deviation", deviation, "numbers with commas between, one for each joint, or one")
    if deviations is not None and len(deviations) == 1:
        deviations = deviations[0]
    of_bus = {"output": output, "duration": duration, "nodes": nodes, "counts-per-turn": counts, "period": period}
    if source.partition(":")[0] in INTERFACES:
        from armwright.cli.shadow_live import listen

        of_log = {"run": run, "report": report, "live": live or None}
        refuse(of_log, "does not go with it", expected="a log", file=source)
        if robot is None:
            raise ScenarioError("missing", place="ROBOT", expected="the arm whose drives are on the bus")
        with as_options("deviation", "factor", "period", "nodes", counts="--counts-per-turn"):
            of_nodes = node_numbers(nodes, ScenarioError)
            clean = listen(robot, source, deviations, factor, duration, of_nodes, counts, period, output)
        exit_unless(clean)
        return
    refuse(of_bus, "does not go with it", expected="a bus, such as socketcan:can0", file=source)
    check_file(report, PAGE)
    log = Path(source)
    with progress(f"reading {log.name}"):
        read = aw.identification.read_log(log)
    with as_options("run", "deviation", "factor", arm="ROBOT"), progress(f"beside {log.name}", "rows") as tell:
        found = aw.shadow.shadow_log(read, robot, runs=run, deviation=deviations, factor=factor, progress=tell)
    if live:
        from armwright.cli.shadow_live import replay

        replay(found)
    show(found)
    write(report, found.report)
    exit_unless(found.verdict.clean)

"""`armwright identify payload`: a payload's mass, centre and inertia from logs."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from armwright.cli.arguments import argument, option, output_option, robot_argument
from armwright.cli.outcome import PAGE, TOML, check_file, exit_if, exit_unless, until_stopped, write
from armwright.cli.tables import show
from armwright.progress import progress


def payload(
    robot: str = robot_argument("The arm without the payload."),
    file: Path = argument("LOG.log.toml", "Log of the arm moving its payload."),
    loaded: Path | None = option(
        "LOG",
        "Log of the arm with the payload; LOG.log.toml is then without it, and of ROBOT only the kinematics are used.",
        names="--loaded-log",
    ),
    frame: str | None = option("NAME", "Frame that carries the payload; by default the tip."),
    cutoff: float | None = option("HZ", "Cut-off of the low-pass for the log; by default chosen from the log."),
    output: Path | None = output_option(
        "ARM.toml", "Write the arm with the payload, its numbers with their deviations."
    ),
    report: Path | None = option("FILE.html", "Write a page: verdict, remarks, parameters, fits."),
) -> None:
    """Identify a payload: mass, centre of mass and inertia, with standard deviations.

    It needs one log of an arm with a correct record, or two logs, without and with the payload, of an arm with known
    kinematics. Exit code: 0 identified, 1 the log does not determine the mass, 2 bad input,
    130 Ctrl-C: the best of the cut-offs that were tried is kept.

    \b
    Examples:
      armwright identify payload lwa4p loaded.log.toml
      armwright identify payload lwa4p empty.log.toml --loaded-log loaded.log.toml -o carrying.toml
    """
    from armwright.identification.arm.payload import with_identified_payload

    check_file(output, TOML, (file, loaded, robot))
    check_file(report, PAGE)
    arm = aw.load(robot)
    logs = [aw.identification.read_log(each) for each in (file, loaded) if each is not None]
    preparation = None if cutoff is None else aw.identification.choose_preparation(logs[0], cutoff=cutoff)
    with progress("fitting a payload") as tell:
        found, stopped = until_stopped(
            lambda: aw.identification.identify_payload(
                logs[0], arm, loaded_log=logs[1] if len(logs) > 1 else None, frame=frame, preparation=preparation,
                progress=tell,
            )
        )  # fmt: skip
    show(found)
    write(report, lambda path: found.report(path, f"{logs[0].title}: payload"))
    if found.verdict == "identified":
        write(
            output,
            lambda path: aw.identification.write_into(
                with_identified_payload(arm, found, frame), found, path, key="payload"
            ),
        )
    exit_if(stopped)
    exit_unless(found.verdict == "identified")

"""`armwright identify friction`: friction of an arm's joints from a log."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from armwright.cli.arguments import argument, flag, named_numbers, option, output_option, robot_argument, words
from armwright.cli.outcome import PAGE, TOML, check_file, exit_if, exit_unless, until_stopped, write
from armwright.cli.tables import show
from armwright.errors import IdentificationError, check_known
from armwright.progress import progress

HEADS = ("joint", "velocity [rad/s | m/s]", "friction [N m | N]", "± std", "rows")


def friction(
    robot: str = robot_argument("The arm; the friction in its file is not used."),
    file: Path = argument("LOG.log.toml", "Log of the arm in motion, each joint in both directions."),
    cutoff: float | None = option("HZ", "Cut-off of the low-pass for the log; by default chosen from the log."),
    warming: str = option(
        "RUN=K,…",
        "How much warmer than the reference temperature the gears were in each run, in K; replaces the log's temperatures.",
        "",
    ),
    table: bool = flag("--table", "Show friction over speed as well."),
    output: Path | None = output_option(
        "ARM.toml", "Write the arm with this friction, its numbers with standard deviations."
    ),
    report: Path | None = option("FILE.html", "Write a page: verdict, remarks, parameters, fits."),
) -> None:
    """Identify joint friction: viscous, Coulomb, and further terms that held-out data support.

    Candidates are Stribeck's fall, load-proportional friction, the sigmoid law, a spring and a counterbalance, and slopes
    over temperature if the log or --warming states temperatures; a candidate is kept only if it lowers the held-out error
    by 1 %. Exit code: 0 identified, 1 friction does not explain the torques, or predicts runs held out worse than the record
    that came in, 2 bad input, 130 Ctrl-C: the joints that were fitted until then are kept.

    \b
    Examples:
      armwright identify friction lwa4p arm.log.toml --table
      armwright identify friction arm.toml arm.log.toml -o arm_with_friction.toml
    """
    from armwright.cli.tables import console_for_tables, number, table as shown_table
    from armwright.identification.arm.friction import friction_over_speed, friction_rows, with_identified_friction

    check_file(output, TOML, (file, robot))
    check_file(report, PAGE)
    arm, log = aw.load(robot), aw.identification.read_log(file)
    preparation = None if cutoff is None else aw.identification.choose_preparation(log, cutoff=cutoff)
    warm = _warming(warming, [run.name for run in log.runs])
    with progress("fitting friction") as tell:
        found, stopped = until_stopped(
            lambda: aw.identification.identify_friction(log, arm, preparation=preparation, warming=warm, progress=tell)
        )
    if table:
        rows = [
            [body.joint, *map(number, line)]
            for body, moved in zip(arm.coordinates, friction_rows(log, arm, preparation, warm), strict=True)
            for line in friction_over_speed(moved).tolist()
        ]
        console_for_tables().print(shown_table("Friction over velocity", HEADS, rows, HEADS[:1]))
    show(found)
    write(
        output,
        lambda path: aw.identification.write_into(with_identified_friction(arm, found), found, path, key="friction"),
    )
    write(report, lambda path: found.report(path, f"{log.title}: friction"))
    exit_if(stopped)
    exit_unless(found.verdict == "identified")


def _warming(text: str, runs: list[str]) -> dict[str, float] | None:
    """Kelvin by run of "cold=0,warm=25"; None of an empty text."""
    found = named_numbers("--warming", words(text), "RUN=K with K a number [K]", IdentificationError)
    for run in found:
        check_known(IdentificationError, run, runs, "no such run", place="--warming")
    return found or None

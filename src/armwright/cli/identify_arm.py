"""`armwright identify arm`: masses, rotors and friction of an arm from a log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from armwright.cli.arguments import option
from armwright.cli.tables import show
from armwright.terminal import say

NOT_IDENTIFIED = 1  # exit code


def arm(
    file: Annotated[Path, typer.Argument(metavar="LOG.log.toml", help="Positions and torques.", show_default=False)],
    robot: Annotated[str | None, option("--robot", "ROBOT", "The arm; by default the one that the log names.")] = None,
    kinematics_only: Annotated[
        bool, typer.Option("--kinematics-only", help="The robot's links may lack masses.", show_default=False)
    ] = False,
    method: Annotated[
        str,
        option(
            "--method", "NAME", "ols, wls (default), irls, tukey, essential, recursive; of the loop iv, didim or cloe."
        ),
    ] = "wls",
    feedback: Annotated[
        str,
        option(
            "--feedback",
            "KP1,…;KD1,…;S",
            "Controller for iv, didim, cloe: gains at the joints [N m/rad] and [N m s/rad], period [s].",
        ),
    ] = "",
    forgetting: Annotated[
        float, option("--forgetting", "SHARE", "What a row still counts one row later, of recursive.")
    ] = 1.0,
    friction: Annotated[
        str, option("--friction", "A,B,…", "Of viscous, coulomb, offset, asymmetric, stribeck.")
    ] = "viscous,coulomb,offset",
    stribeck_speed: Annotated[
        float | None, option("--stribeck-speed", "W", "Of stribeck, in rad/s or m/s at the joint.")
    ] = None,
    springs: Annotated[
        str, option("--springs", "J1,J2,…", "Joints that get a spring and a counterbalance as candidates.")
    ] = "",
    fit_efficiency: Annotated[
        str,
        option(
            "--fit-efficiency",
            "J1,J2,…|all",
            "Joints whose gear efficiency is fitted; other joints have the record's.",
        ),
    ] = "",
    lacks: Annotated[
        str | None,
        option("--lacks", "A,B,…", "What the torque is without: gravity, springs, rotors, viscous, coulomb, offset."),
    ] = None,
    cutoff: Annotated[float | None, option("--cutoff", "HZ", "Cut-off of the low-pass; by default chosen.")] = None,
    decimate: Annotated[int | None, option("--decimate", "K", "Keep every k-th row; by default chosen.")] = None,
    output: Annotated[Path | None, option("--output -o", "ARM.toml", "Write the arm with the fitted numbers.")] = None,
    report: Annotated[
        Path | None,
        option("--report", "FILE.html", "Write a page; with -o it also compares the written arm with the log."),
    ] = None,
) -> None:
    """Identify an arm: base parameters, rotors and friction, with standard deviations.

    The robot may be a full record or kinematics alone. Runs that the log holds out judge the record, beside the one that
    it replaces. Exit code: 0 identified, 1 the log does not determine all parameters or the record predicts worse than
    before, 2 bad input.

    \b
    Examples:
      armwright identify arm arm.log.toml --robot arm.urdf --kinematics-only -o arm_identified.toml
      armwright identify arm arm.log.toml --robot lwa4p --method irls --friction viscous,asymmetric
      armwright identify arm arm.log.toml --robot arm.toml --fit-efficiency shoulder,elbow -o arm_identified.toml
      armwright identify arm arm.log.toml --robot two-link --method iv --feedback "900,300;120,40;0.005"
    """
    import armwright as aw
    from armwright.cli.progress import progress
    from armwright.output import check_destination

    if output is not None:
        check_destination(output, (".toml",), read=(file, robot))
    if report is not None:
        check_destination(report, (".html",))
    model = None if robot is None else aw.load(robot, kinematics_only=kinematics_only)
    with progress(f"reading {file.name}") as tell:
        log = aw.identification.read_log(file, progress=tell)
    terms = aw.identification.ArmTerms(
        _words(springs), stribeck_speed, None if lacks is None else _words(lacks),
        "all" if fit_efficiency == "all" else _words(fit_efficiency),
    )  # fmt: skip
    rows = aw.identification.FitRows(cutoff=cutoff, decimate=decimate)
    found = aw.identification.identify_arm(
        log, model, method=method, friction=_words(friction), terms=terms, rows=rows, feedback=_feedback(feedback),
        forgetting=forgetting,
    )  # fmt: skip
    show(found)
    if output is not None:
        found.write(output)
        say(f"wrote {output}")
    if report is not None:
        compared = None if output is None else aw.identification.validate(output, log, simulation=False)
        found.report(report, compared)
        say(f"wrote {report}")
    if found.verdict != "identified":
        raise typer.Exit(NOT_IDENTIFIED)


def _feedback(text: str) -> tuple[list[float], list[float], float] | None:
    """Gains and period of "900,300;120,40;0.005"; None of an empty text."""
    from armwright.errors import IdentificationError

    if not text:
        return None
    try:
        kp, kd, (period,) = ([float(word) for word in part.split(",")] for part in text.split(";"))
    except ValueError:
        expected = "KP1,KP2,…;KD1,KD2,…;PERIOD, gains for each joint and a period in s"
        raise IdentificationError(place="--feedback", value=text, expected=expected) from None
    return kp, kd, period


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())

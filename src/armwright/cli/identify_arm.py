"""`armwright identify arm`: masses, rotors and friction of an arm from a log."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from armwright.cli.arguments import argument, flag, only, option, output_option, robot_argument, words
from armwright.cli.outcome import PAGE, TOML, check_file, exit_if, exit_unless, until_stopped, write
from armwright.cli.tables import show
from armwright.errors import IdentificationError
from armwright.progress import progress


def arm(
    robots: list[str] | None = robot_argument("The arm; by default the one that the log names.", None),
    file: Path = argument("LOG.log.toml", "Log with positions and torques of the joints."),
    kinematics_only: bool = flag("--kinematics-only", "Links of the robot file may lack masses."),
    method: str = option(
        "NAME",
        "Method: ols, wls (default), irls, tukey, essential or recursive; for a log of a closed loop iv, didim or cloe.",
        "wls",
    ),
    feedback: str = option(
        "KP1,…;KD1,…;S",
        "Controller of that loop, for iv, didim and cloe: KP in N m/rad and KD in N m s/rad at the joints, period in s.",
        "",
    ),
    forgetting: float = option(
        "SHARE",
        "Forgetting factor of --method recursive: share of its weight that a row keeps from row to row; default 1.",
        1.0,
    ),
    friction: str = option(
        "A,B,…", "Friction terms: viscous, coulomb, offset, asymmetric, stribeck.", "viscous,coulomb,offset"
    ),
    stribeck_speed: float | None = option("W", "Speed of the Stribeck term, in rad/s or m/s at the joint."),
    springs: str = option("J1,J2,…", "Joints for which a spring and a counterbalance are tried as further terms.", ""),
    fit_efficiency: str = option(
        "J1,J2,…|all", "Joints whose gear efficiency is fitted; other joints have the record's.", ""
    ),
    lacks: str | None = option(
        "A,B,…", "Terms that the logged torque does not contain: gravity, springs, rotors, viscous, coulomb, offset."
    ),
    cutoff: float | None = option("HZ", "Cut-off of the low-pass for the log; by default chosen from the log."),
    decimate: int | None = option("K", "Keep every k-th row; by default chosen from the log."),
    bootstrap: bool = flag("--bootstrap", "Check the standard deviations by a bootstrap of blocks of the log."),
    output: Path | None = output_option("ARM.toml", "Write the arm with the fitted numbers."),
    report: Path | None = option("FILE.html", "Write a page; with -o it also compares the written arm with the log."),
) -> None:
    """Identify an arm: base parameters, rotors and friction, with standard deviations.

    The robot may be a full record or kinematics alone. The new record and the one that it replaces are both judged on the
    runs that the log holds out. Exit code: 0 identified, 1 the log does not determine all parameters or the record predicts
    worse than before, 2 bad input, 130 Ctrl-C: a finished fit is written all the same, and the result names the checks that
    are missing.

    \b
    Examples:
      armwright identify arm arm.urdf arm.log.toml --kinematics-only -o arm_identified.toml
      armwright identify arm lwa4p arm.log.toml --method irls --friction viscous,asymmetric
      armwright identify arm arm.toml arm.log.toml --fit-efficiency shoulder,elbow -o arm_identified.toml
      armwright identify arm two-link arm.log.toml --method iv --feedback "900,300;120,40;0.005"
    """
    robot = only(robots)
    check_file(output, TOML, (file, robot))
    check_file(report, PAGE)
    model = None if robot is None else aw.load(robot, kinematics_only=kinematics_only)
    with progress(f"reading {file.name}") as tell:
        log, _ = until_stopped(lambda: aw.identification.read_log(file, progress=tell))
    terms = aw.identification.ArmTerms(
        words(springs), stribeck_speed, None if lacks is None else words(lacks),
        "all" if fit_efficiency == "all" else words(fit_efficiency),
    )  # fmt: skip
    rows = aw.identification.FitRows(cutoff=cutoff, decimate=decimate)
    found, stopped = until_stopped(lambda: aw.identification.identify_arm(
        log, model, method=method, friction=words(friction), terms=terms, rows=rows, feedback=_feedback(feedback),
        forgetting=forgetting, checks=("cutoff", "bootstrap") if bootstrap else ("cutoff",),
    ))  # fmt: skip
    show(found)
    write(output, found.write)
    if report is not None:
        compared = None if output is None or stopped else aw.identification.validate(output, log, simulation=False)
        write(report, lambda path: found.report(path, compared))
    exit_if(stopped)
    exit_unless(found.verdict == "identified")


def _feedback(text: str) -> tuple[list[float], list[float], float] | None:
    """Gains and period of "900,300;120,40;0.005"; None of an empty text."""
    if not text:
        return None
    try:
        kp, kd, (period,) = ([float(word) for word in part.split(",")] for part in text.split(";"))
    except ValueError:
        expected = "KP1,KP2,…;KD1,KD2,…;PERIOD, gains for each joint and a period in s"
        raise IdentificationError(place="--feedback", value=text, expected=expected) from None
    return kp, kd, period

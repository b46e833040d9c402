"""`armwright calibrate`: corrections of an arm's geometry from measured points, poses or distances."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from armwright.cli.arguments import argument, as_options, only, option, output_option, robot_argument, words
from armwright.cli.outcome import PAGE, PICTURE, TOML, check_file, exit_unless, write
from armwright.cli.tables import show
from armwright.errors import IdentificationError


def calibrate(
    robots: list[str] | None = robot_argument("The arm; by default the file's.", None),
    file: Path = argument("FILE.calibration.toml", "What was measured, and the table that holds it."),
    terms: str = option(
        "T1,T2,…",
        "Some of zeros, frames (both by default), eccentricity, joint compliance, link compliance.",
        "zeros,frames",
    ),
    loss: str = option("WHAT", "tukey (default): wrong poses do not count; huber: they count less; squares.", "tukey"),
    folds: int = option("N", "Parts of the poses that take turns in being held out, 10 by default.", 10),
    output: Path | None = output_option("ARM.toml", "Write the arm with the calibrated geometry."),
    report: Path | None = option("FILE.html", "Write a page: errors, corrections, remarks, picture."),
    plot: Path | None = option("FILE", "Draw the error of each pose: .png, .svg or .pdf."),
) -> None:
    """Calibrate the geometry of an arm: joint zeros, rows or frames of joints, base and tool.

    Readings of the joints come with points of the tool (laser tracker, motion capture, camera), poses, distances (ball bar), or
    one fixed point that is touched from many sides. Exit code: 0 poses held out are predicted better than by the record, 1 they
    are not, 2 bad input.

    \b
    Examples:
      armwright calibrate tiago.calibration.toml
      armwright calibrate arm.toml tracker.calibration.toml -o calibrated.toml --report calibration.html
    """
    robot = only(robots)
    check_file(output, TOML, (file, robot))
    check_file(report, PAGE)
    check_file(plot, PICTURE)
    lost = [term for term in words(terms) if term not in ("zeros", "frames")] if output is not None else []
    if lost:
        what = f"a record has no number for {lost[0]}, which could not be written"
        raise IdentificationError(what, place="--terms", expected="zeros, frames, or no --output")
    with as_options("terms", "loss", "folds"):
        found = aw.calibrate(file, robot, terms=words(terms), loss=loss, folds=folds)  # type: ignore[arg-type]
    show(found)
    write(report, found.report)
    write(plot, found.plot)
    exit_unless(found.good)
    write(output, found.write)

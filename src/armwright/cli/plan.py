"""`armwright plan`: a motion planned from a motion file, and the share of each limit that it uses."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from armwright.cli.arguments import Allow, argument, option, output_option
from armwright.cli.outcome import check_file, exit_unless, write
from armwright.errors import ScenarioError
from armwright.terminal import say

ENDINGS = (".csv", ".nc")


def plan(
    file: Path = argument("FILE.motion.toml", "Motion file."),
    output: Path | None = output_option(
        "FILE", "Where the motion goes: .csv (t, q, qd, qdd of every joint) or .nc (NetCDF)."
    ),
    plot: Path | None = option("FILE", "Draw it: .png, .svg, .pdf, or .html to zoom into."),
    record_period: float = option("S", "Time in s from row to row; default 0.002.", 0.002),
    allow: Allow = None,
) -> None:
    """Plan the motion of a motion file, within its limits or those of the robot file.

    It shows the start of each segment and the largest share of every limit; torques and voltages include the payload. Each
    limit that a segment exceeds is named, and each that cannot be checked. Exit code: 0 no checked limit is exceeded, 1 one
    is, 2 bad input.

    \b
    Examples:
      armwright plan pick.motion.toml
      armwright plan pick.motion.toml -o motion.csv --plot motion.html
    """
    from armwright.results.plot import ENDINGS as PICTURES

    check_file(output, ENDINGS, (file,))
    check_file(plot, PICTURES, (file,))
    if not 1e-6 <= record_period <= 10.0:
        raise ScenarioError(place="--record-period", value=record_period, expected="1e-6 … 10 s")
    found = aw.trajectories.plan(file, allow=allow or ())
    say(found)
    write(output, lambda path: found.save(path, 1.0 / record_period))
    write(plot, found.plot)
    exit_unless(found.kept)

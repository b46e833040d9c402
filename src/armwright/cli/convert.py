"""`armwright convert`: a robot file or a saved run in another format."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from armwright.cli.arguments import argument, option
from armwright.cli.outcome import say_each


def convert(
    source: str = argument("IN", "A robot's TOML, URDF or MJCF file, the name of a built-in arm, or a run: .nc."),
    target: Path = argument("OUT", "The file to write, replaced where it exists."),
    smoothing: float | None = option(
        "V",
        "For URDF and MJCF: speed over which Coulomb friction changes its sign; by default it sticks in simulation.",
    ),
) -> None:
    """Convert a robot file or a run to another format, and list what is lost.

    The ending of OUT decides the format. Robots: .toml, .urdf, .xml or .mjcf. Runs, of a saved .nc: .mcap for Foxglove,
    PlotJuggler and Rerun, .mat for MATLAB, .csv, .parquet.

    A URDF gets its drive train in NAME.drive.toml beside it. From TOML to TOML it is the canonical form: the same arm, and
    the same bytes every time. A built-in arm converted to TOML is a file of yours to change.

    \b
    Examples:
      armwright convert panda my-panda.toml
      armwright convert my-arm.urdf my-arm.toml
      armwright convert my-arm.toml my-arm.xml
      armwright convert run.nc run.mcap
    """
    done = aw.robotfiles.convert(source, target, **({} if smoothing is None else {"smoothing": smoothing}))
    say_each("wrote ", done.written)
    say_each("lost: ", done.lost)
    say_each("note: ", done.notes)

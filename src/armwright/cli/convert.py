"""`armwright convert`: a robot file or a saved run in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import armwright as aw
from armwright.cli.arguments import argument, as_options, option, output_option
from armwright.cli.outcome import say_each, say_notes
from armwright.cli.tables import show


def convert(
    source: str = argument(
        "ROBOT|RUN", "A robot's TOML, URDF or MJCF file, the name of a built-in arm, or a run: .nc."
    ),
    target: Path = output_option("OUT", "The file to write, replaced where it exists.", ...),
    smoothing: float | None = option(
        "V",
        "For URDF and MJCF: speed over which Coulomb friction changes its sign; by default it sticks in simulation.",
    ),
    actuators: str | None = option(
        "KIND", "Of an MJCF, for an arm of servos: position, or dcmotor (MuJoCo 4 or later); fitted over --reference."
    ),
    reference: Path | None = option(
        "FILE", "Motion that MuJoCo shall follow as Armwright does: .motion.toml, .csv or .nc."
    ),
) -> None:
    """Convert a robot file or a run to another format, and list what is lost.

    The ending of OUT decides the format. Robots: .toml, .urdf, .xml or .mjcf. Runs, of a saved .nc: .mcap for Foxglove,
    PlotJuggler and Rerun, .mat for MATLAB, .csv, .parquet.

    With --actuators and --reference an MJCF has the servos of an arm as actuators, fitted so that MuJoCo moves as Armwright does;
    their numbers, with units and standard deviations, are in NAME.actuators.json beside it, for other simulators. A note on
    standard error names joints whose fit is poor; the exit code is 0.

    A URDF gets its drive train in NAME.drive.toml beside it. From TOML to TOML it is the canonical form: the same arm, and
    the same bytes every time. A built-in arm converted to TOML is a file of yours to change.

    \b
    Examples:
      armwright convert panda -o my-panda.toml
      armwright convert my-arm.urdf -o my-arm.toml
      armwright convert my-arm.toml -o my-arm.xml
      armwright convert so101 -o so101.xml --actuators position --reference swing.csv
      armwright convert run.nc -o run.mcap
    """
    reading: dict[str, Any] = {} if smoothing is None else {"smoothing": smoothing}
    with as_options("actuators", motion="--reference", kind="--actuators"):
        done = aw.robotfiles.convert(source, target, actuators=actuators, motion=reference, **reading)
    if done.actuators is not None:
        show(done.actuators)
        say_notes(done.actuators.poor)
    say_each("wrote ", done.written)
    say_each("lost: ", done.lost)
    say_each("note: ", done.notes)

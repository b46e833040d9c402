"""`armwright reproduce`: a saved run computed again and compared bit by bit."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from armwright.cli.arguments import argument, output_option
from armwright.cli.outcome import exit_unless
from armwright.cli.tables import show
from armwright.progress import progress
from armwright.terminal import say


def reproduce(
    run: Path = argument("RUN.nc", "A run of a scenario file."),
    output: Path | None = output_option("FILE", "Where the new run goes: .nc, .csv, .parquet, .mcap or .mat."),
) -> None:
    """Compute a saved run again from the scenario stored in it, and compare all bits.

    Bits are the same on the same processor with the same versions; differences in these are listed. Exit code: 0 all bits
    are equal, 1 numbers differ, 2 bad input.

    \b
    Example:
      armwright reproduce run.nc
    """
    from armwright.results.recording import check_recording

    if output is not None:
        check_recording(output)
    with progress(f"running {run.name} again") as tell:
        done = aw.reproduce(run, progress=tell)
    if output is not None:
        aw.save(done.run, output)
        say(f"wrote {output}")
    show(done)
    exit_unless(done.same)

"""`armwright parts`: an arm's file from a parts database."""

from __future__ import annotations

from pathlib import Path

import typer

from armwright.cli.arguments import argument, option, output_option
from armwright.progress import progress
from armwright.terminal import remark, say

parts = typer.Typer(name="parts")


@parts.callback()
def _about() -> None:
    """Compute an arm's mass properties from drawings: links of parts, parts of sections."""


@parts.command()
def build(
    file: Path = argument("FILE.parts.toml", "The parts database."),
    output: Path = output_option("ARM.toml", "The arm's file to write; replaced where it exists.", ...),
    audit: Path | None = option("AUDIT.html", "Also write how every link's numbers come about, as a web page."),
) -> None:
    """Write the arm that a parts database describes, with every link's mass, centre of mass and inertia computed.

    Run it again when the construction changes: loading an arm's file that is older than its parts gives a warning.

    \b
    Examples:
      armwright parts build my-arm.parts.toml -o my-arm.toml
      armwright parts build my-arm.parts.toml -o my-arm.toml --audit audit.html
    """
    from armwright.robotfiles.write_parts import write_parts

    with progress(f"weighing {file.name}"):
        built = write_parts(file, output, audit)
    for line in (*(f"measured: {each}" for each in built.overrides), *(f"warning: {each}" for each in built.warnings)):
        remark(line)
    arm = built.description
    links = f"{len(arm.links)} link{'s' * (len(arm.links) != 1)}"
    say(f"wrote {output}: {arm.name}, {links}, {arm.total_mass:.6g} kg")
    if audit is not None:
        say(f"wrote {audit}")

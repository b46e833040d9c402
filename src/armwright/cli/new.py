"""`armwright new`: a robot file to fill in."""

from __future__ import annotations

from pathlib import Path

import typer

import armwright as aw
from armwright.cli.arguments import argument, option
from armwright.cli.outcome import say_each
from armwright.terminal import say

new = typer.Typer(name="new")


@new.callback()
def _new() -> None:
    """Write a robot file to fill in."""


@new.command()
def robot(
    target: Path = argument("ARM.toml", "The robot file to write."),
    source: str | None = option(
        "FILE", "Take links and joints of a robot's file (URDF, MJCF, TOML) or a built-in arm.", names="--from"
    ),
    joints: int | None = option("N", "Number of joints, without --from.", names="--joint-count"),
    command: str = option(
        "WORD", "What the drives take: voltage, current or torque.", "current", names="--drive-command"
    ),
    drive: Path | None = option("FILE", "Its drive file; by default the one in the same folder."),
) -> None:
    """Write a robot file to fill in; every number that the drives need and that is unknown is marked TODO.

    A comment beside each TODO says what is wanted, its unit, and where a datasheet has it. `armwright check ARM.toml` then lists
    the lines that are left.

    \b
    Examples:
      armwright new robot my-arm.toml --from arm.urdf
      armwright new robot my-arm.toml --from arm.xml --drive-command voltage
      armwright new robot my-arm.toml --joint-count 3
    """
    notes = aw.robotfiles.new_robot(
        target, source, joints=joints, command=command, **({} if drive is None else {"drive": drive})
    )
    say(f"wrote {target}")
    say_each("note: ", notes)
    say(f"next: armwright check {target}")

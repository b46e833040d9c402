"""`armwright export`: an arm in other programs' languages."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from armwright.cli.arguments import Robot
from armwright.terminal import say

export = typer.Typer()


@export.callback()
def _formats() -> None:
    """Write an arm for other programs: a C library."""


@export.command()
def c(
    robot: Robot,
    functions: Annotated[
        str,
        typer.Option(
            "--functions",
            metavar="F1,F2,…",
            help="Which functions: inverse_dynamics, inverse_dynamics+wrench, jacobian:frame=tool, …",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the files; made where there is none.")
    ],
    single: Annotated[bool, typer.Option("--float", help="Compute in float instead of double.")] = False,
) -> None:
    """Write an arm's functions as a C99 library for a microcontroller: a header, a C file and a self-test.

    The code allocates nothing, does not recurse and needs nothing beyond <math.h>. In double it gives the bits of the
    compiled kernels (gcc -std=c99 -O2 -mfma -ffp-contract=off).

    \b
    Examples:
      armwright export c puma560 --functions inverse_dynamics,gravity_torques -o firmware
      armwright export c puma560 --functions inverse_dynamics+wrench,forward_kinematics:frame=link3 -o firmware
      armwright export c my-arm.toml --functions inverse_dynamics --float -o firmware
    """
    import armwright as aw
    from armwright.cli.progress import progress
    from armwright.export.c import write_c

    arm = aw.load(robot)
    names = [name.strip() for name in functions.split(",") if name.strip()]
    with progress(f"exporting {arm.name}"):
        paths = write_c(arm, names, output, "float" if single else "double")
    for path in paths:
        say(f"wrote {path}")

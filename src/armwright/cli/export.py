"""`armwright export`: an arm in other programs' languages."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from armwright.cli.arguments import Allow, Robot
from armwright.errors import ScenarioError
from armwright.terminal import say

export = typer.Typer()


@export.callback()
def _formats() -> None:
    """Write an arm or a controller for other programs: C libraries."""


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


@export.command()
def controller(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO", help="A scenario file with a loop and a controller.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the files; made where there is none.")
    ],
    name: Annotated[
        str | None, typer.Option("--name", metavar="NAME", help="What names in C begin with; default: ARM_controller.")
    ] = None,
    gains: Annotated[
        str,
        typer.Option("--gains", metavar="G1,G2,…", help="Fields of the controller that become parameters of the code."),
    ] = "",
    single: Annotated[bool, typer.Option("--float", help="Compute in float instead of double.")] = False,
    counts: Annotated[
        bool, typer.Option("--counts", help="Take positions in counts of the scenario's encoders.")
    ] = False,
    allow: Allow = None,
) -> None:
    """Write the controller of a scenario as C99 for a microcontroller, and compare it with the simulation.

    The folder gets a header, a C file, a self-test with recorded inputs, a CMakeLists.txt and a README.md. Where there is a C
    compiler, the code is compiled and run on what the controller sees in the simulation: its commands must have equal bits, in
    float be near.

    \b
    Examples:
      armwright export controller swing.scenario.toml -o firmware
      armwright export controller swing.scenario.toml --gains position_kp,speed_kp -o firmware
    """
    import armwright as aw
    from armwright.cli.progress import progress
    from armwright.scenarios.records import key_in_file, keys_in_text

    read = aw.read_scenario(scenario, allow=allow or ())
    fields = [gain.strip() for gain in gains.split(",") if gain.strip()]
    with progress(f"exporting the controller of {read.arm.name}"):
        try:
            real = "float" if single else "double"
            exported = aw.export_controller(read, output, name=name, gains=fields, real=real, counts=counts)
        except ScenarioError as error:  # which does not know the file
            raise error.renamed(key_in_file, keys_in_text).within(file=scenario) from None
    for path in exported.paths:
        say(f"wrote {path}")
    if exported.comparison is not None:
        compared = exported.comparison
        took = f"{1e9 * compared.seconds:.0f} ns a step here ({Path(compared.compiler).name})"
        equal = "every command has the bits of the simulation"
        near = f"commands in float are within {compared.error:.2g} of their range of the simulation's, on its inputs"
        say(f"{compared.ticks} steps: {near if single else equal}; {took}")
    for note in exported.notes:
        say(f"armwright: note: {note}", err=True)

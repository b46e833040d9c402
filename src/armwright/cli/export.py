"""`armwright export`: an arm or a controller in other programs' languages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

import armwright as aw
from armwright.cli.arguments import SCENARIO, Allow, Robot, argument, as_options, flag, option, output_option, words
from armwright.cli.outcome import check_file, naming_file, say_each, say_notes
from armwright.progress import progress
from armwright.terminal import result, say

export = typer.Typer(name="export")


@export.callback()
def _formats() -> None:
    """Write an arm or a controller for other programs: C libraries, FMUs, ROS 2."""


@export.command()
def c(
    robot: Robot,
    functions: str = option(
        "F1,F2,…", "Which functions: inverse_dynamics, inverse_dynamics+wrench, jacobian:frame=tool, …", ...
    ),
    output: Path = output_option("DIR", "Folder for the files; made where there is none.", ...),
    single: bool = flag("--float", "Compute in float instead of double."),
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
    from armwright.export.c import write_c

    arm = aw.load(robot)
    with progress(f"exporting {arm.name}"):
        paths = write_c(arm, words(functions), output, "float" if single else "double")
    say_each("wrote ", paths)


@export.command()
def controller(
    scenario: str = argument("SCENARIO", "A scenario file with a loop and a controller."),
    output: Path = output_option("DIR", "Folder for the files; made where there is none.", ...),
    name: str | None = option("NAME", "Name that those in C begin with; default: ARM_controller."),
    gains: str = option(
        "G1,G2,…", "Fields of the controller that become parameters of the code.", "", show_default=True
    ),
    single: bool = flag("--float", "Compute in float instead of double."),
    counts: bool = flag("--encoder-counts", "Take positions in counts of the scenario's encoders."),
    ram: int | None = option("BYTES", "RAM that the target has for it.", min=0),
    flash: int | None = option("BYTES", "Flash that it has.", min=0),
    allow: Allow = None,
) -> None:
    """Write the controller of a scenario as C99 for a microcontroller, and compare it with the simulation.

    The folder gets a header, a C file, a self-test with recorded inputs, a CMakeLists.txt and a README.md. If a C compiler
    is installed, the code is compiled and run on the controller's inputs in the simulation: its commands must have equal
    bits (in float: be close).

    \b
    Examples:
      armwright export controller swing.scenario.toml -o firmware
      armwright export controller swing.scenario.toml --gains position_kp,speed_kp -o firmware
      armwright export controller swing.scenario.toml --ram 16384 --flash 65536 -o firmware
    """
    read = aw.read_scenario(scenario, allow=allow or ())
    options = {"real": "float" if single else "double", "counts": counts, "ram": ram, "flash": flash}
    as_typed = as_options("name", "gains", "counts", "ram", "flash")
    with progress(f"exporting the controller of {read.arm.name}"), naming_file(scenario), as_typed:
        exported = aw.export.export_controller(read, output, name=name, gains=words(gains), **options)
    say_each("wrote ", exported.paths)
    if exported.footprint is not None:
        say(f"takes {exported.footprint}")
    if exported.comparison is not None:
        compared = exported.comparison
        took = f"{1e9 * compared.seconds:.0f} ns a step here ({Path(compared.compiler).name})"
        equal = "every command has the bits of the simulation"
        near = f"commands in float are within {compared.error:.2g} of their range of the simulation's, on its inputs"
        say(f"{compared.ticks} steps: {near if single else equal}; {took}")
    say_notes(exported.notes)


@export.command()
def ros2(
    source: str = argument("ROBOT|SCENARIO", "A robot, as of other commands, or a scenario file (.toml)."),
    output: Path = output_option("DIR", "Folder for the files; made where there is none.", ...),
    command: str | None = option(
        "KIND",
        "What the trajectory controller of a robot commands: position (the default), velocity or effort.",
        names="--command-interface",
    ),
    rate: int | None = option(
        "HZ", "Update rate of the controller manager of a robot; default: 100.", names="--update-rate"
    ),
    hardware: str = option("PLUGIN", "Plugin of the arm's driver.", "mock_components/GenericSystem", show_default=True),
    name: str | None = option("NAME", "Name of a scenario's package; default: ARM_controller."),
    gains: str = option("G1,G2,…", "Fields of a scenario's controller that become parameters.", "", show_default=True),
    allow: Allow = None,
) -> None:
    """Write an arm for ROS 2, or a scenario's controller as a package with a plugin of ros2_control.

    NAME.urdf has the limits of every joint and of its command interfaces; joint_limits.yaml and controllers.yaml are
    parameters for the controller manager and MoveIt. NAME.drive.toml holds what a URDF cannot. The package of a scenario has
    these, its controller as C99 and a chainable controller around it, for ROS 2 Jazzy and Kilted.

    \b
    Examples:
      armwright export ros2 lwa4p -o lwa4p_description
      armwright export ros2 my-arm.toml --command-interface effort --update-rate 500 -o my_arm_description
      armwright export ros2 swing.scenario.toml --gains kp,kd -o swing_controller
    """
    given = aw.read_scenario(source, allow=allow or ()) if source.endswith(SCENARIO) else aw.load(source)
    options = {"command": command, "rate": rate, "hardware": hardware, "name": name, "gains": words(gains)}
    as_typed = as_options("hardware", "name", "gains", command="--command-interface", rate="--update-rate")
    with (
        progress(f"exporting {given.name if isinstance(given, aw.Model) else given.arm.name}"),
        naming_file(source),
        as_typed,
    ):
        exported = aw.export.export_ros2(given, output, **options)
    say_each("wrote ", exported.paths)
    say_each("lost: ", exported.lost)
    say_notes(exported.notes)


@export.command()
def fmu(
    source: str = argument("ROBOT|SCENARIO", "A robot, as of other commands, or a scenario file (.toml)."),
    output: Path = output_option("X.fmu", "The file.", ...),
    part: str = option("PART", "plant, controller or both; the last two need a scenario.", "plant", show_default=True),
    version: str = option("VERSION", "3.0 or 2.0.", "3.0", names="--fmi", show_default=True),
    interface: str = option("INTERFACE", "co-simulation or model-exchange.", "co-simulation", show_default=True),
    name: str | None = option("NAME", "Name of the model; default: from the file's name."),
    platforms: str | None = option(
        "P1,P2,…", "Binaries, such as x86_64-windows or host; default: all that can be built."
    ),
    allow: Allow = None,
) -> None:
    """Write an arm, its controller or both as an FMU, for Simulink, Modelica tools, FMPy and others.

    For co-simulation it is the simulation itself as C: in another tool it gives the bits of `armwright simulate`. It holds
    sources, and binaries for Linux, Windows and macOS if zig is installed (the extra `fmu`), else one for this computer, if
    it has a C compiler.

    \b
    Examples:
      armwright export fmu puma560 -o puma560.fmu
      armwright export fmu swing.scenario.toml --part controller -o swing_controller.fmu
      armwright export fmu puma560 --interface model-exchange --fmi 2.0 -o puma560_me.fmu
    """
    check_file(output, (".fmu",), [source])
    given = aw.read_scenario(source, allow=allow or ()) if source.endswith(SCENARIO) else aw.load(source)
    as_typed = as_options("part", "interface", "name", "platforms", version="--fmi")
    with progress("exporting the FMU"), naming_file(source), as_typed:
        binaries = None if platforms is None else words(platforms)
        options: dict[str, Any] = {"part": part, "version": version, "interface": interface}
        exported = aw.export.export_fmu(given, output, name=name, platforms=binaries, **options)
    result(exported)
    counts = f"{len(exported.inputs)} inputs, {len(exported.outputs)} outputs, {len(exported.parameters)} parameters"
    say(f"wrote {exported.path}: FMI {exported.version}, {exported.interface}, {exported.part}; {counts}")
    sizes = ", ".join(f"{each} {size / 1024:.0f} kB" for each, size in exported.platforms.items())
    say(f"sources, and binaries for {sizes}" if sizes else "sources alone")
    say_notes(exported.notes)

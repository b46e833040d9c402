"""`armwright identify gains`: drive gains of an arm by a payload that was weighed."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from armwright.cli.arguments import argument, flag, numbers, option, output_option, robot_argument
from armwright.cli.outcome import PAGE, TOML, check_file, exit_unless, until_stopped, write
from armwright.cli.tables import show
from armwright.errors import IdentificationError
from armwright.progress import progress


def gains(
    robot: str = robot_argument("The arm; its masses and torque constants are not used."),
    file: Path = argument("LOG.log.toml", "Log of the arm without the payload in motion."),
    loaded: Path = option("LOG", "Log of the arm with the payload in motion.", ..., names="--loaded-log"),
    mass: float = option("KG", "Weighed mass of the payload.", ..., names="--payload-mass"),
    mass_std: float = option(
        "KG", "Standard deviation of the mass; widens that of every gain.", 0.0, names="--payload-mass-std"
    ),
    com: str | None = option(
        "X,Y,Z", "Centre of mass of the payload [m] in the frame; by default fitted with the gains."
    ),
    inertia: str | None = option(
        "XX,XY,XZ,YY,YZ,ZZ",
        "Inertia of the payload about its centre of mass [kg m²], with --com; by default fitted as well.",
    ),
    frame: str | None = option("NAME", "Frame that carries the payload; by default the tip."),
    kinematics_only: bool = flag("--kinematics-only", "Links of the robot file may lack masses."),
    cutoff: float | None = option("HZ", "Cut-off of the low-pass for the log; by default chosen from the log."),
    output: Path | None = output_option("ARM.toml", "Write the arm with these torque constants and their deviations."),
    report: Path | None = option("FILE.html", "Write a page: verdict, remarks, parameters, fits."),
) -> None:
    """Identify drive gains: torque constants of all motors by a payload of known mass, with standard deviations.

    It needs two logs of the same arm with currents, without and with the payload, and the kinematics. If the logs
    have torques, a gain is the ratio of the true torque to the logged one. With -o the gains that are identified are written,
    even if others are not. Exit code: 0 all identified, 1 not all, 2 bad input.

    \b
    Examples:
      armwright identify gains arm.urdf empty.log.toml --loaded-log loaded.log.toml --payload-mass 5 -o arm.toml
      armwright identify gains lwa4p empty.log.toml --loaded-log loaded.log.toml --payload-mass 5 --com 0.05,0,0.08
    """
    import numpy as np

    from armwright.spatial import TENSOR  # with NumPy, which `--help` does without

    check_file(output, TOML, (file, loaded, robot))
    check_file(report, PAGE)
    centre, moments = _of_payload("--com", com, 3), _of_payload("--inertia", inertia, len(TENSOR))
    tensor = None
    if moments is not None:
        tensor = np.zeros((3, 3))
        for (i, j), value in zip(TENSOR.values(), moments, strict=True):
            tensor[i, j] = tensor[j, i] = value
    arm = aw.load(robot, kinematics_only=kinematics_only)
    logs = [aw.identification.read_log(each) for each in (file, loaded)]
    choose = aw.identification.choose_preparation
    preparation = None if cutoff is None else [choose(each, cutoff=cutoff) for each in logs]
    with progress("fitting gains"):
        found, _ = until_stopped(
            lambda: aw.identification.identify_drive_gains(
                logs[0], logs[1], arm, mass, centre, tensor, mass_std=mass_std, frame=frame, preparation=preparation
            )
        )
    show(found)
    write(report, lambda path: found.report(path, f"{logs[1].title}: drive gains"))
    if np.asarray(found.identifiable).any():
        write(output, lambda path: aw.identification.write_into(arm, found, path, key="gains"))
    exit_unless(found.verdict == "identified")


def _of_payload(place: str, text: str | None, count: int) -> list[float] | None:
    """Numbers of "0.1,0,0.2"; None of no text."""
    return numbers(place, text, f"{count} numbers with commas between", count=count, error=IdentificationError)

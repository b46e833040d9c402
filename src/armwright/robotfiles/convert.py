"""Conversion of a robot file to another format or to canonical TOML, and of a saved run to another format."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armwright.description import RobotDescription, read_description
from armwright.description.drive_file import ENDING
from armwright.description.writer import for_folder, write_toml
from armwright.entry import AnyMotion, as_motion, as_path
from armwright.errors import DescriptionError, ModelError, OutputError, RunError
from armwright.export.actuator_fit import ActuatorFit, fit_actuators
from armwright.export.mjcf import write_mjcf
from armwright.export.urdf import write_urdf
from armwright.model import build_model
from armwright.output import check_destination
from armwright.progress import Shown
from armwright.results.recording import check_recording, save
from armwright.results.result import Result
from armwright.results.run_file import load_run

RUN = ".nc"
MJCF = (".xml", ".mjcf")
ENDINGS = (".toml", ".urdf", *MJCF)


@dataclass(frozen=True)
class Conversion(Result):
    """Result of `convert`.

    Attributes:
        written: the files.   lost: what the format cannot hold, one sentence each; none from TOML to TOML.
        notes: what was left out or doubtful when the source was read.   actuators: that were fitted.
    """

    written: tuple[Path, ...]
    lost: tuple[str, ...]
    notes: tuple[str, ...] = ()
    actuators: ActuatorFit | None = None


def convert(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    *,
    actuators: str | None = None,
    motion: AnyMotion | None = None,
    progress: Shown = None,
    **reading: Any,
) -> Conversion:
    """Writes a robot file in the format of the target's ending: .toml, .urdf (with a drive file beside it), .xml or .mjcf.

    TOML to TOML gives the canonical form: equal descriptions are equal bytes, and a file in that form stays as it is. A saved
    run, .nc, goes to .csv, .parquet, .mcap or .mat, as `save` writes them.

    Args:
        source: a built-in name, or a path.   target: the file to write; one that is there is replaced.
        actuators: of an MJCF for an arm of servos, "position" or "dcmotor", fitted over `motion` by `export.fit_actuators`; their
            numbers go to NAME.actuators.json beside it. None: motors, whose control is a torque.
        motion: that MuJoCo shall move as Armwright does; with `actuators`.   progress: of the fit, as for `fit_actuators`.
        reading: what a URDF or an MJCF leaves open, as for `load`.
    Returns:
        conversion: the files written, what was lost, and what was doubtful.
    Raises:
        DescriptionError: an invalid source.   OutputError: a target that cannot be written, or is the source
            itself.   RunError: an .nc that is no run.   ModelError, ScheduleError: as `fit_actuators`.
    Example:
        >>> made = aw.robotfiles.convert("ur5e", "ur5e.urdf")
        >>> [path.name for path in made.written]
        ['ur5e.urdf', 'ur5e.drive.toml']
    """
    _check_together(actuators, motion, target)
    source = as_path(source, "source", DescriptionError)
    if Path(source).suffix.lower() == RUN:
        return _converted_run(Path(source), target, reading)
    path = check_destination(target, ENDINGS)
    _check_other_file(Path(source), path)
    robot = read_description(source, **reading)
    notes = () if Path(source).suffix == ".toml" else robot.remarks
    ending = path.suffix.lower()
    if ending == ".toml":
        robot, lost = _without_origin(robot, Path(source), path)
        robot, far = for_folder(robot, path.parent)
        return Conversion((write_toml(robot, path),), (*lost, *far), notes)
    if ending == ".urdf":
        lost = write_urdf(robot, path)
        return Conversion((path, path.with_name(path.stem + ENDING)), tuple(lost), notes)
    if actuators is None or motion is None:
        return Conversion((path,), tuple(write_mjcf(robot, path)), notes)
    fit = fit_actuators(build_model(robot), motion, actuators, progress=progress)
    written, lost = fit.write(path)
    return Conversion(tuple(written), tuple(lost), notes, fit)


def _check_together(actuators: str | None, motion: AnyMotion | None, target: str | os.PathLike[str]) -> None:
    if motion is not None and not isinstance(motion, (str, os.PathLike)):
        as_motion(motion)
    if (actuators is None) != (motion is None):
        raise ModelError("missing", place="motion" if motion is None else "actuators", expected="both of them")
    if actuators is not None and Path(target).suffix.lower() not in MJCF:
        raise OutputError("holds no actuators", file=target, expected=" or ".join(MJCF))


def _converted_run(source: Path, target: str | os.PathLike[str], reading: dict[str, Any]) -> Conversion:
    for key in reading:
        raise RunError("goes with a robot file", place=key, file=source)
    path = check_recording(check_destination(target, read=[source]))
    save(load_run(source), path)
    return Conversion((path,), ())


def _check_other_file(source: Path, target: Path) -> None:
    """Refuses to write over what is read, the drive file of a URDF included."""
    ending = target.suffix.lower()
    if not os.path.isfile(source):
        return
    if os.path.realpath(source) == os.path.realpath(target):
        raise OutputError("this is the robot file that is read", file=target, expected="another file to write")
    old, new = (path.with_name(path.stem + ENDING) for path in (source, target))
    if (
        ending == ".urdf"
        and source.suffix.lower() != ".toml"
        and os.path.isfile(old)
        and os.path.realpath(old) == os.path.realpath(new)
    ):
        raise OutputError("this is the drive file that is read", file=new, expected=f"another name than {target.name}")


def _without_origin(robot: RobotDescription, source: Path, target: Path) -> tuple[RobotDescription, list[str]]:
    """The description for another folder, from where the file that it was built from is not found, and what it loses."""
    origin = robot.built_from
    if origin is None or (os.path.isfile(source) and source.resolve().parent == target.resolve().parent):
        return robot, []
    return robot.replace(built_from=None), [f"that it was built from {origin.file}, which stands in another folder"]

"""`armwright measure`: mass, centre and inertia of a link by scale, supports and pendulums, with intervals."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import armwright as aw
from armwright.cli.arguments import as_options, numbers, option, output_option, robot_argument
from armwright.cli.outcome import TOML, check_file, write
from armwright.cli.tables import show
from armwright.errors import IdentificationError

if TYPE_CHECKING:
    from armwright.identification.weighing.measured_number import MeasuredNumber

measure = typer.Typer(
    name="measure",
    help="Measure a link: mass by scale, centre by two supports, inertia by pendulum.",
)
FORM = "a number, or VALUE,STD"
Robot = Annotated[str | None, robot_argument("Arm for whose robot file the number is meant.")]
LinkName = Annotated[str | None, option("NAME", "Link that was measured.", ..., names="--link")]
Output = Annotated[Path | None, output_option("ARM.toml", "Write the arm with the number and its deviation.", ...)]
Gravity = Annotated[float, option("G", "Free fall in m/s²; default 9.80665.", ..., names="--gravity")]
STANDARD = 9.80665
SWING = {"period": "--swing-period", "length": "--wire-length"}  # options by argument


@measure.command()
def mass(
    reading: list[float] = option("KG", "Reading of the scale; may be repeated.", ...),
    scale_std: float = option("KG", "Standard deviation of the scale's calibration.", 0.0),
    resolution: float = option("KG", "Last digit of the scale.", 0.0),
    tare: str = option("KG[,STD]", "Mass that was weighed with the link, such as a fixture.", "0"),
    robot: Robot = None,
    link: LinkName = None,
    output: Output = None,
) -> None:
    """Mass by a scale: the mean of the readings less the tare.

    \b
    Examples:
      armwright measure mass --reading 2.314 --reading 2.315 --resolution 0.001
      armwright measure mass arm.toml --reading 2.314 --scale-std 0.002 --link forearm -o arm.toml
    """
    _check(robot, link, output)
    with as_options("scale_std", "resolution", "tare", readings="--reading"):
        found = aw.identification.measured_mass(
            reading, scale_std=scale_std, resolution=resolution, tare=_reading("--tare", tare)
        )
    _finish(found, "mass", robot, link, output)


@measure.command()
def centre(
    reading: str = option("KG[,STD]", "Reading of the scale under the second support.", ...),
    span: str = option("M[,STD]", "From the first support to the second.", ...),
    mass: str = option("KG[,STD]", "Mass of the link.", ...),
    origin: str = option("M[,STD]", "Coordinate of the first support on the link's axis.", "0"),
    axis: str = option("x|y|z", "The link's axis from the first support to the second, default x.", "x"),
    robot: Robot = None,
    link: LinkName = None,
    output: Output = None,
) -> None:
    """Centre of mass by two supports, one of them on a scale: one coordinate for each way that the link lies.

    \b
    Example:
      armwright measure centre --reading 1.05,0.001 --span 0.4,0.0005 --mass 2.314,0.001 --origin -0.05 --axis z
    """
    _check(robot, link, output)
    if axis not in ("x", "y", "z"):
        raise IdentificationError(place="--axis", value=axis, expected="x, y or z")
    given = {"reading": reading, "span": span, "mass": mass, "origin": origin}
    with as_options(*given):
        found = aw.identification.measured_centre(**{name: _reading(f"--{name}", text) for name, text in given.items()})
    _finish(found, f"com_{axis}", robot, link, output)


@measure.command()
def pendulum(
    period: str = option("S[,STD]", "Time of a full swing.", ..., names="--swing-period"),
    mass: str = option("KG[,STD]", "Mass of the link.", ...),
    distance: str = option("M[,STD]", "From the axis of suspension to the centre of mass.", ...),
    amplitude: float = option("RAD", "Amplitude of the swing; default 0.", 0.0),
    gravity: Gravity = STANDARD,
    about: str = option("xx|yy|zz", "The link's axis that it swings about, default zz.", "zz"),
    robot: Robot = None,
    link: LinkName = None,
    output: Output = None,
) -> None:
    """Moment of inertia about the centre of mass by a compound pendulum: the link swings about an axis beside its centre.

    \b
    Example:
      armwright measure pendulum --swing-period 1.1832,0.0005 --mass 2.314,0.001 --distance 0.21,0.0003 --about yy
    """
    _check(robot, link, output)
    given = {"period": period, "mass": mass, "distance": distance}
    with as_options(*given, "amplitude", "gravity", **SWING):
        readings = {name: _reading(SWING.get(name, f"--{name}"), text) for name, text in given.items()}
        found = aw.identification.measured_inertia_pendulum(**readings, amplitude=amplitude, gravity=gravity)
    _finish(found, _moment(about), robot, link, output)


@measure.command()
def bifilar(
    period: str = option("S[,STD]", "Time of a full swing.", ..., names="--swing-period"),
    mass: str = option("KG[,STD]", "Mass of the link.", ...),
    length: str = option("M[,STD]", "Height of the wires.", ..., names="--wire-length"),
    spacing: str = option("M[,STD]", "Between the wires at the link.", ...),
    spacing_top: str | None = option("M[,STD]", "Between the wires at the top; by default they are parallel."),
    gravity: Gravity = STANDARD,
    about: str = option("xx|yy|zz", "The link's axis that hangs upright, default zz.", "zz"),
    robot: Robot = None,
    link: LinkName = None,
    output: Output = None,
) -> None:
    """Moment of inertia about the centre of mass by a bifilar pendulum: the link hangs on two wires and turns.

    \b
    Example:
      armwright measure bifilar --swing-period 1.52,0.001 --mass 2.314,0.001 --wire-length 1.2,0.001 --spacing 0.3,0.0005
    """
    _check(robot, link, output)
    given = {"period": period, "mass": mass, "length": length, "spacing": spacing, "spacing_top": spacing_top}
    with as_options(*given, "gravity", **SWING):
        readings = {
            name: _reading(SWING.get(name, f"--{name.replace('_', '-')}"), text)
            for name, text in given.items()
            if text is not None
        }
        found = aw.identification.measured_inertia_bifilar(**readings, gravity=gravity)
    _finish(found, _moment(about), robot, link, output)


def _reading(place: str, text: str) -> list[float]:
    """Value and standard deviation of "2.3,0.01", which is 0 where it is not given."""
    found = numbers(place, text, FORM, error=IdentificationError) or []
    if len(found) > 2:
        raise IdentificationError(place=place, value=text, expected=FORM)
    return [*found, 0.0][:2]


def _moment(about: str) -> str:
    if about not in ("xx", "yy", "zz"):
        raise IdentificationError(place="--about", value=about, expected="xx, yy or zz")
    return f"i{about}"


def _check(robot: str | None, link: str | None, output: Path | None) -> None:
    """Refuses a robot without a link or a file to write, and the other way round."""
    given: dict[str, Any] = {"ROBOT": robot, "--link": link, "--output": output}
    missing = [name for name, value in given.items() if value is None]
    if missing and len(missing) < len(given):
        raise IdentificationError("missing", place=missing[0], expected="ROBOT, --link and --output together, or none")
    check_file(output, TOML)


def _finish(found: MeasuredNumber, key: str, robot: str | None, link: str | None, output: Path | None) -> None:
    """Shows the number, and writes the record."""
    show(found)
    if robot is not None and link is not None:
        write(
            output,
            lambda path: aw.identification.write_measured(
                robot, link, {key: found}, path, key=f"measured-{link}-{key}"
            ),
        )

"""Arguments that several commands share, and how vectors are written on the command line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from math import isfinite, nan, pi
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

import armwright as aw
from armwright.errors import ABSENT, ArmwrightError, DivergenceError, ScenarioError
from armwright.terminal import note

if TYPE_CHECKING:
    import numpy as np

    from armwright.model import Model
    from armwright.simulation.scenario_parts import Start

SCENARIO = ".scenario.toml"
MOTION = ".motion.toml"


def option(metavar: str, text: str, default: Any = None, *, names: str = "", **more: Any) -> Any:
    """An option, whose name is its parameter's and whose help does not show the default; units in brackets are no markup.

    Args:
        metavar, text: of its help.   default: of a required option, and in `Annotated`: `...`.
        names: others than the parameter's.   more: as `typer.Option` has it.
    """
    return typer.Option(default, *names.split(), metavar=metavar, help=escape(text), **{"show_default": False, **more})


def output_option(metavar: str, text: str, default: Any = None) -> Any:
    """The option --output, short -o."""
    return option(metavar, text, default, names="--output -o")


def flag(name: str, text: str, default: bool | None = False) -> Any:
    """An option without a value."""
    return typer.Option(default, name, help=escape(text), show_default=False)


def argument(metavar: str, text: str, default: Any = ..., **more: Any) -> Any:
    """An argument, required by default."""
    return typer.Argument(default, metavar=metavar, help=escape(text), **{"show_default": False, **more})


def complete_robot(incomplete: str) -> list[str]:
    """Names of built-in arms and paths of files with this beginning, for the completion of shells."""
    from armwright.description.database import builtin_names

    typed = Path(incomplete)
    folder = typed if incomplete.endswith(("/", "\\")) else typed.parent
    paths = [f"{path}/" if path.is_dir() else str(path) for path in sorted(folder.glob("*"))]
    return [word for word in (*builtin_names(), *paths) if word.startswith(incomplete)]


def robot_argument(text: str, default: Any = ..., metavar: str = "ROBOT") -> Any:
    """An argument that names an arm, required by default; shells complete names and files."""
    return argument(metavar, text, default, autocompletion=complete_robot)


Robot = Annotated[str, robot_argument("Name of a built-in arm, or path of a robot's TOML, URDF or MJCF file.")]
RobotOrScenario = Annotated[
    str,
    robot_argument(
        "Name of a built-in arm, or path of a robot's file or of a .scenario.toml.", metavar="ROBOT|SCENARIO"
    ),
]
AnyScenario = Annotated[Path, argument("SCENARIO", "A .scenario.toml with a controller.")]
PhaseMargin = Annotated[
    str, option("ANGLE", "Phase margin to keep, such as 45deg; default 30deg.", ..., names="--phase-margin")
]
Table = Annotated[Path, argument("IN.csv", "CSV file, one set of data a row.")]
Out = Annotated[Path | None, output_option("OUT.csv", "CSV file for the results; without it they are printed.", ...)]
Schedule = Annotated[
    Path | None, option("FILE", "CSV: t in s and one column a joint, held from row to row.", ..., names="--schedule")
]
Voltage = Annotated[str | None, option("V1,V2,…", "Constant voltages in V.", ..., names="--voltage")]
Current = Annotated[str | None, option("I1,I2,…", "Constant currents in A.", ..., names="--current")]
Torque = Annotated[str | None, option("T1,T2,…", "Constant motor torques at the joints in N m.", ..., names="--torque")]
Command = Annotated[
    str | None, option("U1,U2,…", "Constant commands, each in its own joint's unit.", ..., names="--command")
]
Allow = Annotated[
    list[Path] | None,
    option(
        "FOLDER",
        "Folder in which a scenario file may name files, beside its own; may be repeated.",
        ...,
        names="--allow",
    ),
]
Duration = Annotated[
    float | None, option("S", "Duration in s; by default until the schedule's last row.", ..., names="--duration")
]
Position = Annotated[
    str | None, option("Q1,Q2,…", "Initial positions in rad (or 30deg, pi/2) or m; default 0.", ..., names="--start")
]
Velocity = Annotated[
    str | None, option("W1,W2,…", "Initial velocities in rad/s or m/s; default 0.", ..., names="--start-velocity")
]

ANGLE = re.compile(r"^(?P<factor>[+-]?[\d.]*)\*?pi(?:/(?P<by>[\d.]+))?$")


def vector(option: str, text: str, names: Sequence[str], units: Sequence[str]) -> np.ndarray:
    """Numbers of text such as `"1,2,3"`, one for each joint; a single number is used for every joint.

    Angles may be written `30deg` or `pi/2` where the joint's unit is rad (or rad/s).

    Args:
        option: its name in errors.   text: that was typed.   names: (n,) the joints.   units: (n,) their units.
    Returns:
        values: (n,).
    Raises:
        ScenarioError: too few or too many numbers, or something that is no finite number.
    """
    import numpy as np

    parts = [part.strip() for part in text.split(",")]
    if len(parts) not in (1, len(names)):
        expected = f"{len(names)} numbers ({', '.join(names)})" if len(names) > 1 else "1 number"
        raise ScenarioError(place=option, value=text, expected=f"{expected}, or one for all joints")
    if len(parts) == 1:
        parts = parts * len(names)
    joints = zip(parts, names, units, strict=True)
    return np.array([_number(f"{option} of joint {name!r}", part, unit) for part, name, unit in joints])


def _number(place: str, text: str, unit: str) -> float:
    """One number; an angle may be written `30deg` or `pi/2`."""
    angle = unit.startswith("rad")
    word, factor = text, 1.0
    if angle and text.endswith("deg"):
        word, factor = text.removesuffix("deg"), pi / 180
    match = ANGLE.match(text) if angle else None
    try:
        if match:
            signs = {"": 1.0, "+": 1.0, "-": -1.0}
            times = signs[match["factor"]] if match["factor"] in signs else float(match["factor"])
            value = times * pi / float(match["by"] or 1)
        else:
            value = float(word) * factor
    except (ValueError, ZeroDivisionError):
        value = nan
    if not isfinite(value):
        example = "such as 0.5, 30deg or pi/6" if angle else "such as 0.5"
        raise ScenarioError(place=place, value=text, expected=f"a finite number [{unit}], {example}")
    return value


def angle(place: str, text: str) -> float:
    """Angle [rad] of text such as `30deg`, `pi/6` or `0.5`.

    Args:
        place: name of the option.   text: that was typed.
    Raises:
        ScenarioError: something that is no finite number.
    """
    return _number(place, text, "rad")


def only(robots: Sequence[str] | None) -> str | None:
    """The robot of a first argument that may be left out; None if it was.

    Raises:
        ScenarioError: there are several.
    """
    if robots and len(robots) > 1:
        raise ScenarioError(
            "one robot, then the file", place="arguments", value=" ".join(robots), expected="ROBOT once"
        )
    return robots[0] if robots else None


def start_of(arm: Model, q0: str | None, qd0: str | None) -> Start:
    """Initial positions and speeds from the options --start and --start-velocity."""
    from armwright.model.joint_signals import joint_units

    units = joint_units(arm, "q")
    q = None if q0 is None else vector("--start", q0, arm.names, units)
    if q is not None and q0 is not None and "deg" not in q0:
        far = [k for k, unit in enumerate(units) if unit == "rad" and abs(q[k]) > 2.0 * pi]
        for k in far[:1]:
            turns = f"radians? {q[k]:g} rad is {abs(q[k]) / (2.0 * pi):.1f} turns"
            note(f"--start of joint {arm.names[k]!r}: {turns}; degrees are written {q[k]:g}deg")
    qd = None if qd0 is None else vector("--start-velocity", qd0, arm.names, joint_units(arm, "qd"))
    return aw.Start(q, qd)


def commands_of(arm: Model, schedule: Path | None, constants: dict[str, str | None]) -> Any:
    """The schedule or the constant command of the drives, as `Scenario` takes it.

    Args:
        arm: the model.   schedule: CSV file.   constants: values by option: "voltage", "current", "torque" or "command".
    Raises:
        ScenarioError: none, or more than one, or one that the arm's drives do not take.
    """
    from armwright.model.joint_signals import joint_units

    units = joint_units(arm, "u")
    options = {name: text for name, text in {**constants, "schedule": schedule}.items() if text is not None}
    kinds = list(dict.fromkeys(body.drive.command for body in arm.coordinates))
    usual = f"--{kinds[0]}" if len(kinds) == 1 else "--command"
    if len(options) != 1:
        what = " and ".join(f"--{name}" for name in options) if options else "no command"
        unit = " | ".join(dict.fromkeys(units))
        expected = f"--schedule FILE or {usual} with one number for each joint [{unit}]"
        raise ScenarioError(f"{what} given", place=arm.name, expected=expected)
    if schedule is not None:
        return aw.simulation.read_schedule(schedule, arm.names, units)
    name, text = next(iter(options.items()))
    for body in arm.coordinates:
        if name not in ("command", body.drive.command):
            what = f"joint {body.joint!r} is driven by {body.drive.command}"
            raise ScenarioError(what, place=f"{arm.name} --{name}", expected=usual)
    return vector(f"--{name}", str(text), arm.names, units)


def words(text: str) -> list[str]:
    """Words of text with commas between, without empty ones."""
    return [word.strip() for word in text.split(",") if word.strip()]


def numbers(
    place: str,
    text: str | None,
    expected: str,
    *,
    kind: type[float] = float,
    count: int | None = None,
    error: type[ArmwrightError] = ScenarioError,
) -> list[Any] | None:
    """Numbers of text with commas between; None of None.

    Args:
        place: name of the option.   text: that was typed.   expected: in words.   kind: float or int.   count: how many.
        error: type of the error.
    Raises:
        ArmwrightError: something that is no number, or another count.
    """
    if text is None:
        return None
    try:
        found = [kind(part) for part in text.split(",")]
    except ValueError:
        found = []
    if not found or count not in (None, len(found)):
        raise error(place=place, value=text, expected=expected)
    return found


def named_numbers(place: str, texts: Iterable[str], expected: str, error: type[ArmwrightError]) -> dict[str, float]:
    """Numbers by name of texts such as `"R=1.3"`.

    Args:
        place: name of the option.   texts: that were typed.   expected: in words.   error: type of the error.
    Raises:
        ArmwrightError: something else than a name and a number.
    """
    found = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            found[name] = float(value)
        except ValueError:
            raise error(place=place, value=text, expected=expected) from None
    return found


def node_numbers(nodes: str | None, error: type[ArmwrightError]) -> list[int] | None:
    """Node numbers of the drives on a bus, as they were typed.

    Raises:
        ArmwrightError: no whole numbers with commas between.
    """
    return numbers("--nodes", nodes, "whole numbers with commas between: 3,4,5", kind=int, error=error)


def refuse(
    options: Mapping[str, Any],
    what: str,
    *,
    error: type[ArmwrightError] = ScenarioError,
    with_value: bool = False,
    **about: Any,
) -> None:
    """Refuses options that were given.

    Args:
        options: values by name without --, None of one that was not given.   what: is wrong with them.
        error: its type.   with_value: whether it shows the value.   about: its further fields.
    Raises:
        ArmwrightError: names the first.
    """
    for name, value in options.items():
        if value is not None:
            shown = {"value": value} if with_value else {}
            raise error(what, place=f"--{name}", **shown, **about)


def refuse_options(file: str, options: Mapping[str, Any]) -> None:
    """Refuses options that a scenario file already decides.

    Raises:
        ScenarioError: one of them was given.
    """
    refuse(options, "the scenario file states this already", expected="the option or the file", file=file)


def refuse_without_file(folders: list[Path] | None, robot: str | None = None) -> None:
    """Refuses --allow and --robot without a scenario file: only a scenario file names other files, and a robot to replace.

    Raises:
        ScenarioError: one of them was given.
    """
    options = {"allow": str(folders[0]) if folders else None, "robot": robot}
    refuse(options, "goes with a scenario file", with_value=True, expected=f"FILE{SCENARIO}")


OPTION_OF = {  # field of a scenario, or argument of a function → the option that gives it
    "duration": "--duration",
    "solver.accuracy": "--accuracy",
    "solver.step": "--step",
    "step": "--step",
    "solver.integrator": "--integrator",
    "recording.period": "--record-period",
    "recording.every": "--record-every",
    "accuracies": "--accuracies",
    "steps": "--step-count",
}
IN_TEXT = re.compile(r"\b(?:solver|recording)\.\w+")
QUOTED = re.compile(r"['\"](\w+)['\"]")
RULE = re.compile(r"\bintegrator = ((?:(?:, | or )?['\"]\w+['\"])+)")


@contextmanager
def naming_options(*fields: str) -> Iterator[None]:
    """Errors about fields of a scenario name the options of the command that gave them: `solver.accuracy` → `--accuracy`.

    Args:
        fields: those that options gave; by default all of `OPTION_OF`.
    Raises:
        ArmwrightError: as it was raised, its place an option where it is one of these fields; so are fields in its sentences.
    """
    options = {field: OPTION_OF[field] for field in fields or OPTION_OF}

    def in_text(text: str) -> str:
        named = IN_TEXT.sub(lambda field: options.get(field[0], field[0]), text)
        if "solver.integrator" in options:
            named = RULE.sub(lambda rules: "--integrator " + QUOTED.sub(r"\1", rules[1]), named)
        return named

    try:
        yield
    except (ScenarioError, DivergenceError) as error:
        renamed = error.renamed(lambda place: options.get(place, place), in_text)
        absent = (replace(each, value=ABSENT) if each.value is None else each for each in renamed.problems)
        raise type(error).of(*absent) from None


@contextmanager
def as_options(*fields: str, **others: str) -> Iterator[None]:
    """Errors about arguments of a function name the options that gave them: `most_order` → `--most-order`.

    Args:
        fields: the arguments.
        others: options of other names by argument, such as `version="--fmi"`.
    Raises:
        ArmwrightError: as it was raised, its place an option where it is one of these.
    """
    try:
        yield
    except ArmwrightError as error:
        options = {field: f"--{field.replace('_', '-')}" for field in fields} | others
        raise error.renamed(lambda place: options.get(place, place)) from None

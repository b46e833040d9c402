"""`armwright excite`: experiments for identification, of a whole arm, of one motor, or of an arm's geometry."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

import armwright as aw
from armwright.cli.arguments import (
    Robot,
    argument,
    as_options,
    flag,
    numbers,
    only,
    option,
    output_option,
    robot_argument,
    vector,
)
from armwright.cli.outcome import PICTURE, check_file, exit_if, until_stopped, write
from armwright.cli.tables import show
from armwright.errors import ScenarioError
from armwright.progress import progress
from armwright.terminal import remark, say

if TYPE_CHECKING:
    from armwright.identification.experiments.motor import MotorGuess


class ArmByDefault(TyperGroup):
    """Commands `arm`, `motor` and `poses`; `excite ROBOT` is `excite arm ROBOT`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Puts "arm" before a robot if no command is named."""
        if args and args[0] not in self.commands and "--help" not in args[:1]:
            args = ["arm", *args]
        return super().parse_args(ctx, args)


OPTION_OF_GUESS = {"gain": "--motor-gain", "most": "--max-command", "speed": "--max-speed"}
excite = typer.Typer(name="excite", cls=ArmByDefault)

Picture = Annotated[Path | None, option("FILE", "Draw it: .png, .svg or .pdf.", ..., names="--plot")]
Seed = Annotated[int, option("N", "Seed of random numbers; default 0.", ..., names="--seed")]


@excite.callback()
def _about() -> None:
    """Design experiments for identification.

    `excite ROBOT -o MOTION.csv` is short for `excite arm ROBOT -o MOTION.csv`: a motion of the whole arm. `excite motor KIND`
    makes a command of one motor, `excite poses ROBOT` chooses poses for a kinematic calibration.
    """


@excite.command()
def arm(
    robot: Robot,
    output: Path = output_option("MOTION.csv", "The motion to write: t, q, qd and qdd of all joints.", ...),
    cycle: float = option("S", "Period of the motion in s; default 10.", 10.0),
    harmonics: int = option("N", "Harmonics of each joint's Fourier series; default 5.", 5),
    starts: int = option("N", "Random starts of the optimisation; default 4.", 4),
    criterion: str = option(
        "WHAT", "What is optimised of the base regressor: condition (default), condition_si or logdet.", "condition"
    ),
    velocity: str | None = option(
        "V1,V2,…", "Largest joint velocities; by default the record's.", names="--max-velocity"
    ),
    acceleration: str | None = option(
        "A1,A2,…", "Largest accelerations; by default the record's.", names="--max-acceleration"
    ),
    torque: str | None = option("T1,T2,…", "Largest torques; by default the record's.", names="--max-torque"),
    floor: float | None = option("Z", "Lowest height of the tip in base axes, in m."),
    record_period: float = option("S", "Time in s from row to row; default 0.002.", 0.002),
    kinematics_only: bool = flag("--kinematics-only", "Links of the robot file may lack masses."),
    plot: Picture = None,
    seed: Seed = 0,
) -> None:
    """Design a motion that identifies a whole arm: a Fourier series from rest to rest with a small condition number.

    Limits of position, speed, acceleration, torque and voltage are the record's where no option says otherwise. Look at the
    motion before it runs: self-collision is not checked.

    \b
    Examples:
      armwright excite lwa4p -o motion.csv --plot motion.png
      armwright excite arm.urdf -o motion.csv --max-velocity 1 --cycle 20 --floor 0.1
    """
    from armwright.model.joint_signals import joint_units

    check_file(output, (".csv",))
    if not 1e-6 <= record_period <= 10.0:
        raise ScenarioError(place="--record-period", value=record_period, expected="1e-6 … 10 s")
    check_file(plot, PICTURE)
    model = aw.load(robot, kinematics_only=kinematics_only)
    given = {"velocity": ("qd", velocity), "acceleration": ("qdd", acceleration), "torque": ("tau", torque)}
    most = {
        name: vector(f"--max-{name}", text, model.names, joint_units(model, unit))
        for name, (unit, text) in given.items()
        if text is not None
    }
    box = None if floor is None else [[-float("inf"), -float("inf"), floor], [float("inf")] * 3]

    def shown(done: int, total: int) -> None:  # by the search, once its arguments are right
        if done == 0 and not sys.stderr.isatty():  # a bar would not be seen, and this may take minutes
            count = f"{total} start{'s' * (total != 1)}"
            remark(f"designing a motion of {model.name} by {count}, each of some seconds")
        tell(done, total)

    places = {"cycle": "--cycle"} | {f"limits.{name}": f"--max-{name}" for name in given}
    with (
        as_options("harmonics", "starts", "criterion", "seed", **places),
        progress(f"designing a motion of {model.name}") as tell,
    ):
        limits = aw.trajectories.MotionLimits.of(model, **most)
        found, stopped = until_stopped(lambda: aw.identification.design_excitation(
            model, limits=limits, box=box, cycle=cycle, harmonics=harmonics, criterion=criterion,  # type: ignore[arg-type]
            starts=starts, seed=seed, progress=shown,
        ))  # fmt: skip
    say(found)
    write(output, lambda path: found.save(path, 1.0 / record_period))
    write(plot, lambda path: aw.identification.plot_experiment(found, path))
    exit_if(stopped)


@excite.command()
def motor(
    robots: list[str] | None = robot_argument(
        "Robot whose record gives the first guess; without it, options give it.", None
    ),
    kind: str = argument("KIND", "step, staircase, prbs, multisine or chirp."),
    output: Path = output_option("COMMAND.csv", "The command to write.", ...),
    joint: str | None = option("NAME", "Joint of the robot; by default the first."),
    gain: float | None = option("G", "Steady speed per unit of the command, in rad/s.", names="--motor-gain"),
    time_constant: float | None = option("S", "Time constant of the motor in s."),
    most: float | None = option("U", "Largest command.", names="--max-command"),
    dead_zone: float | None = option("U", "Command below which nothing moves; default 0."),
    speed: float | None = option("W", "Largest speed in rad/s.", names="--max-speed"),
    travel: float | None = option("Q", "How far it may move to either side of where it starts, in rad."),
    period: float = option("S", "Period in s between two rows of the command; default 0.001.", 1e-3),
    unit: str | None = option("UNIT", "Unit of the command; default V."),
    plot: Picture = None,
    seed: Seed = 0,
) -> None:
    """Design the command of one motor, sized by a coarse first guess from the robot file or from options.

    \b
    Examples:
      armwright excite motor prbs -o prbs.csv --motor-gain 12 --time-constant 0.05 --max-command 12
      armwright excite motor cmu-dd staircase -o static.csv --joint joint1 --travel 1
    """
    check_file(output, (".csv",))
    check_file(plot, PICTURE)
    options = {
        "gain": gain, "time_constant": time_constant, "most": most, "dead_zone": dead_zone, "speed": speed, "travel": travel,
        "unit": unit,
    }  # fmt: skip
    given = {name: value for name, value in options.items() if value is not None}
    guess = _guess(only(robots), joint, given)
    with as_options("seed", "period"):
        found = aw.identification.motor_experiment(kind, guess, period=period, seed=seed)
    say(found)
    write(output, found.save)
    write(plot, lambda path: aw.identification.plot_experiment(found, path))


@excite.command()
def poses(
    robot: Robot,
    count: int = option("N", "Number of poses to choose.", ..., names="--poses -n"),
    point: list[str] = option("X,Y,Z", "Marker on the tool, in m in the frame; may be repeated.", ...),
    output: Path = output_option("POSES.csv", "The poses to write: one per row, a column for each joint.", ...),
    frame: str | None = option("NAME", "Frame that carries the markers; by default the tip."),
    radius: float | None = option("M", "Radius of links without shapes, for collisions."),
    clearance: float = option("M", "Least distance between links; default 0.", 0.0),
    floor: float | None = option("Z", "Height of a floor in base axes, in m, that the links stay above."),
    candidates: int = option("N", "Number of candidates: random poses from which they are chosen; default 400.", 400),
    kinematics_only: bool = flag("--kinematics-only", "Links of the robot file may lack masses."),
    plot: Picture = None,
    seed: Seed = 0,
) -> None:
    """Choose poses for a kinematic calibration: reachable, free of collisions, and with the most information on the geometry.

    \b
    Examples:
      armwright excite poses lwa4p -n 40 --point 0.1,0,0.05 -o poses.csv
      armwright excite poses arm.urdf -n 30 --point 0.1,0,0 --point 0,0.1,0.05 --floor 0 --clearance 0.02 -o poses.csv
    """
    check_file(output, (".csv",))
    check_file(plot, PICTURE)
    model = aw.load(robot, kinematics_only=kinematics_only)
    expected = "three numbers with commas between, in m"
    points = [numbers("--point", each, expected, count=3) for each in point]
    room: Any = None
    if radius is not None or floor is not None or clearance != 0.0:
        obstacles = [] if floor is None else [aw.collision.PlaneObstacle([0.0, 0.0, floor], [0.0, 0.0, 1.0], "floor")]
        with as_options("radius", least="--clearance"):
            room = aw.collision.clearance(model, obstacles, radius=radius, least=clearance)
    with as_options("candidates", "seed", "frame", count="--poses", points="--point"):
        found = aw.identification.design_poses(
            model, count, points, frame=frame, clearance=room, candidates=candidates, seed=seed
        )
    show(found)
    write(output, found.save)
    write(plot, found.plot)


def _guess(robot: str | None, joint: str | None, given: dict[str, Any]) -> MotorGuess:
    """The guess of a record with the options' values in place of its own, or of options alone."""
    try:
        if robot is not None:
            return replace(aw.identification.MotorGuess.of(aw.load(robot), joint, most=given.get("most")), **given)
        needed = [name for name in ("gain", "time_constant", "most") if name not in given]
        if needed:
            options = ", ".join(OPTION_OF_GUESS.get(name, f"--{name.replace('_', '-')}") for name in needed)
            expected = "them, or ROBOT with motor constants in its record"
            raise ScenarioError(f"no {options}", place="motor", expected=expected)
        if joint is not None:
            given["joint"] = joint
        return aw.identification.MotorGuess(**given)
    except ScenarioError as error:
        raise error.renamed(_option_of_guess) from None


def _option_of_guess(place: str) -> str:
    """The option that gives a field of a guess."""
    name = place.removeprefix("MotorGuess.")
    return OPTION_OF_GUESS.get(name, f"--{name.replace('_', '-')}") if name != place else place.replace("_", "-")

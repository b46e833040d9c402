"""`armwright identify servo`: motor and friction of a servo from logs of a bench."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from armwright.cli.arguments import argument, as_options, option, output_option, words
from armwright.cli.outcome import PAGE, TOML, check_file, exit_if, exit_unless, until_stopped, write
from armwright.cli.tables import show
from armwright.errors import ModelError
from armwright.progress import progress


def servo(
    files: list[Path] = argument("LOG.json…", "BAM's logs of one servo: any gains, masses, lengths and motions."),
    arm_mass: float | None = option("KG", "Mass of the rod, for logs that do not state it; by default 0."),
    gain: float | None = option(
        "DUTY", "Duty per radian of error and unit of P, for a servo that Armwright does not know.", names="--duty-gain"
    ),
    limit: float | None = option("DUTY", "Largest duty, with --duty-gain; by default 1.", names="--max-duty"),
    goal_speed: float | None = option("RAD_PER_S", "Speed of the goal inside the servo, with --duty-gain."),
    order: str = option("M1,…,M6", "Friction models that are compared; by default all.", "", names="--friction-models"),
    free: str = option(
        "NAME,…", "Fitted in addition to motor and friction: offset, delay, gain, goal_speed.", "offset"
    ),
    seed: int = option("N", "Seed of the first guesses; default 0.", 0),
    output: Path | None = output_option(
        "SERVO.toml", "Write the bench as a robot file, its numbers with standard deviations."
    ),
    report: Path | None = option("FILE.html", "Write a page with the numbers and a plot of every log."),
) -> None:
    """Identify a servo on a bench: torque constant, resistance, inertia, friction by load, with standard deviations.

    It simulates the pendulum from the logged goals and supply, and fits the positions. Of the friction models M1 to M6 it
    takes the smallest that predicts held-out logs no worse than the best one does. Exit code: 0 identified, 1 not
    identified, 2 bad input.

    \b
    Examples:
      armwright identify servo bench/*.json -o servo.toml --report servo.html
      armwright identify servo bench/*.json --arm-mass 0.03 --friction-models M1,M4
      armwright identify servo bench/*.json --duty-gain 0.166 --max-duty 0.97 --goal-speed 5.2 --free offset,goal_speed
    """
    check_file(output, TOML, tuple(files))
    check_file(report, PAGE, tuple(files))
    loop = None
    if gain is not None:
        loop = aw.identification.ServoLoop(gain, 1.0 if limit is None else limit, goal_speed_rad_per_s=goal_speed)
    elif limit is not None or goal_speed is not None:
        place, value = ("--max-duty", limit) if limit is not None else ("--goal-speed", goal_speed)
        raise ModelError("without --duty-gain", place=place, value=value, expected="--duty-gain beside it")
    orders = words(order) or list(aw.identification.ServoSearch().orders)
    with as_options("free", "seed", orders="--friction-models"):
        search = aw.identification.ServoSearch(orders=orders, free=words(free), seed=seed)
    with progress("fitting") as tell:
        found, stopped = until_stopped(
            lambda: aw.identification.identify_servo(files, loop, arm_mass=arm_mass, search=search, progress=tell)
        )
    show(found)
    write(output, found.write)
    write(report, found.report)
    exit_if(stopped)
    exit_unless(found.good)

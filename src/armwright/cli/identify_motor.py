"""`armwright identify motor`: parameters of motors from logs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer

import armwright as aw
from armwright.cli.arguments import (
    argument,
    as_options,
    flag,
    named_numbers,
    only,
    option,
    output_option,
    refuse,
    robot_argument,
)
from armwright.cli.identify_linear import show_linear
from armwright.cli.outcome import PAGE, TOML, check_file, end_with_nothing, exit_unless, write
from armwright.cli.tables import console_for_tables, number, show, table
from armwright.errors import Interrupted, LogError, ModelError
from armwright.progress import progress
from armwright.terminal import note

HEADS = ("number", "value")


def motor(
    robots: list[str] | None = robot_argument(
        "The arm; by default the one that the log names, else one motor on a bench.", None
    ),
    file: Path = argument("LOG.log.toml", "Log with voltage or current, and motion."),
    model: str = option(
        "KIND", "Model: dc, or a black box: arx, oe, armax, n4sid, frequency (see `identify linear`).", "dc"
    ),
    order: str = option("N", "Number of poles of a black box; auto (default): chosen from the log.", "auto"),
    delay: str = option("K", "Delay of a black box in samples; auto (default): chosen from the log.", "auto"),
    joint: str | None = option(
        "NAME",
        "Joint of the log, where it has several, for a motor on a bench; with --load or --locked, joint of the robot.",
    ),
    load: list[str] | None = option(
        "[JOINT=]INERTIA,…",
        "Motors of the robot measured without the arm, each turning this inertia behind its gear, in kg m²; 0: none.",
    ),
    locked: bool = flag("--locked", "The rotor was held: the current determines R and L."),
    free: list[str] | None = option(
        "NAME,…",
        "Numbers that are fitted: R L Kt Ke J viscous coulomb coulomb_positive coulomb_negative "
        "stribeck friction_offset efficiency "
        "dead_zone delay offset, or keys of the joint; by default all that the record has, and the delay.",
    ),
    fix: list[str] | None = option(
        "NAME=VALUE,…", "Numbers that are known, and not fitted, in the record's unit: R=1.3, limits.voltage_v=24."
    ),
    per_run: list[str] | None = option("NAME,…", "Numbers that are fitted separately for every run."),
    runs: list[str] | None = option(
        "NAME", "Runs to fit, may be repeated; by default as the log file states.", names="--run"
    ),
    static: Path | None = option("LOG.log.toml", "Log of steady states, one per row, as additional data."),
    pwm: str | None = option(
        "brake|coast|compare",
        "What the bridge does while off; compare: both are fitted, and the one with the smaller error is kept.",
    ),
    priors: bool = flag("--priors", "Use the record's values as measurements with its standard deviations."),
    starts: int | None = option("N", "Random starts of the search; default 16."),
    output: Path | None = output_option("ARM.toml", "Write the record with the fitted numbers and their deviations."),
    report: Path | None = option("FILE.html", "Write a page with the numbers and with plots of every run."),
) -> None:
    """Identify motors: resistance, torque constant, inertia, friction, delay, with standard deviations.

    It fits the free simulation of the record's drives to the log. Parameters that the log does not determine are named and
    keep the record's value. The new record and the one that it replaces are
    both judged on the runs that the log holds out. Exit code: 0
    identified, 1 not identified or worse than before, 2 bad input.

    \b
    Examples:
      armwright identify motor bench.log.toml -o motor.toml --report motor.html
      armwright identify motor bench.log.toml --model oe --order 2
      armwright identify motor bench.log.toml --fix R=1.3 --free Kt,J,coulomb,delay
      armwright identify motor arm.toml arm.log.toml -o arm_identified.toml
      armwright identify motor arm.toml elbow.log.toml --joint elbow --load 0 -o arm_identified.toml
    """
    robot = only(robots)
    if model != "dc":
        from armwright.identification.linear.choice import check_model

        check_model(model, beside=("dc",))
        beside = {"free": free, "fix": fix, "per-run": per_run, "output": output, "report": report}
        beside |= {"load": load, "locked": locked or None, "priors": priors or None}
        beside |= {"run": runs, "static": static, "pwm": pwm, "starts": starts}
        if robot is not None:
            raise LogError(f"a black box has no arm: {model}", place="ROBOT", value=robot, expected="the log alone")
        what = f"belongs to --model dc, not to a black box: {model}"
        refuse(beside, what, error=LogError, expected="one of the two")
        return show_linear(file, model, aw.identification.LogSignals(joint=joint), order=order, delay=delay)

    black_box = {name: None if value == "auto" else value for name, value in (("order", order), ("delay", delay))}
    refuse(black_box, "belongs to a black box, not to --model dc", error=LogError, expected="one of the two")
    check_file(output, TOML, (file, robot, static))
    check_file(report, PAGE, (file, robot, static))
    mode: Any = pwm
    with as_options("pwm"):
        search = aw.identification.MotorSearch(
            per_run=_names(per_run) or (), pwm=mode, priors=priors, starts=16 if starts is None else starts
        )
    with progress("fitting") as tell, _numbers_if_stopped():
        found = aw.identification.identify_motor(
            file,
            robot,
            joint=joint,
            load=_load(load),
            locked=locked,
            free=_names(free),
            fixed=_values(fix),
            reading=aw.identification.MotorReading(runs=_names(runs), static=static),
            search=search,
            progress=tell,
        )
    show(found)
    write(output, found.write)
    write(report, found.report)
    exit_unless(found.estimate.verdict == "identified")


@contextmanager
def _numbers_if_stopped() -> Iterator[None]:
    """After Ctrl-C, shows the numbers of the unfinished fit, which is not written, and ends with exit code 130."""
    try:
        yield
    except Interrupted as stop:
        if stop.found is None:
            raise end_with_nothing() from None
        note(f"stopped by Ctrl-C {stop}; this fit is not finished: no deviations, no verdict, nothing is written")
        rows = [[name, number(value)] for name, value in stop.found.items()]
        console_for_tables().print(table("numbers so far", HEADS, rows, HEADS[:1]))
        raise typer.Exit(130) from None
    except KeyboardInterrupt:
        raise end_with_nothing() from None


def _names(words: list[str] | None) -> list[str] | None:
    """Names from words with commas, of an option that may be repeated."""
    return None if words is None else [name for word in words for name in word.split(",") if name]


def _values(words: list[str] | None, place: str = "--fix", example: str = "R=1.3") -> dict[str, float]:
    """Names and numbers from words such as "R=1.3"."""
    return named_numbers(place, _names(words) or [], f"NAME=VALUE, such as {example}", ModelError)


def _load(words: list[str] | None) -> float | dict[str, float] | None:
    """One inertia, or inertias by joint."""
    if words is None or any("=" in word for word in words):
        return None if words is None else _values(words, "--load", "elbow=0.02")
    try:
        return float(words[-1])
    except ValueError:
        raise ModelError(place="--load", value=words[-1], expected="an inertia, or JOINT=INERTIA,…") from None

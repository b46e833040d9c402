"""`armwright identify motor`: parameters of motors from logs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from armwright.cli.arguments import option
from armwright.cli.identify_linear import show_linear
from armwright.cli.tables import show
from armwright.terminal import say

NOT_IDENTIFIED = 1  # exit code


def motor(
    file: Annotated[
        Path, typer.Argument(metavar="LOG.log.toml", help="Voltage or current, and motion.", show_default=False)
    ],
    model: Annotated[
        str, option("--model", "KIND", "dc, or a black box: arx, oe, armax, n4sid, frequency (see `identify linear`).")
    ] = "dc",
    order: Annotated[str, option("--order", "N", "Number of poles of a black box; auto: chosen.")] = "auto",
    delay: Annotated[str, option("--delay", "K", "Samples of delay of a black box; auto: chosen.")] = "auto",
    robot: Annotated[
        str | None, option("--robot", "ROBOT", "The arm; by default the log's, or one motor on a bench.")
    ] = None,
    joint: Annotated[
        str | None, option("--joint", "NAME", "One motor by itself; of a robot's joint beside --load or --locked.")
    ] = None,
    load: Annotated[
        list[str] | None,
        option(
            "--load",
            "INERTIA | JOINT=INERTIA,…",
            "Motors of the robot moved by themselves, each turning this inertia behind its gear, in kg m²; 0: none.",
        ),
    ] = None,
    locked: Annotated[
        bool, typer.Option("--locked", help="The rotor was held: the current tells R and L.", show_default=False)
    ] = False,
    free: Annotated[
        list[str] | None,
        option(
            "--free",
            "NAME,…",
            "Fitted: R L Kt Ke J viscous coulomb coulomb_positive coulomb_negative stribeck friction_offset efficiency "
            "dead_zone delay offset, or keys of the joint; by default all that the record has, and the delay.",
        ),
    ] = None,
    fix: Annotated[
        list[str] | None, option("--fix", "NAME=VALUE,…", "Known, in the record's unit: R=1.3, limits.voltage_v=24.")
    ] = None,
    per_run: Annotated[list[str] | None, option("--per-run", "NAME,…", "Fitted for every run by itself.")] = None,
    runs: Annotated[
        list[str] | None, option("--run", "NAME,…", "Runs to fit; by default those that the log says.")
    ] = None,
    static: Annotated[
        Path | None, option("--static", "LOG.log.toml", "Steady states, a row each, as additional data.")
    ] = None,
    pwm: Annotated[
        str | None, option("--pwm", "brake|coast|compare", "What the bridge does while off; compare: by the fit.")
    ] = None,
    priors: Annotated[
        bool,
        typer.Option(
            "--priors", help="The record's own standard deviations count as measurements.", show_default=False
        ),
    ] = False,
    starts: Annotated[int, option("--starts", "N", "First guesses; 16 by default.")] = 16,
    output: Annotated[
        Path | None, option("--output -o", "ARM.toml", "Write the record with the fitted numbers and their deviations.")
    ] = None,
    report: Annotated[
        Path | None, option("--report", "FILE.html", "Write a page with the numbers and with plots of every run.")
    ] = None,
) -> None:
    """Identify motors: resistance, torque constant, inertia, friction, delay, with standard deviations.

    It fits the free simulation of the record's drives to the log. Parameters that the log does not determine are named and
    keep the record's value. Runs that the log holds out judge the record, beside the one that it replaces. Exit code: 0
    identified, 1 not identified or worse than before, 2 bad input.

    \b
    Examples:
      armwright identify motor bench.log.toml -o motor.toml --report motor.html
      armwright identify motor bench.log.toml --model oe --order 2
      armwright identify motor bench.log.toml --fix R=1.3 --free Kt,J,coulomb,delay
      armwright identify motor arm.log.toml --robot arm.toml -o arm_identified.toml
      armwright identify motor elbow.log.toml --robot arm.toml --joint elbow --load 0 -o arm_identified.toml
    """
    import armwright as aw

    if model != "dc":
        beside = {"--robot": robot, "--free": free, "--fix": fix, "--per-run": per_run, "--output": output}
        beside |= {"--report": report, "--load": load, "--locked": locked, "--priors": priors}
        _refuse_beside(model, beside)
        return show_linear(file, model, aw.identification.LogSignals(joint=joint), order=order, delay=delay)
    from armwright.cli.progress import progress
    from armwright.output import check_destination

    if output is not None:
        check_destination(output, (".toml",), read=(file, robot, static))
    if report is not None:
        check_destination(report, (".html",), read=(file, robot, static))
    with progress("fitting") as tell:
        found = aw.identification.identify_motor(
            file,
            robot,
            joint=joint,
            load=_load(load),
            locked=locked,
            free=_names(free),
            fixed=_values(fix),
            reading=aw.identification.MotorReading(runs=_names(runs), static=static),
            search=aw.identification.MotorSearch(
                per_run=_names(per_run) or (), pwm=_pwm(pwm), priors=priors, starts=starts
            ),
            progress=tell,
        )
    show(found)
    if output is not None:
        found.write(output)
        say(f"wrote {output}")
    if report is not None:
        say(f"wrote {found.report(report)}")
    if found.estimate.verdict != "identified":
        raise typer.Exit(NOT_IDENTIFIED)


def _refuse_beside(model: str, options: dict[str, object]) -> None:
    """Refuses options of a motor's record beside a black box, which has none.

    Raises:
        LogError: names the first.
    """
    from armwright.errors import LogError

    for name, value in options.items():
        if value:
            raise LogError(f"belongs to --model dc, not to a black box: {model}", place=name, expected="one of the two")


def _names(words: list[str] | None) -> list[str] | None:
    """Names from words with commas, of an option that may be repeated."""
    return None if words is None else [name for word in words for name in word.split(",") if name]


def _values(words: list[str] | None, place: str = "--fix", example: str = "R=1.3") -> dict[str, float]:
    """Names and numbers from words such as "R=1.3"."""
    from armwright.errors import ModelError

    found = {}
    for word in _names(words) or []:
        name, _, text = word.partition("=")
        try:
            found[name] = float(text)
        except ValueError:
            raise ModelError(place=place, value=word, expected=f"NAME=VALUE, such as {example}") from None
    return found


def _load(words: list[str] | None) -> float | dict[str, float] | None:
    """One inertia, or inertias by joint."""
    from armwright.errors import ModelError

    if words is None or any("=" in word for word in words):
        return None if words is None else _values(words, "--load", "elbow=0.02")
    try:
        return float(words[-1])
    except ValueError:
        raise ModelError(place="--load", value=words[-1], expected="an inertia, or JOINT=INERTIA,…") from None


def _pwm(word: str | None) -> Literal["brake", "coast", "compare"] | None:
    from armwright.errors import ModelError

    if word in (None, "brake", "coast", "compare"):
        return word  # type: ignore[return-value]
    raise ModelError(place="--pwm", value=word, choices=("brake", "coast", "compare"))

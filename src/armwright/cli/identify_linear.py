"""`armwright identify linear`: black-box models of a motor or a joint."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armwright.cli.arguments import option
from armwright.terminal import say

if TYPE_CHECKING:
    from armwright.identification import LogSignals

NOT_IDENTIFIED = 1  # exit code


def linear(
    file: Annotated[
        Path, typer.Argument(metavar="LOG.log.toml", help="Runs to fit and to hold out.", show_default=False)
    ],
    model: Annotated[str, option("--model", "KIND", "arx, oe, armax, n4sid or frequency.")] = "oe",
    order: Annotated[str, option("--order", "N", "Number of poles; auto: chosen.")] = "auto",
    delay: Annotated[str, option("--delay", "K", "Samples from input to output; auto: chosen.")] = "auto",
    select: Annotated[str, option("--select", "CRITERION", "What chooses: cv, aic, bic, fpe or mdl.")] = "cv",
    input: Annotated[str | None, option("--input", "SIGNAL", "By default the voltage, current or torque.")] = None,
    output: Annotated[str | None, option("--output", "SIGNAL", "By default the speed or the position.")] = None,
    joint: Annotated[str | None, option("--joint", "NAME", "Needed where the log has several.")] = None,
    picture: Annotated[
        Path | None,
        option("--plot", "FILE", "Draw runs and frequency response, measured and of the model: .png, .svg or .pdf."),
    ] = None,
    report: Annotated[
        Path | None, option("--report", "FILE.html", "Write a page: verdict, remarks, gain, time constants, fits.")
    ] = None,
) -> None:
    """Fit a black-box model (ARX, OE, ARMAX or state space) from an input of a log to an output.

    The fit in percent is that of the free simulation, on the fitted and on the held-out runs. Exit code: 0 identified,
    1 the output does not depend on the input, 2 bad input.

    \b
    Examples:
      armwright identify linear motor.log.toml
      armwright identify linear motor.log.toml --model n4sid --order 2 --plot motor.png
      armwright identify linear arm.log.toml --joint elbow --input tau --output qd --model frequency
    """
    import armwright as aw

    signals = aw.identification.LogSignals(input, output, joint)
    show_linear(file, model, signals, order=order, delay=delay, select=select, picture=picture, report=report)


def show_linear(
    file: Path,
    model: str,
    signals: LogSignals,
    *,
    order: str = "auto",
    delay: str = "auto",
    select: str = "cv",
    picture: Path | None = None,
    report: Path | None = None,
) -> None:
    """Fits a black-box model and shows it; shared by all commands with that option.

    Raises:
        LogError: no such model, or a report of a frequency response, which has no parameters.
    """
    import armwright as aw
    from armwright.errors import LogError
    from armwright.identification.linear.choice import check_model, fit_linear
    from armwright.identification.linear.plot import plot_linear
    from armwright.output import check_destination
    from armwright.results.plot import check_picture

    check_model(model)
    if report is not None:
        if model == "frequency":
            raise LogError(
                "a frequency response has no parameters", place="--report", expected="another --model, or --plot"
            )
        check_destination(report, (".html",))
    if picture is not None:
        check_picture(picture)
    log = aw.identification.read_log(file)
    found = fit_linear(log, model, signals, order=order, delay=delay, select=select)
    say(found)
    if picture is not None:
        plot_linear(log, found, picture, signals.joint)
        say(f"wrote {picture}")
    if report is not None and isinstance(found, aw.identification.LinearModel):
        found.report(report)
        say(f"wrote {report}")
    if isinstance(found, aw.identification.LinearModel) and found.verdict != "identified":
        raise typer.Exit(NOT_IDENTIFIED)

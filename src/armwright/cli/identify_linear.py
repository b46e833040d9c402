"""`armwright identify linear`: black-box models of a motor or a joint."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import armwright as aw
from armwright.cli.arguments import argument, option
from armwright.cli.outcome import PAGE, PICTURE, check_file, exit_if, exit_unless, until_stopped, write
from armwright.errors import LogError
from armwright.terminal import say

if TYPE_CHECKING:
    from armwright.identification import LogSignals


def linear(
    file: Path = argument("LOG.log.toml", "Log with the runs to fit and the runs held out."),
    model: str = option("KIND", "Model: arx, oe (default), armax, n4sid or frequency.", "oe"),
    order: str = option("N", "Number of poles; auto (default): chosen from the log.", "auto"),
    delay: str = option("K", "Delay from input to output in samples; auto (default): chosen from the log.", "auto"),
    select: str = option(
        "CRITERION", "Criterion that chooses order and delay: cv (default), aic, bic, fpe or mdl.", "cv"
    ),
    input: str | None = option(
        "SIGNAL", "Input of the model; by default the voltage, current or torque.", names="--input-signal"
    ),
    output: str | None = option(
        "SIGNAL", "Output of the model; by default the speed or the position.", names="--output-signal"
    ),
    joint: str | None = option("NAME", "Joint of the log; needed where it has several."),
    picture: Path | None = option(
        "FILE", "Draw runs and frequency response, measured and of the model: .png, .svg or .pdf.", names="--plot"
    ),
    report: Path | None = option("FILE.html", "Write a page: verdict, remarks, gain, time constants, fits."),
) -> None:
    """Fit a black-box model (ARX, OE, ARMAX or state space) from an input of a log to an output.

    The fit in percent compares the free simulation with the log, on the fitted and on the held-out runs. Exit code: 0 identified,
    1 the output does not depend on the input, 2 bad input, 130 Ctrl-C: the best of the orders that were tried is kept.

    \b
    Examples:
      armwright identify linear motor.log.toml
      armwright identify linear motor.log.toml --model n4sid --order 2 --plot motor.png
      armwright identify linear arm.log.toml --joint elbow --input-signal tau --output-signal qd --model frequency
    """
    signals = aw.identification.LogSignals(input, output, joint)
    show_linear(file, model, signals, order=order, delay=delay, select=select, picture=picture, report=report)


def show_linear(
    file: Path,
    model: str,
    signals: LogSignals,
    *,
    picture: Path | None = None,
    report: Path | None = None,
    **options: Any,
) -> None:
    """Fits a black-box model and shows it; shared by all commands with that option.

    Args:
        file: the log.   model: its kind.   signals: of the log.   picture, report: files to write.
        options: of `fit_linear`.
    Raises:
        LogError: no such model, or a report of a frequency response, which has no parameters.
    """
    from armwright.identification.linear.choice import check_model, fit_linear
    from armwright.identification.linear.plot import plot_linear

    check_model(model)
    if report is not None and model == "frequency":
        what = "a frequency response has no parameters"
        raise LogError(what, place="--report", expected="another --model, or --plot")
    check_file(report, PAGE)
    check_file(picture, PICTURE)
    log = aw.identification.read_log(file)
    found, stopped = until_stopped(lambda: fit_linear(log, model, signals, **options))
    say(found)
    write(picture, lambda path: plot_linear(log, found, path, signals.joint))
    if isinstance(found, aw.identification.LinearModel):
        write(report, found.report)
        exit_if(stopped)
        exit_unless(found.verdict == "identified")

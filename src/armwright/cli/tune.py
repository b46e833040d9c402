"""`armwright tune`: a scenario's controller with gains that track better over uncertain arms, and keep the margins."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armwright.cli.arguments import SCENARIO, Allow, option
from armwright.cli.tables import console_for_tables, table
from armwright.errors import ScenarioError
from armwright.terminal import say

if TYPE_CHECKING:
    from armwright.tuning.result import TuningResult

SAME = 1  # the exit code where nothing better than the start was found
JUDGED = ("joint", "measure", "start", "tuned")


def tune(
    scenario: Annotated[
        Path, typer.Argument(metavar="FILE.scenario.toml", help="A scenario with a controller.", show_default=False)
    ],
    out: Annotated[Path, option("--output -o", f"TUNED{SCENARIO}", "The scenario with the tuned gains.")],
    gain: Annotated[
        list[str] | None,
        option("--gain", "NAME=F|LOW:HIGH", "A gain to tune, within a factor or bounds; default: all, within 10."),
    ] = None,
    objective: Annotated[
        list[str] | None,
        option("--objective", "NAME=WEIGHT", "A reducer that counts; default rms_error=1 and saturation=1."),
    ] = None,
    limit: Annotated[
        list[str] | None, option("--limit", "NAME=VALUE", "A peak that no run should pass, such as peak_torque=40.")
    ] = None,
    worst: Annotated[bool, typer.Option("--worst", help="The worst lane counts, not the mean.")] = False,
    lanes: Annotated[
        int, option("--lanes", "N", "Of a scenario that has one; half judge the result; default 64.")
    ] = 64,
    generations: Annotated[int, option("--generations", "N", "Of the search; default 30.")] = 30,
    candidates: Annotated[int | None, option("--candidates", "N", "In each; default 4 + 3 ln of the gains.")] = None,
    gain_margin: Annotated[float, option("--gain-margin", "G", "Factor of a command to bear; default 2.")] = 2.0,
    phase_margin: Annotated[float, option("--phase-margin", "DEG", "Phase lag to bear, degrees; default 30.")] = 30.0,
    report: Annotated[Path | None, option("--report", "FILE.html", "Write all of it as a page.")] = None,
    seed: Annotated[int, option("--seed", "N", "Of search, poses and draws; default 0.")] = 0,
    allow: Allow = None,
) -> None:
    """Tune a controller's gains over uncertain arms, by compiled simulations, under a margin constraint.

    A scenario without lanes gets masses within ±30 % and friction within a factor of two. Half of the lanes judge the result.
    Exit code: 0 better gains were found and written, 1 none were and nothing was written, 2 bad input.

    \b
    Examples:
      armwright tune arm.scenario.toml -o tuned.scenario.toml
      armwright tune arm.scenario.toml -o tuned.scenario.toml --gain position_kp=2:40 --gain speed_kp=5 --report tuned.html
    """
    import math

    import armwright as aw
    from armwright.cli.progress import progress
    from armwright.output import check_destination
    from armwright.tuning.result import HEADS

    check_destination(out, (".toml",), read=(scenario,))
    if report is not None:
        check_destination(report, (".html",), read=(scenario, out))
    found = aw.read_scenario(scenario, allow=allow or ())
    gains, objectives, limits = (
        _pairs("--gain", gain, bounds=True),
        _pairs("--objective", objective),
        _pairs("--limit", limit),
    )
    with progress(f"tuning {scenario.name}") as shown:
        result = aw.tune(
            found,
            gains,
            objectives=objectives,
            limits=limits,
            over="worst" if worst else "mean",
            lanes=lanes,
            generations=generations,
            candidates=candidates,
            gain_margin=gain_margin,
            phase_margin=math.radians(phase_margin),
            seed=seed,
            progress=shown,
        )
    better = result.improved or not result.start_keeps
    if better:
        result.save(out, scenario, tuple(allow or ()))
    screen = console_for_tables()
    screen.print(table(f"{found.arm.name}: gains", HEADS, result.rows()))
    screen.print(table(f"{found.arm.name}: means over {result.lanes[1]} held-out lanes", JUDGED, result.judged()))
    say("")
    for sentence in result.sentences():
        say(sentence)
    if report is not None:
        _report(report, scenario.name, result)
        say(f"wrote {report}")
    if not better:
        raise typer.Exit(SAME)
    say(f"wrote {out}")


def _pairs(place: str, texts: list[str] | None, bounds: bool = False) -> dict[str, Any] | None:
    """`["kp=10", "kd=2:40"]` as {"kp": 10.0, "kd": (2.0, 40.0)}; None of None."""
    if texts is None:
        return None
    found: dict[str, Any] = {}
    expected = "NAME=FACTOR or NAME=LOW:HIGH" if bounds else "NAME=NUMBER"
    for text in texts:
        name, equals, value = text.rpartition("=")  # a reducer's own option has an = too: settling_time:band=0.05=1
        try:
            numbers = tuple(float(part) for part in value.split(":"))
        except ValueError:
            numbers = ()
        if not name or not equals or len(numbers) not in ((1, 2) if bounds else (1,)):
            raise ScenarioError(place=place, value=text, expected=expected)
        if name in found:
            raise ScenarioError("given twice", place=place, value=name, expected="once")
        found[name] = numbers[0] if len(numbers) == 1 else numbers
    return found


def _report(path: Path, title: str, result: TuningResult) -> None:
    from html import escape

    from armwright.identification.validation.pictures import INK, page_svg
    from armwright.identification.validation.report import html_table, write_report
    from armwright.tuning.result import HEADS

    first, *others = result.sentences()
    good = " good" if result.improved else ""
    words = "".join(f"<li>{escape(each)}</li>" for each in others)
    gains, judged = ([[escape(cell) for cell in row] for row in rows] for rows in (result.rows(), result.judged()))

    def history(figure: Any) -> None:
        axes = figure.subplots()
        axes.plot(result.history, color=INK, drawstyle="steps-post")
        axes.set_facecolor("none")
        axes.set_xlabel("generation", color=INK)
        axes.set_ylabel("best score on the tuned lanes", color=INK)
        axes.tick_params(colors=INK)
        for edge in axes.spines.values():
            edge.set_color(INK)

    svg = page_svg(history, (9.2, 3.2), "constrained")
    sections = [
        ("Verdict", f'<p class="verdict{good}">{escape(first)}</p><ul>{words}</ul>'),
        ("Gains", html_table(HEADS, gains, (0, 1))),
        ("Held-out lanes", f"<p>Means over lanes that were not tuned in.</p>{html_table(JUDGED, judged, (0, 1))}"),
        ("Search", svg),
    ]
    write_report(path, title, sections=sections)

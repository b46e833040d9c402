"""`armwright loops`: stability, margins and the lowest sampling rate of a sampled loop over the workspace."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armwright.cli.arguments import SCENARIO, Allow, option
from armwright.cli.tables import console_for_tables, table
from armwright.errors import ScenarioError
from armwright.terminal import result, say

if TYPE_CHECKING:
    from armwright.control.analysis.analyse import LoopAnalysis
    from armwright.control.analysis.regions import GainRegion

FAILS = 1  # the exit code where the loop does not keep its margins
PICTURES = (".png", ".svg", ".pdf")
DELAYS = (0.0, 1.0, 2.0)  # periods beside the loop's own delay that gain regions are drawn for
POSES, GRID, SPAN = (
    12,
    32,
    15.0,
)  # of a region: poses, values of each gain, and how far they go to either side of its own


def loops(
    scenario: Annotated[
        Path, typer.Argument(metavar="FILE.scenario.toml", help="A scenario with a controller.", show_default=False)
    ],
    poses: Annotated[
        int, option("--poses", "N", "Poses to draw within the position limits; default 100000.")
    ] = 100_000,
    gain_margin: Annotated[float, option("--gain-margin", "G", "Factor of a command to bear; default 2.")] = 2.0,
    phase_margin: Annotated[float, option("--phase-margin", "DEG", "Phase lag to bear, degrees; default 30.")] = 30.0,
    plot: Annotated[
        Path | None, option("--plot", "FILE", "Draw which gains keep the margins: .png, .svg or .pdf.")
    ] = None,
    report: Annotated[Path | None, option("--report", "FILE.html", "Write all of it as a page.")] = None,
    out: Annotated[
        Path | None, option("--output -o", f"OUT{SCENARIO}", "Write the scenario with what would keep the margins.")
    ] = None,
    change: Annotated[
        str | None, option("--change", "gains|period", "Of -o: slower gains, the default, or a shorter period.")
    ] = None,
    seed: Annotated[int, option("--seed", "N", "Of the poses; default 0.")] = 0,
    allow: Allow = None,
) -> None:
    """Analyse sampled loops over the workspace: margins, lowest sampling rate, gain regions.

    Where it does not keep the margins, slower gains and a shorter period that do are looked for;
    -o writes the scenario with them.
    Exit code: 0 the coupled loop keeps the margins at all analysed poses, 1 it does not, 2 bad input.

    \b
    Examples:
      armwright loops arm.scenario.toml
      armwright loops arm.scenario.toml --phase-margin 45 --report loops.html
      armwright loops arm.scenario.toml -o slower.scenario.toml
    """
    import math

    import armwright as aw
    from armwright.cli.progress import progress
    from armwright.output import check_destination

    for path, endings in ((plot, PICTURES), (report, (".html",))):
        if path is not None:
            check_destination(path, endings, read=(scenario,))
    _check_change(out, change)
    if out is not None:
        check_destination(out, (".toml",), read=(scenario,))
    found = aw.read_scenario(scenario, allow=allow or ())
    with progress(f"loops of {scenario.name}"):
        analysis = aw.loops.analyse_loops(
            found, poses, seed=seed, gain_margin=gain_margin, phase_margin=math.radians(phase_margin)
        )
        regions, delays = _regions(found, analysis) if plot is not None or report is not None else ([], [])
        remedies = [] if analysis.keeps_margins else analysis.remedies.sentences()
    console_for_tables().print(table(f"{found.arm.name}: loops over {poses} poses", analysis.heads(), analysis.rows()))
    result(analysis)
    say("")
    for sentence in (*analysis.sentences(), *remedies):
        say(sentence)
    if out is not None:
        _write(found, analysis, out, change or "gains", allow or ())
    if plot is not None:
        _draw(plot, regions, delays)
        say(f"wrote {plot}")
    if report is not None:
        _report(report, scenario.name, analysis, regions, delays)
        say(f"wrote {report}")
    if not analysis.keeps_margins:
        raise typer.Exit(FAILS)


def _check_change(out: Path | None, change: str | None) -> None:
    """Refuses --change without -o, and what cannot be changed.

    Raises:
        ScenarioError: says which.
    """
    if change is not None and out is None:
        raise ScenarioError("goes with -o", place="--change", value=change, expected="both")
    if change not in (None, "gains", "period"):
        raise ScenarioError("unknown", place="--change", value=change, choices=("gains", "period"))


def _write(scenario: Any, analysis: LoopAnalysis, out: Path, change: str, allow: Any) -> None:
    """Writes the scenario with slower gains or a shorter period, where it needs them and there are some."""
    import armwright as aw

    if analysis.keeps_margins:
        say(f"the loop keeps its margins as it is: {out} is not written")
        return
    remedies = analysis.remedies
    changed = remedies.slower if change == "gains" else remedies.faster
    if changed is None:
        say(f"no {'slower gains' if change == 'gains' else 'shorter period'} found: {out} is not written")
        return
    comments = [f"armwright loops: {line}" for line in remedies.sentences()[: 1 if change == "gains" else None][-1:]]
    for path in aw.write_scenario(changed, out, allow=allow, comments=comments):
        say(f"wrote {path}")


def _regions(scenario: Any, analysis: LoopAnalysis) -> tuple[list[list[GainRegion]], list[float]]:
    """For each joint its gain regions with the loop's own delay and longer ones; none of a controller without two gains."""
    from dataclasses import replace

    import numpy as np

    from armwright import scalar
    from armwright.control.analysis.regions import gain_region, usual_gains

    control, period = scenario.loop.controller, analysis.loop.period
    names = usual_gains(control)
    regions: list[list[GainRegion]] = []
    if names is None:
        return regions, []
    gain, phase = analysis.asked
    for joint, name in enumerate(analysis.loop.names):
        own = [np.broadcast_to(scalar.real_numbers(getattr(control, each)), (scenario.arm.n,))[joint] for each in names]
        grid = {each: np.geomspace(v / SPAN, v * SPAN, GRID) for each, v in zip(names, own, strict=True)}
        regions.append([])
        for more in DELAYS:
            timing = replace(
                scenario.loop.timing, command_delay=np.asarray(scenario.loop.timing.command_delay) + more * period
            )
            late = replace(scenario, loop=replace(scenario.loop, timing=timing))
            q = analysis.extreme_poses(joint)
            regions[-1].append(gain_region(late, name, grid, q, gain_margin=gain, phase_margin=phase))
    return regions, [analysis.loop.delay + more * period for more in DELAYS]


def _draw(path: Path, regions: list[list[GainRegion]], delays: list[float]) -> None:
    from matplotlib.figure import Figure

    from armwright.output import whole_file
    from armwright.pictures.gain_regions import draw_regions
    from armwright.results.plot import save_figure

    rows = -(-len(regions) // 3)
    figure = Figure(figsize=(10.0, 0.8 + 3.0 * max(rows, 1)), dpi=150, layout="constrained", facecolor="white")
    draw_regions(figure, regions, delays, "#222222")
    with whole_file(path, PICTURES) as temporary:
        save_figure(figure, temporary, path.suffix[1:].lower())


def _report(
    path: Path, title: str, analysis: LoopAnalysis, regions: list[list[GainRegion]], delays: list[float]
) -> None:
    from html import escape

    from armwright.identification.validation.pictures import INK, page_svg
    from armwright.identification.validation.report import html_table, sentence, write_report
    from armwright.pictures.gain_regions import draw_regions

    good = " good" if analysis.keeps_margins else ""
    verdict = "keeps its margins" if analysis.keeps_margins else "does not keep its margins"
    words = "".join(f"<li>{escape(sentence(each))}</li>" for each in analysis.sentences())
    rows = [[escape(cell) for cell in row] for row in analysis.rows()]
    sections = [
        ("Verdict", f'<p class="verdict{good}">The loop {verdict}</p><ul>{words}</ul>'),
        ("Every joint", html_table(analysis.heads(), rows, (0,))),
    ]
    if regions:
        height = 0.8 + 3.0 * -(-len(regions) // 3)
        svg = page_svg(lambda figure: draw_regions(figure, regions, delays, INK), (9.2, height), "constrained")
        gain, phase = analysis.asked
        about = (
            f"Gains that keep a gain margin of {gain:g} and a phase margin of {phase * 57.29578:.3g}° where a "
            "joint's inertia and gravity are extreme, the other joints held still. A longer delay leaves less."
        )
        sections.append(("Gain regions", f'<p>{about}</p><div class="plot">{svg}</div>'))
    write_report(path, title, sections=sections)

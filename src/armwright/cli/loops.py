"""`armwright loops`: stability, margins and the lowest sampling rate of a sampled loop over the workspace."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armwright.cli.arguments import SCENARIO, Allow, option
from armwright.cli.tables import show
from armwright.errors import ScenarioError
from armwright.terminal import say

if TYPE_CHECKING:
    from armwright.control.analysis.analyse import LoopAnalysis

FAILS = 1  # the exit code where the loop does not keep its margins


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
    from armwright.results.plot import PICTURES

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
        remedies = [] if analysis.keeps_margins else analysis.remedies.sentences()
    show(analysis)
    for sentence in remedies:
        say(sentence)
    if out is not None:
        _write(found, analysis, out, change or "gains", allow or ())
    if plot is not None:
        analysis.plot(plot)
        say(f"wrote {plot}")
    if report is not None:
        say(f"wrote {analysis.report(report)}")
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

"""`armwright loops`: stability, margins and the lowest sampling rate of a sampled loop over the workspace."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import armwright as aw
from armwright.cli.arguments import Allow, AnyScenario, PhaseMargin, angle, option, output_option
from armwright.cli.outcome import PAGE, PICTURE, TOML, check_file, exit_if, exit_unless, say_each, until_stopped, write
from armwright.cli.tables import show
from armwright.errors import Interrupted, ScenarioError
from armwright.progress import progress
from armwright.terminal import say

if TYPE_CHECKING:
    from armwright.control.analysis.analyse import LoopAnalysis


def loops(
    scenario: AnyScenario,
    poses: int = option("N", "Poses to draw within the position limits; default 100000.", 100_000),
    gain_margin: float = option("G", "Gain margin to keep, a factor; default 2.", 2.0),
    phase_margin: PhaseMargin = "30deg",
    plot: Path | None = option("FILE", "Draw the region of gains that keep the margins: .png, .svg or .pdf."),
    report: Path | None = option("FILE.html", "Write a page with all results."),
    out: Path | None = output_option("SCENARIO", "Write the scenario with the change that keeps the margins."),
    change: str | None = option("gains|period", "Of -o: slower gains, the default, or a shorter period."),
    seed: int = option("N", "Seed of the poses; default 0.", 0),
    allow: Allow = None,
) -> None:
    """Analyse sampled loops over the workspace: margins, lowest sampling rate, gain regions.

    Where it does not keep the margins, slower gains and a shorter period that do are looked for;
    -o writes the scenario with them.
    Exit code: 0 the coupled loop keeps the margins at all analysed poses, 1 it does not, 2 bad input, 130 Ctrl-C: an
    analysis that is complete is shown, and no file is written.

    \b
    Examples:
      armwright loops arm.scenario.toml
      armwright loops arm.scenario.toml --phase-margin 45deg --report loops.html
      armwright loops arm.scenario.toml -o slower.scenario.toml
    """
    check_file(plot, PICTURE, (scenario,))
    check_file(report, PAGE, (scenario,))
    if change is not None and out is None:
        raise ScenarioError("goes with -o", place="--change", value=change, expected="both")
    if change not in (None, "gains", "period"):
        raise ScenarioError("unknown", place="--change", value=change, choices=("gains", "period"))
    check_file(out, TOML, (scenario,))
    found = aw.read_scenario(scenario, allow=allow or ())
    with progress(f"loops of {scenario.name}") as tell:
        analysis, _ = until_stopped(
            lambda: aw.loops.analyse_loops(
                found, poses, seed=seed, gain_margin=gain_margin, phase_margin=angle("--phase-margin", phase_margin),
                progress=tell,
            )
        )  # fmt: skip
    with progress("what would keep the margins"):
        remedies, stopped = until_stopped(lambda: _remedies(analysis))
    show(analysis)
    say_each("", remedies)
    exit_if(stopped)
    if out is not None:
        _write(found, analysis, out, change or "gains", allow or ())
    write(plot, analysis.plot)
    write(report, analysis.report)
    exit_unless(analysis.keeps_margins)


def _remedies(analysis: LoopAnalysis) -> list[str]:
    """Changes that would keep the margins, in words; none for a loop that keeps them.

    Raises:
        Interrupted: Ctrl-C; the analysis stands.
    """
    try:
        return [] if analysis.keeps_margins else analysis.remedies.sentences()
    except KeyboardInterrupt:
        stopped = "before slower gains and a shorter period were found; no file is written"
        raise Interrupted(stopped, found=[]) from None


def _write(scenario: Any, analysis: LoopAnalysis, out: Path, change: str, allow: Any) -> None:
    """Writes the scenario with slower gains or a shorter period, where it needs them and there are some."""
    if analysis.keeps_margins:
        say(f"the loop keeps its margins as it is: {out} is not written")
        return
    remedies = analysis.remedies
    changed = remedies.slower if change == "gains" else remedies.faster
    if changed is None:
        say(f"no {'slower gains' if change == 'gains' else 'shorter period'} found: {out} is not written")
        return
    comments = [f"armwright loops: {line}" for line in remedies.sentences()[: 1 if change == "gains" else None][-1:]]
    say_each("wrote ", aw.write_scenario(changed, out, allow=allow, comments=comments))

"""`armwright tune`: gains that track better over uncertain arms and keep the margins."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import armwright as aw
from armwright.cli.arguments import Allow, AnyScenario, angle, flag, option, output_option
from armwright.cli.outcome import PAGE, PICTURE, TOML, check_file, exit_if, exit_unless, until_stopped, write
from armwright.cli.tables import show
from armwright.errors import ScenarioError
from armwright.progress import progress
from armwright.terminal import say


def tune(
    scenario: AnyScenario,
    out: Path = output_option("SCENARIO", "The scenario with the tuned gains.", ...),
    start: str | None = option(
        "METHOD", "Gains to begin with: scenario (its own), analytic, or a method of design.", names="--start-gains"
    ),
    gain: list[str] | None = option(
        "NAME=F|LOW:HIGH", "A gain to tune, within a factor or bounds; default: all, within 10."
    ),
    objective: list[str] | None = option(
        "NAME=WEIGHT", "What counts: a reducer, noise_gain or sensitivity; default rms_error=1 and saturation=1."
    ),
    limit: list[str] | None = option("NAME=VALUE", "What no run should go beyond, such as peak_torque=40."),
    improve_each: bool | None = flag("--improve-each", "No objective may get worse.", None),
    worst: bool | None = flag("--worst", "The worst lane counts, not the mean.", None),
    lanes: int | None = option("N", "Lanes of a scenario that has one; half judge the result; default 64."),
    method: str | None = option("NAME", "Method: cma (default) or differential-evolution."),
    generations: int | None = option("N", "Generations of the search; default 30."),
    candidates: int | None = option("N", "Candidates in each generation; default 4 + 3 ln of the gains."),
    front: int | None = option("N", "Further searches for the Pareto front of two objectives; default 0."),
    gain_margin: float | None = option("G", "Gain margin to keep, a factor; default 2."),
    phase_margin: str | None = option("ANGLE", "Phase margin to keep, such as 45deg; default 30deg."),
    plot: Path | None = option("FILE", "Draw the Pareto front, or the search: .png, .svg or .pdf."),
    report: Path | None = option("FILE.html", "Write a page with all results."),
    scheduler: str | None = option("ADDRESS", "Dask scheduler whose workers simulate; local: on this machine."),
    seed: int | None = option("N", "Seed of search, poses and draws; default 0."),
    allow: Allow = None,
) -> None:
    """Tune a controller's gains over uncertain arms by simulation, under a margin constraint.

    Options replace values of the file's table tuning. A
    scenario without lanes and draws gets masses within
    ±30 % and friction within a factor of two. Half of the lanes judge the result.
    After Ctrl-C, the best gains until then are judged and written.
    Exit code: 0 better gains were found and written, 1 none were and nothing was written, 2 bad input, 130 Ctrl-C.

    \b
    Examples:
      armwright tune arm.scenario.toml -o tuned.scenario.toml
      armwright tune arm.scenario.toml -o tuned.scenario.toml --start-gains analytic --report tuned.html
      armwright tune arm.scenario.toml -o tuned.scenario.toml --gain position_kp=2:40 --gain speed_kp=5
    """
    from armwright.sweeps.cluster import connected

    check_file(out, TOML, (scenario,))
    check_file(plot, PICTURE, (scenario, out))
    check_file(report, PAGE, (scenario, out))
    found = aw.read_scenario(scenario, allow=allow or ())
    margins = aw.tuning.MarginConstraint(
        gain_margin, None if phase_margin is None else angle("--phase-margin", phase_margin)
    )
    over = "worst" if worst else None
    gains, weights = _pairs("--gain", gain, bounds=True), _pairs("--objective", objective)
    limits = _pairs("--limit", limit)
    cluster = contextlib.nullcontext() if scheduler is None else connected(None if scheduler == "local" else scheduler)
    with cluster as client, progress(f"tuning {scenario.name}") as shown:
        search = aw.tuning.Search(method, generations, candidates, front, over, improve_each, seed, client)
        result, stopped = until_stopped(lambda: aw.tuning.tune(
            found, gains, start=start, objectives=weights, limits=limits, lanes=lanes, margins=margins, search=search,
            progress=shown,
        ))  # fmt: skip
    if result.changed:
        result.save(out, allow=allow or ())
    show(result)
    write(plot, result.plot)
    write(report, result.report)
    say(f"wrote {out}" if result.changed else f"{out} is not written")
    exit_if(stopped)
    exit_unless(result.changed)


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

"""`armwright tune`: gains that track better over uncertain arms and keep the margins."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from armwright.cli.arguments import SCENARIO, Allow, option
from armwright.cli.tables import show
from armwright.errors import ScenarioError
from armwright.terminal import say

SAME = 1  # the exit code where nothing better than the start was found


def tune(
    scenario: Annotated[
        Path, typer.Argument(metavar="FILE.scenario.toml", help="A scenario with a controller.", show_default=False)
    ],
    out: Annotated[Path, option("--output -o", f"TUNED{SCENARIO}", "The scenario with the tuned gains.")],
    start: Annotated[
        str | None, option("--start", "METHOD", "scenario (its own gains), analytic, or a method of design.")
    ] = None,
    gain: Annotated[
        list[str] | None,
        option("--gain", "NAME=F|LOW:HIGH", "A gain to tune, within a factor or bounds; default: all, within 10."),
    ] = None,
    objective: Annotated[
        list[str] | None,
        option(
            "--objective",
            "NAME=WEIGHT",
            "What counts: a reducer, noise_gain or sensitivity; default rms_error=1 and saturation=1.",
        ),
    ] = None,
    limit: Annotated[
        list[str] | None, option("--limit", "NAME=VALUE", "What no run should go beyond, such as peak_torque=40.")
    ] = None,
    improve_each: Annotated[
        bool | None, typer.Option("--improve-each", help="No objective may get worse.", show_default=False)
    ] = None,
    worst: Annotated[
        bool | None, typer.Option("--worst", help="The worst lane counts, not the mean.", show_default=False)
    ] = None,
    lanes: Annotated[
        int | None, option("--lanes", "N", "Of a scenario that has one; half judge the result; default 64.")
    ] = None,
    method: Annotated[str | None, option("--method", "NAME", "cma, the default, or differential-evolution.")] = None,
    generations: Annotated[int | None, option("--generations", "N", "Of the search; default 30.")] = None,
    candidates: Annotated[int | None, option("--candidates", "N", "In each; default 4 + 3 ln of the gains.")] = None,
    front: Annotated[
        int | None, option("--front", "N", "Further searches for the Pareto front of two objectives; default 0.")
    ] = None,
    gain_margin: Annotated[
        float | None, option("--gain-margin", "G", "Factor of a command to bear; default 2.")
    ] = None,
    phase_margin: Annotated[
        float | None, option("--phase-margin", "DEG", "Phase lag to bear, degrees; default 30.")
    ] = None,
    plot: Annotated[
        Path | None, option("--plot", "FILE", "Draw the Pareto front, or the search: .png, .svg or .pdf.")
    ] = None,
    report: Annotated[Path | None, option("--report", "FILE.html", "Write all of it as a page.")] = None,
    scheduler: Annotated[
        str | None, option("--scheduler", "ADDRESS", "Dask scheduler whose workers simulate; local: on this machine.")
    ] = None,
    seed: Annotated[int | None, option("--seed", "N", "Of search, poses and draws; default 0.")] = None,
    allow: Allow = None,
) -> None:
    """Tune a controller's gains over uncertain arms by simulation, under a margin constraint.

    Options replace values of the file's table tuning. A
    scenario without lanes and draws gets masses within
    ±30 % and friction within a factor of two. Half of the lanes judge the result.
    Exit code: 0 better gains were found and written, 1 none were and nothing was written, 2 bad input.

    \b
    Examples:
      armwright tune arm.scenario.toml -o tuned.scenario.toml
      armwright tune arm.scenario.toml -o tuned.scenario.toml --start analytic --report tuned.html
      armwright tune arm.scenario.toml -o tuned.scenario.toml --gain position_kp=2:40 --gain speed_kp=5
    """
    import contextlib
    import math

    import armwright as aw
    from armwright.cli.progress import progress
    from armwright.output import check_destination
    from armwright.results.plot import PICTURES
    from armwright.sweeps.cluster import connected

    check_destination(out, (".toml",), read=(scenario,))
    for path, endings in ((plot, PICTURES), (report, (".html",))):
        if path is not None:
            check_destination(path, endings, read=(scenario, out))
    found = aw.read_scenario(scenario, allow=allow or ())
    gains, objectives, limits = (
        _pairs("--gain", gain, bounds=True),
        _pairs("--objective", objective),
        _pairs("--limit", limit),
    )
    cluster = contextlib.nullcontext() if scheduler is None else connected(None if scheduler == "local" else scheduler)
    with cluster as client, progress(f"tuning {scenario.name}") as shown:
        result = aw.tuning.tune(
            found,
            gains,
            start=start,
            objectives=objectives,
            limits=limits,
            improve_each=improve_each,
            over="worst" if worst else None,
            lanes=lanes,
            method=method,
            generations=generations,
            candidates=candidates,
            front=front,
            gain_margin=gain_margin,
            phase_margin=None if phase_margin is None else math.radians(phase_margin),
            seed=seed,
            client=client,
            progress=shown,
        )
    if plot is not None:
        result.plot(plot)
    if result.changed:
        result.save(out, allow=allow or ())
    show(result)
    if plot is not None:
        say(f"wrote {plot}")
    if report is not None:
        say(f"wrote {result.report(report)}")
    if not result.changed:
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

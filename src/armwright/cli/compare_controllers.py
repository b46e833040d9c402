"""`armwright compare-controllers`: controllers of several scenario files on the same motions, as a table and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armwright.cli.arguments import MOTION, SCENARIO, Allow, option
from armwright.cli.tables import console_for_tables
from armwright.errors import ScenarioError
from armwright.terminal import say

if TYPE_CHECKING:
    from armwright.model import Model


def compare_controllers(
    scenarios: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE.scenario.toml…", help="Scenarios of one arm, each with a controller.", show_default=False
        ),
    ],
    motion: Annotated[
        list[Path],
        option(
            "--motion -m",
            "FILE",
            "Motion to follow: .motion.toml with its payloads, or .csv or .nc of one that was saved; may be repeated.",
        ),
    ],
    payload: Annotated[
        list[str] | None,
        option(
            "--payload",
            "KG",
            "Point mass at the tip during all of every motion; 0: what the motion carries; may be repeated.",
        ),
    ] = None,
    runs: Annotated[
        int | None, option("--runs", "N", "Runs with different noise and draws; default: the files' lanes, or 8.")
    ] = None,
    band: Annotated[float, option("--band", "B", "Band of the settling time in rad or m; default 0.001.")] = 1e-3,
    settle: Annotated[float, option("--settle", "S", "Time to watch after each motion's end, s; default 1.")] = 1.0,
    output: Annotated[
        Path | None, option("--output -o", "FILE", "Write every measure: .csv by case and joint, or .nc.")
    ] = None,
    plot: Annotated[Path | None, option("--plot", "FILE", "Draw the errors: .png, .svg or .pdf.")] = None,
    allow: Allow = None,
) -> None:
    """Compare controllers on the same motions: errors, path accuracy (ISO 9283), settling, effort.

    Exit code: 0 compared, 2 bad input.

    \b
    Examples:
      armwright compare-controllers pid.scenario.toml cascade.scenario.toml --motion pick.motion.toml
      armwright compare-controllers a.scenario.toml --motion a.csv --payload 0 --payload 2 -o errors.csv --plot errors.png
    """
    import armwright as aw
    from armwright.cli.progress import progress
    from armwright.control.comparison.compare import ENDINGS
    from armwright.output import check_destination
    from armwright.results.plot import PICTURES

    for path, endings in ((plot, PICTURES), (output, ENDINGS)):
        if path is not None:
            check_destination(path, endings, read=(*scenarios, *motion))
    names = _names(scenarios, SCENARIO)
    found = {name: aw.read_scenario(path, allow=allow or ()) for name, path in names.items()}
    first = next(iter(found.values()))
    motions = {name: _motion(path, first.arm, allow) for name, path in _names(motion, None).items()}
    with progress("comparing controllers"):
        comparison = aw.loops.compare_controllers(
            first, found, motions, _payloads(payload), runs, band=band, settle=settle
        )
    for each in comparison.tables():
        console_for_tables().print(each)
    for note in comparison.notes:
        say(f"armwright: note: {note}", err=True)
    if output is not None:
        comparison.save(output)
        say(f"wrote {output}")
    if plot is not None:
        comparison.plot(plot)
        say(f"wrote {plot}")


def _names(paths: list[Path], ending: str | None) -> dict[str, Path]:
    """Files by their names without ending; those of the same name by their paths."""
    shorts = [path.name.removesuffix(ending or "").removesuffix(MOTION) for path in paths]
    shorts = [Path(short).stem if ending is None else short for short in shorts]
    named = {short if shorts.count(short) == 1 else str(path): path for short, path in zip(shorts, paths, strict=True)}
    if len(named) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        raise ScenarioError("given twice", value=str(twice), expected="every file once")
    return named


def _motion(path: Path, arm: Model, allow: list[Path] | None) -> Any:
    """The motion in a file, with what it carries."""
    import armwright as aw

    if path.suffix.lower() in (".csv", ".nc"):
        return aw.trajectories.load_motion(path, arm)
    plan = aw.trajectories.plan(path, allow=allow or ())
    if plan.arm.names != arm.names:
        raise ScenarioError(
            f"a motion of {plan.arm.name}", place="robot", expected=f"{arm.name}, as in the scenarios", file=str(path)
        )
    return plan


def _payloads(texts: list[str] | None) -> dict[str, Any] | tuple[None]:
    """Point masses at the tip by their names."""
    import numpy as np

    import armwright as aw

    if not texts:
        return (None,)
    found: dict[str, Any] = {}
    for text in texts:
        try:
            mass = float(text)
        except ValueError:
            mass = -1.0
        if not 0.0 <= mass < np.inf:
            raise ScenarioError(place="--payload", value=text, expected="a mass of 0 kg or more")
        body = aw.Payload(0.0, mass, np.zeros(3), np.zeros((3, 3)))
        found[f"{mass:g} kg" if mass else "as planned"] = body if mass else None
    return found

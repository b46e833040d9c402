"""`armwright compare-controllers`: controllers of several scenario files on the same motions, as a table and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import armwright as aw
from armwright.cli.arguments import MOTION, SCENARIO, Allow, argument, option, output_option
from armwright.cli.outcome import PICTURE, check_file, exit_if, say_notes, until_stopped, write
from armwright.cli.tables import console_for_tables
from armwright.errors import ScenarioError
from armwright.progress import progress

if TYPE_CHECKING:
    from armwright.model import Model


def compare_controllers(
    scenarios: list[Path] = argument("SCENARIO…", "Scenarios of one arm, each with a controller."),
    motion: list[Path] = option(
        "FILE",
        "Motion to follow: .motion.toml with its payloads, or .csv or .nc of one that was saved; may be repeated.",
        ...,
        names="--reference -m",
    ),
    payload: list[str] | None = option(
        "KG", "Point mass at the tip during all of every motion; 0: what the motion carries; may be repeated."
    ),
    runs: int | None = option(
        "N", "Lanes: runs with different noise and draws; default the files' own, or 8.", names="--lanes"
    ),
    band: float = option("B", "Band of the settling time in rad or m; default 0.001.", 1e-3),
    settle: float = option("S", "Time to watch after each motion's end, s; default 1.", 1.0),
    output: Path | None = output_option("FILE", "Write every measure: .csv by case and joint, or .nc."),
    plot: Path | None = option("FILE", "Draw the errors: .png, .svg or .pdf."),
    allow: Allow = None,
) -> None:
    """Compare controllers on the same motions: errors, path accuracy (ISO 9283), settling, effort.

    Exit code: 0 compared, 2 bad input, 130 Ctrl-C: the controllers that were finished are kept.

    \b
    Examples:
      armwright compare-controllers pid.scenario.toml cascade.scenario.toml --reference pick.motion.toml
      armwright compare-controllers a.scenario.toml --reference a.csv --payload 0 --payload 2 -o errors.csv --plot errors.png
    """
    from armwright.control.comparison.compare import ENDINGS

    for path, endings in ((plot, PICTURE), (output, ENDINGS)):
        check_file(path, endings, (*scenarios, *motion))
    names = _names(scenarios, SCENARIO)
    found = {name: aw.read_scenario(path, allow=allow or ()) for name, path in names.items()}
    first = next(iter(found.values()))
    motions = {name: _motion(path, first.arm, allow) for name, path in _names(motion, None).items()}
    with progress("comparing controllers") as tell:
        comparison, stopped = until_stopped(
            lambda: aw.loops.compare_controllers(
                first, found, motions, _payloads(payload), runs, band=band, settle=settle, progress=tell
            )
        )
    for each in comparison.tables():
        console_for_tables().print(each)
    say_notes(comparison.notes)
    write(output, comparison.save)
    write(plot, comparison.plot)
    exit_if(stopped)


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

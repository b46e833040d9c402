"""`armwright animate`: a run as a moving arm."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from armwright.cli.arguments import argument, only, option, output_option, robot_argument
from armwright.cli.outcome import check_file
from armwright.terminal import say


def animate(
    robots: list[str] | None = robot_argument(
        "The arm that moved: a built-in one, or path of its file; by default the built-in one that the run names, or "
        "the one that the run of a scenario file keeps, drawn as a figure of its joints.",
        None,
    ),
    run: Path = argument("RUN", "Run saved as .nc."),
    output: Path = output_option("FILE", "Where to: .html (a page that plays it) or .glb (animated glTF 2.0).", ...),
    lane: int | None = option("K", "Which lane of a run that has several."),
) -> None:
    """Write a run as a moving arm: a page with a player, or an animated glTF file.

    The page needs no network: time slider, speed, camera, the reference of a controlled run as a ghost, curves below.

    \b
    Examples:
      armwright animate run.nc -o run.html
      armwright animate run.nc -o run.glb
      armwright animate my-arm.toml batch.nc --lane 3 -o lane3.html
    """
    from armwright.errors import RunError
    from armwright.pictures.animate import ENDINGS
    from armwright.scenarios.reproduce import kept_scenario

    robot = only(robots)
    check_file(output, ENDINGS)
    loaded = aw.load_run(run)
    name = robot or str(loaded.attrs.get("robot", ""))
    if robot is not None or name in aw.builtin_names():
        arm = aw.load(name)
    elif loaded.attrs.get("scenario"):
        arm = kept_scenario(loaded, run).arm
    else:
        what = "not built in, and the run keeps no scenario"
        raise RunError(what, place="robot", value=name, expected="ROBOT before it", file=run)
    aw.animate(loaded, arm, output, lane=lane)
    say(f"wrote {output}")

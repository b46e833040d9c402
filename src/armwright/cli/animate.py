"""`armwright animate`: a run as an arm that moves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from armwright.cli.arguments import option
from armwright.terminal import say


def animate(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run saved as .nc.", show_default=False)],
    output: Annotated[
        Path,
        option("--output -o", "FILE", "Where to: .html (a page that plays it) or .glb (animated glTF 2.0)."),
    ],
    robot: Annotated[
        str | None,
        option(
            "--robot",
            "ROBOT",
            "The arm that moved: a built-in one, or path of its file; by default the built-in one that the run names.",
        ),
    ] = None,
    lane: Annotated[
        int | None,
        option("--lane", "K", "Which lane of a run that has several."),
    ] = None,
) -> None:
    """Write a run as an arm that moves in real time: a page that plays it, or an animated glTF file.

    The page needs no network: time slider, speed, camera, the reference of a controlled run as a ghost, curves below.

    \b
    Examples:
      armwright animate run.nc -o run.html
      armwright animate run.nc -o run.glb
      armwright animate batch.nc --robot my-arm.toml --lane 3 -o lane3.html
    """
    import armwright as aw
    from armwright.errors import RunError
    from armwright.pictures.animate import check_animation

    check_animation(output)
    loaded = aw.load_run(run)
    if robot is None:
        robot = str(loaded.attrs.get("robot", ""))
        if robot not in aw.builtin_names():
            raise RunError("not built in", place="robot", value=robot, expected="--robot FILE", file=run)
    aw.animate(loaded, aw.load(robot), output, lane=lane)
    say(f"wrote {output}")

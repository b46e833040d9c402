"""`armwright show`: a picture of an arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from armwright.cli.arguments import Robot, option, vector
from armwright.terminal import say


def show(
    robot: Robot,
    output: Annotated[
        Path,
        option("--output -o", "FILE", "The picture: .png, .html or .glb; replaced where it exists."),
    ],
    size: Annotated[
        int | None,
        option("--size", "N", "Pixels of a PNG's longer side; default 900."),
    ] = None,
    q: Annotated[
        str | None,
        option("--q", "Q1,Q2,…", "The pose, in rad (or 30deg, pi/2) or m; default 0."),
    ] = None,
) -> None:
    """Draw an arm in one pose, without a display: from its sections and meshes, or as a figure of its joints.

    A PNG is a shaded picture; an HTML file is a page with a slider for every joint, which needs no network; a GLB file is a
    scene for Blender and other programs, with a node for each link.

    \b
    Examples:
      armwright show cmu-dd -o arm.png
      armwright show panda --q 0,-45deg,0,-135deg,0,90deg,45deg -o panda.html
      armwright show my-arm.urdf -o arm.glb
    """
    import armwright as aw
    from armwright.cli.progress import progress
    from armwright.model.joint_signals import joint_units

    arm = aw.load(robot, on_impossible="warn")
    pose = None if q is None else vector("--q", q, arm.names, joint_units(arm, "q"))
    with progress(f"drawing {arm.name}"):
        shown = aw.show(arm, output, pose, size=size)
    for note in shown.notes:
        say(f"note: {note}", err=True)
    say(f"wrote {shown.path}")

"""`armwright show`: a picture of an arm, or a live page."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import armwright as aw
from armwright.cli.arguments import Robot, as_options, flag, option, output_option, refuse, vector
from armwright.cli.outcome import say_each
from armwright.errors import OutputError
from armwright.progress import progress
from armwright.terminal import say

if TYPE_CHECKING:
    from armwright.pictures.live import LiveArm


def show(
    robot: Robot,
    output: Path | None = output_option("FILE", "The picture: .png, .html or .glb; replaced where it exists."),
    size: int | None = option("N", "Pixels of a PNG's longer side; default 900."),
    q: str | None = option("Q1,Q2,…", "The pose, in rad (or 30deg, pi/2) or m; default 0."),
    live: bool = flag("--live", "Serve a live page to this machine's browsers until Ctrl-C."),
    port: int | None = option("N", "Port of the live page on 127.0.0.1; by default one that is free."),
    browser: bool = flag("--open", "Open the live page in the browser."),
) -> None:
    """Draw an arm in one pose, or serve a live page of it.

    The arm is drawn from its sections and meshes, or as a stick figure; no display is needed. A PNG is a shaded picture; an
    HTML file is a page with a slider for every joint, which needs no network; a GLB file is a scene for Blender and other
    programs, with a node for each link. --live serves the page at an address that only this machine reaches; Python
    programs and `armwright sim` can move the arm in such a page.

    \b
    Examples:
      armwright show cmu-dd -o arm.png
      armwright show panda --q 0,-45deg,0,-135deg,0,90deg,45deg -o panda.html
      armwright show my-arm.urdf -o arm.glb
      armwright show panda --live --open
    """
    from armwright.model.joint_signals import joint_units

    if live:
        of_file = {"output": output and str(output), "size": size}
        refuse(of_file, "does not go with --live", error=OutputError, with_value=True)
    else:
        of_page = {"port": port, "open": browser or None}
        refuse(of_page, "only --live has it", error=OutputError, with_value=True)
    arm = aw.load(robot, on_impossible="warn")
    pose = None if q is None else vector("--q", q, arm.names, joint_units(arm, "q"))
    drawing = progress(f"drawing {arm.name}")
    if output is not None:
        with drawing:
            shown = aw.show(arm, output, pose, size=size)
        say_each("note: ", shown.notes, err=True)
        say(f"wrote {shown.path}")
    elif live:
        with drawing, as_options("port"):
            page = aw.show(arm, q=pose, live=True, port=port or 0)
        say_each("note: ", page.notes, err=True)
        _serve(page, browser)
    else:
        raise OutputError("missing", place="--output", expected=".png, .html or .glb, or --live in its place")


def _serve(page: LiveArm, browser: bool) -> None:
    """Says where the page is, and returns at Ctrl-C."""
    with suppress(KeyboardInterrupt), page:
        say(f"{page.arm.name} is at {page.url}\nThe address is for this machine alone; Ctrl-C ends it.")
        sys.stdout.flush()  # for a program at the other end of a pipe
        if browser and not page.open():
            say("note: no browser was found; open the address in one", err=True)
        page.wait()

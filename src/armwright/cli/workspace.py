"""`armwright workspace`: positions that the tip reaches, and manipulability there."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from armwright.cli.arguments import Robot, option, output_option
from armwright.cli.outcome import check_file
from armwright.progress import progress
from armwright.terminal import result, say

SHOWN = (1.0, 50.0, 99.0, 100.0)  # percentiles of the summary


def workspace(
    robot: Robot,
    output: Path | None = output_option(
        "FILE", "The picture: .png, .svg, .pdf, .html (a cloud to turn), or .nc for the numbers."
    ),
    samples: int = option("N", "Joint positions to draw; default 1000000.", 1_000_000),
    frame: str | None = option("NAME", "The frame that moves; by default the tip."),
    aim: str = option(
        "WORD", "What manipulability counts: rotation, pose, position, axis, pitch, …; default pose.", "pose"
    ),
    length: float = option("L", "Metres that a turn by 1 rad counts as; default 1.", 1.0),
    seed: int = option("N", "Seed of the samples; default 0.", 0),
) -> None:
    """Draw the workspace of an arm: reachable positions, and manipulability there.

    \b
    Examples:
      armwright workspace puma560 -o puma.png
      armwright workspace panda --aim position -o panda.html
      armwright workspace my-arm.urdf --samples 100000
    """
    from armwright.output import whole_file
    from armwright.pictures.workspace_maps import ENDINGS, draw_workspace

    check_file(output, (*ENDINGS, ".nc"), (robot,))
    arm = aw.load(robot, kinematics_only=True)
    with progress(f"workspace of {arm.name}"):
        found = aw.kinematics.workspace(arm, samples, frame=frame, aim=aim, length=length, seed=seed)
        if output is not None and output.suffix.lower() == ".nc":
            with whole_file(output, (".nc",)) as temporary:
                found.to_netcdf(temporary, engine="h5netcdf")
        elif output is not None:
            draw_workspace(found, output)
    for name in ("reach", "manipulability", "smallest_singular_value", "condition"):
        values = found[f"{name}_percentiles"].sel(percentile=list(SHOWN)).values
        unit = found[name].attrs["units"]
        result(
            {"quantity": name, "unit": unit, "percentiles": dict(zip(map(str, SHOWN), values.tolist(), strict=True))}
        )
        parts = zip(("1 %", "median", "99 %", "most"), values, strict=True)
        say(f"{name.replace('_', ' ')} [{unit}]: " + ", ".join(f"{word} {value:.4g}" for word, value in parts))
    if output is not None:
        say(f"wrote {output}")

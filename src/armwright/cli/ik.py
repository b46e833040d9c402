"""`armwright ik`: joint positions for a table of poses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from armwright.cli.arguments import Out, Robot, Table, option, vector
from armwright.cli.tables import show_columns
from armwright.terminal import say

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from armwright.ik.solutions import PoseSolutions

UNIT = 1e-3  # how far the length of a quaternion may be from 1
MISSED = 1  # the exit code where a pose is not reached
COLUMNS = {
    3: ("x", "y", "z"),
    6: ("x", "y", "z", "roll", "pitch", "yaw"),
    7: ("x", "y", "z", "qw", "qx", "qy", "qz"),
}
UNITS = {"x": "m", "y": "m", "z": "m", "roll": "rad", "pitch": "rad", "yaw": "rad"}


def ik(
    robot: Robot,
    table: Table,
    output: Out = None,
    frame: Annotated[str | None, option("--frame", "NAME", "The frame to bring there; by default the tip.")] = None,
    near: Annotated[
        str | None, option("--near", "Q1,Q2,…", "Joint positions to begin with, in rad (m for sliding joints).")
    ] = None,
    axis: Annotated[bool, typer.Option("--axis", help="Only position and z axis of the frame count.")] = False,
    goal: Annotated[
        str | None,
        option(
            "--goal",
            "WORD",
            "Best solution by it: nearest (to --near), limits (far from them) or manipulability.",
        ),
    ] = None,
    tolerance: Annotated[float, option("--tolerance", "T", "On distance in m and angle in rad.")] = 1e-8,
    method: Annotated[
        str, option("--method", "NAME", "closed-form, numeric, or auto: closed form where the arm has one.")
    ] = "auto",
    every: Annotated[bool, typer.Option("--all", help="All solutions of the closed form, a row each.")] = False,
) -> None:
    """Inverse kinematics of a table: joint positions for the pose in each row.

    Positions are within the limits. The table has the columns x, y, z in m, alone or with roll, pitch, yaw in rad (about
    fixed axes, as in a URDF) or with the quaternion qw, qx, qy, qz. The result has q_JOINT, and how far off the pose is in
    mm and mrad; q_JOINT is nan where a pose was not reached. With --all, rows have the number of the pose and of the
    branch, and poses that are not reached have none. Exit code: 0 all were reached, 1 some were not, 2 bad input.

    \b
    Examples:
      armwright ik puma560 poses.csv -o positions.csv
      armwright ik my-arm.toml points.csv --near 0,0.5,1.2 | head
      armwright ik puma560 poses.csv --all
    """
    import armwright as aw
    from armwright.cli.progress import progress
    from armwright.model.joint_signals import joint_units
    from armwright.output import check_destination
    from armwright.results.tables import joint_columns

    arm = aw.load(robot)
    if output is not None:
        check_destination(output, read=(table, robot))
    targets, turned = _targets(table)
    aim: Any = "axis" if axis else "pose" if turned else "position"
    wish: Any = goal
    start = None if near is None else vector("--near", near, arm.names, joint_units(arm, "q"))
    with progress("inverse kinematics"):
        way: Any = "closed-form" if every and method == "auto" else method
        found = aw.inverse_kinematics(
            arm, targets, frame=frame, aim=aim, near=start, goal=wish, tolerance=tolerance, method=way
        )
    numbers, q, off, turned_off = _every(found) if every else _best(found)
    columns = numbers | joint_columns("q", arm.names, joint_units(arm, "q"), q)
    columns |= {"off [mm]": 1e3 * off, "off [mrad]": 1e3 * turned_off}
    show_columns(output, columns)
    if output is not None or not found.success.all():
        say(str(found), err=output is None)
    if not found.success.all():
        raise typer.Exit(MISSED)


Rows = tuple[dict[str, "np.ndarray"], "np.ndarray", "np.ndarray", "np.ndarray"]


def _best(found: PoseSolutions) -> Rows:
    """No further columns, positions (nan where a pose is not reached), and errors of the best solution of each pose."""
    import numpy as np

    return {}, np.where(found.success[:, None], found.q, np.nan), found.position_error, found.angle_error


def _every(found: PoseSolutions) -> Rows:
    """Numbers of pose and branch, positions and errors of all solutions.

    Raises:
        ModelError: they are numeric, which have no branches.
    """
    import numpy as np

    from armwright.errors import ModelError

    branches = found.branches
    if branches is None:
        raise ModelError(place="--all", value=f"--method {found.method}", expected="the closed form")
    pose, branch = np.nonzero(branches.success)
    q, off, turned = (each[pose, branch] for each in (branches.q, branches.position_error, branches.angle_error))
    return {"pose": pose, "branch": branch}, q, off, turned


def _targets(table: Path) -> tuple[np.ndarray, bool]:
    """Poses (k, 4, 4) of a table, and whether it says how they are turned.

    Raises:
        ScheduleError: what is no such table, or a quaternion that is not of unit length.
    """
    import numpy as np
    from scipy.spatial.transform import Rotation

    from armwright.errors import ScheduleError
    from armwright.results.tables import Column, parse_numbers, table_text

    text = table_text(table)
    first = next((line for line in text.splitlines() if line.strip()), "")
    names = COLUMNS.get(first.count(",") + 1, COLUMNS[6])
    columns = [Column(name, (UNITS[name],) if name in UNITS else ()) for name in names]
    numbers = parse_numbers(text, str(table), columns)
    values = numbers.values
    poses = np.broadcast_to(np.eye(4), (len(values), 4, 4)).copy()
    poses[:, :3, 3] = values[:, :3]
    if len(names) == 6:
        poses[:, :3, :3] = Rotation.from_euler("xyz", values[:, 3:]).as_matrix()
    if len(names) == 7:
        length = np.linalg.norm(values[:, 3:], axis=1)
        for row in np.flatnonzero(np.abs(length - 1.0) > UNIT)[:1]:
            place, expected = "columns qw, qx, qy, qz", "a quaternion of length 1"
            raise ScheduleError(
                f"length {length[row]:.6g}", place=place, expected=expected, file=f"{table}:{numbers.lines[row]}"
            )
        poses[:, :3, :3] = Rotation.from_quat(values[:, 3:], scalar_first=True).as_matrix()
    return poses, len(names) > 3

"""`armwright ik`: joint positions for a table of poses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import armwright as aw
from armwright.cli.arguments import Out, Robot, Table, flag, option, vector
from armwright.cli.outcome import check_file, exit_unless
from armwright.cli.tables import show_columns
from armwright.errors import ModelError, ScheduleError
from armwright.progress import progress
from armwright.terminal import say

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from armwright.ik.solutions import PoseSolutions
    from armwright.kinematics.aim import Aim
    from armwright.results.csv_tables import CsvNumbers

UNIT = 1e-3  # how far the length of a quaternion may be from 1
PLACE = ("x", "y", "z")
COLUMNS: dict[tuple[str, ...], str] = {  # behind the position, with the aim that they are for
    (): "position",
    ("roll", "pitch", "yaw"): "pose",
    ("qw", "qx", "qy", "qz"): "pose",
    ("ax", "ay", "az"): "axis",
    ("pitch",): "pitch",
    ("yaw",): "yaw",
}
UNITS = {"x": "m", "y": "m", "z": "m", "roll": "rad", "pitch": "rad", "yaw": "rad"}


def ik(
    robot: Robot,
    table: Table,
    output: Out = None,
    frame: str | None = option("NAME", "The frame to bring there; by default the tip."),
    near: str | None = option("Q1,Q2,…", "Joint positions to begin with, in rad (m for sliding joints)."),
    aim: str | None = option(
        "WORD",
        "Target to reach: pose, position, axis, pitch, yaw ('axis x': of another axis), 'base xy', 'tool z'; "
        "by default what the columns say.",
    ),
    goal: str | None = option(
        "WORD", "Best solution by it: nearest (to --near), limits (far from them) or manipulability."
    ),
    tolerance: float = option("T", "On distance in m and angle in rad.", 1e-8),
    method: str = option("NAME", "Method: closed-form, numeric, or auto: closed form where the arm has one.", "auto"),
    every: bool = flag("--all", "All solutions of the closed form, a row each."),
) -> None:
    """Inverse kinematics of a table: joint positions for the pose in each row.

    Positions are within the limits. The table has the columns x, y, z in m, alone or with roll, pitch, yaw in rad (about
    fixed axes, as in a URDF) or with the quaternion qw, qx, qy, qz. For a part of the orientation: with ax, ay, az, the
    direction of the frame's z axis; with pitch, the angle of that axis below the base's xy plane; or with yaw, the angle
    of the frame's x axis about base z. --aim "pitch x" means another axis. The result has q_JOINT, and how far off the
    pose is in mm and mrad; q_JOINT is nan where a pose was not reached. With --all, rows have the number of the pose and
    of the branch, and poses that are not reached have none. Exit code: 0 all were reached, 1 some were not, 2 bad input.

    \b
    Examples:
      armwright ik puma560 poses.csv -o positions.csv
      armwright ik my-arm.toml points.csv --near 0,0.5,1.2 | head
      armwright ik puma560 poses.csv --all
      armwright ik my-arm.toml poses.csv --aim pitch
    """
    from armwright.model.joint_signals import joint_units
    from armwright.results.csv_tables import joint_columns

    arm = aw.load(robot)
    check_file(output, read=(table, robot))
    targets, part = _targets(table, aim)
    wish: Any = goal
    start = None if near is None else vector("--near", near, arm.names, joint_units(arm, "q"))
    with progress("inverse kinematics"):
        way: Any = "closed-form" if every and method == "auto" else method
        found = aw.inverse_kinematics(
            arm, targets, frame=frame, aim=part, near=start, goal=wish, tolerance=tolerance, method=way
        )
    numbers, q, off, turned_off = _every(found) if every else _best(found)
    columns = numbers | joint_columns("q", arm.names, joint_units(arm, "q"), q)
    columns |= {"off [mm]": 1e3 * off, "off [mrad]": 1e3 * turned_off}
    show_columns(output, columns)
    if output is not None or not found.success.all():
        say(str(found), err=output is None)
    exit_unless(bool(found.success.all()))


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

    branches = found.branches
    if branches is None:
        raise ModelError(place="--all", value=f"--method {found.method}", expected="the closed form")
    pose, branch = np.nonzero(branches.success)
    q, off, turned = (each[pose, branch] for each in (branches.q, branches.position_error, branches.angle_error))
    return {"pose": pose, "branch": branch}, q, off, turned


def _targets(table: Path, aim: str | None) -> tuple[np.ndarray, Aim]:
    """Poses (k, 4, 4) of a table, and what of them counts.

    Raises:
        ScheduleError: what is no such table, or a number that cannot be.   ModelError: no such aim, or one that the columns
            do not have.
    """
    import numpy as np
    from scipy.spatial.transform import Rotation

    from armwright.ik.targets import pose_towards
    from armwright.kinematics.aim import AXES, Aim
    from armwright.results.csv_tables import CsvColumn, parse_numbers, table_text

    text = table_text(table)
    turn = _columns(next((line for line in text.splitlines() if line.strip()), ""))
    part = Aim.of(COLUMNS[turn] if aim is None else aim)
    numbers = parse_numbers(
        text, str(table), [CsvColumn(name, (UNITS[name],) if name in UNITS else ()) for name in (*PLACE, *turn)]
    )
    values = numbers.values
    place, turned = values[:, :3], values[:, 3:]
    if len(turn) == 1 or turn == ("ax", "ay", "az"):
        if (part.kind != turn[0] and len(turn) == 1) or part.kind not in ("axis", "pitch", "yaw") or part.base:
            raise ModelError(f"with columns {', '.join(turn)}", place="--aim", value=aim, expected=COLUMNS[turn])
        angle = turned[:, 0]
        if turn == ("pitch",):
            steep = np.abs(angle) > 0.5 * np.pi
            _check(numbers, steep, angle, "column pitch", "an angle from -π/2 to π/2 rad")
            turned = np.stack([np.cos(angle), 0.0 * angle, -np.sin(angle)], axis=1)
        elif turn == ("yaw",):
            turned = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
        length = np.linalg.norm(turned, axis=1)
        _check(numbers, length == 0.0, length, "columns ax, ay, az", "a direction, not 0 0 0")
        return pose_towards(place, turned, AXES[part.axis]), part
    poses = np.broadcast_to(np.eye(4), (len(values), 4, 4)).copy()
    poses[:, :3, 3] = place
    if not turn and part.counted:
        expected = "position, or columns that say how the frame is turned"
        raise ModelError("with columns x, y, z", place="--aim", value=aim, expected=expected)
    if len(turn) == 3:
        poses[:, :3, :3] = Rotation.from_euler("xyz", turned).as_matrix()
    if len(turn) == 4:
        length = np.linalg.norm(turned, axis=1)
        _check(numbers, np.abs(length - 1.0) > UNIT, length, "columns qw, qx, qy, qz", "a quaternion of length 1")
        poses[:, :3, :3] = Rotation.from_quat(turned, scalar_first=True).as_matrix()
    return poses, part


def _columns(head: str) -> tuple[str, ...]:
    """Columns behind x, y, z of a table by its first line: by their names, or without names by their number."""
    names = {cell.partition("[")[0].strip() for cell in head.split(",")}
    for turn in COLUMNS:
        if turn and names == {*PLACE, *turn}:
            return turn
    return {3: (), 7: ("qw", "qx", "qy", "qz")}.get(head.count(",") + 1, ("roll", "pitch", "yaw"))


def _check(numbers: CsvNumbers, wrong: np.ndarray, values: np.ndarray, place: str, expected: str) -> None:
    """Refuses rows (k,) of a table.

    Raises:
        ScheduleError: names the first.
    """
    for row in wrong.nonzero()[0][:1]:
        what = f"{'length ' if 's ' in place else ''}{values[row]:.6g}"
        raise ScheduleError(what, place=place, expected=expected, file=f"{numbers.path}:{numbers.lines[row]}")

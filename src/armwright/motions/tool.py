"""Segments of a motion file along which the tool follows lines and arcs."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from armwright.errors import ScenarioError
from armwright.kinematics import forward_kinematics
from armwright.kinematics.aim import AXES, Aim, horizontal_normal
from armwright.model import Model
from armwright.motions.records import ArcPiece, LinePiece, ToolSegment
from armwright.spatial.rotation import rotation_rpy
from armwright.trajectory.cartesian.follow import ToolLimits, follow_path
from armwright.trajectory.cartesian.motion import CartesianMotion
from armwright.trajectory.cartesian.path import CartesianPath
from armwright.trajectory.cartesian.rotations import HALF_TURN
from armwright.trajectory.cartesian.segments import Arc, Circle, Line
from armwright.trajectory.cartesian.solve import solve_path
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.limits_report import dense_times

TOOL_KEPT = 1.001  # share of a tool's limit that counts as kept: between the nodes of its spline it leaves the path

# key: aims
TURNS = {"rpy_rad": (), "direction": ("axis", "pitch", "yaw"), "pitch_rad": ("pitch",), "yaw_rad": ("yaw",)}


def tool_motion(arm: Model, segment: ToolSegment, q: np.ndarray, limits: MotionLimits, time: float) -> CartesianMotion:
    """Joint motion that moves the tool along a segment's path.

    Args:
        arm: the model.   segment: its path and speeds.   q: (n,) [rad | m] where it begins.   limits: of the joints.
        time: [s] of the beginning.
    Raises:
        ScenarioError: as `follow_path`.
    """
    if segment.frame is None and arm.tip is None:
        raise ScenarioError(
            "missing", place="segment.frame", expected="the frame that follows the path", choices=arm.frames
        )
    start = np.asarray(forward_kinematics(arm, q, segment.frame), dtype=float)
    offset = start[:3, 3] if segment.origin == "start" else np.zeros(3)
    aim, pieces, pose = Aim.of(segment.aim), [], start
    for k, piece in enumerate(segment.path):
        place = f"segments[{k}]"
        if isinstance(piece, LinePiece):
            pieces.append(Line(_goal(piece, offset, pose, aim, place)))
        elif isinstance(piece, ArcPiece):
            pieces.append(Arc(offset + piece.through_m, _goal(piece, offset, pose, aim, place)))
        else:
            pieces.append(Circle(offset + piece.centre_m, piece.normal, piece.angle_rad, piece.turns))
        last = pieces[-1].pieces(pose, place)[-1]
        pose = last.at(np.array([last.length])).pose[0]
    path = CartesianPath(pieces, start, segment.blend_m)
    solution = solve_path(arm, path, near=q, frame=segment.frame, aim=aim, limits=limits)
    return follow_path(
        arm, solution, segment.speed_m_per_s, segment.acceleration_m_per_s2, limits=limits,
        tool=ToolLimits(None, segment.angular_speed_rad_per_s, segment.angular_acceleration_rad_per_s2),
        slow="nowhere" if segment.constant else segment.slow, time=time,
    )  # fmt: skip


def tool_excesses(segment: ToolSegment, motion: CartesianMotion) -> tuple[str, ...]:
    """Sentences, one for each limit of the tool in a segment that its motion exceeds: by the joints' motion, not by the path.

    Args:
        segment: its path and speeds.   motion: of the joints.
    """
    t = dense_times(motion)
    twist, change = motion.solution.tool.twist(*motion.at(t))
    found = []
    for what, rows, limit, unit in (
        ("speed", twist[:, :3], segment.speed_m_per_s, "m/s"),
        ("acceleration", change[:, :3], segment.acceleration_m_per_s2, "m/s²"),
        ("angular speed", twist[:, 3:], segment.angular_speed_rad_per_s, "rad/s"),
        ("angular acceleration", change[:, 3:], segment.angular_acceleration_rad_per_s2, "rad/s²"),
    ):
        sizes = np.linalg.norm(rows, axis=1)
        k = int(sizes.argmax())
        if limit is not None and sizes[k] > limit * TOOL_KEPT:
            value = f"the tool's {what} is {sizes[k]:.4g} {unit} at {t[k]:.4g} s"
            found.append(f"{value}, {sizes[k] / limit:.1%} of its limit {limit:.4g} {unit}")
    return tuple(found)


def _goal(piece: LinePiece | ArcPiece, offset: np.ndarray, start: np.ndarray, aim: Aim, place: str) -> np.ndarray:
    """(3,) position, or a pose (4, 4) where the piece says how the tool is turned.

    Args:
        piece: of the path.   offset: (3,) of its positions.   start: (4, 4) where it begins.   aim: what counts.
        place: for errors.
    Raises:
        ScenarioError: more than one rotation, or one that needs an axis and has none.
    """
    position = offset + piece.to_m
    stated = [key for key in TURNS if getattr(piece, key) is not None]
    if not stated:
        return position
    key = stated[0]
    if len(stated) > 1:
        raise ScenarioError(f"with {key}", place=f"{place}.{stated[1]}", expected="one of them")
    pose = np.eye(4)
    pose[:3, 3] = position
    if piece.rpy_rad is not None:
        pose[:3, :3] = np.asarray(rotation_rpy(*piece.rpy_rad), dtype=float)
        return pose
    if aim.kind not in TURNS[key] or aim.base:
        expected = f"it with aim = {' or '.join(map(repr, TURNS[key]))}"
        raise ScenarioError(f"with aim = {str(aim)!r}", place=f"{place}.{key}", expected=expected)
    axis = start[:3, aim.axis]
    if piece.pitch_rad is not None:
        turn = (piece.pitch_rad + np.arcsin(np.clip(axis[2], -1.0, 1.0))) * horizontal_normal(axis)
    elif piece.yaw_rad is not None:
        turn = np.array(
            [0.0, 0.0, np.remainder(piece.yaw_rad - np.arctan2(axis[1], axis[0]) + np.pi, 2.0 * np.pi) - np.pi]
        )
    else:
        turn = _between(axis, np.asarray(piece.direction), f"{place}.direction", AXES[aim.axis])
    pose[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ start[:3, :3]
    return pose


def _between(axis: np.ndarray, direction: np.ndarray, place: str, name: str) -> np.ndarray:
    """Rotation vector (3,) [rad] of the shortest turn of an axis (3,) to a direction (3,).

    Raises:
        ScenarioError: no direction, or the opposite one.
    """
    length = np.linalg.norm(direction)
    across = np.cross(axis, direction)
    sine = np.linalg.norm(across)
    if not length or (sine < HALF_TURN * length and axis @ direction < 0.0):
        what = f"opposite to the tool's {name} axis, which has no shortest way there" if length else ""
        raise ScenarioError(what, place=place, value=direction.tolist(), expected="another direction, or one between")
    return across * (np.arctan2(sine, axis @ direction) / sine if sine else 0.0)

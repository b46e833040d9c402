"""Segments of a motion file along which the tool follows lines and arcs."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.kinematics import forward_kinematics
from armwright.model import Model
from armwright.motions.records import ArcPiece, LinePiece, ToolSegment
from armwright.spatial.rotation import rotation_rpy
from armwright.trajectory.cartesian.follow import follow_path
from armwright.trajectory.cartesian.motion import CartesianMotion
from armwright.trajectory.cartesian.path import CartesianPath
from armwright.trajectory.cartesian.segments import Arc, Circle, Line
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.limits_report import dense_times

TOOL_KEPT = 1.001  # share of a tool's limit that counts as kept: between the nodes of its spline it leaves the path


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
    pieces: list[Any] = []
    for piece in segment.path:
        if isinstance(piece, LinePiece):
            pieces.append(Line(_goal(piece, offset)))
        elif isinstance(piece, ArcPiece):
            pieces.append(Arc(offset + piece.through_m, _goal(piece, offset)))
        else:
            pieces.append(Circle(offset + piece.centre_m, piece.normal, piece.angle_rad, piece.turns))
    return follow_path(
        arm, CartesianPath(pieces, start, segment.blend_m), segment.speed_m_per_s, segment.acceleration_m_per_s2,
        angular_speed=segment.angular_speed_rad_per_s, angular_acceleration=segment.angular_acceleration_rad_per_s2,
        limits=limits, slow=segment.slow, constant=segment.constant, near=q, frame=segment.frame, aim=segment.aim, time=time,
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


def _goal(piece: LinePiece | ArcPiece, offset: np.ndarray) -> np.ndarray:
    """(3,) position, or a pose (4, 4) where the piece says how the tool is turned."""
    position = offset + piece.to_m
    if piece.rpy_rad is None:
        return position
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.asarray(rotation_rpy(*piece.rpy_rad), dtype=float), position
    return pose

"""Segments of a tool's path: lines, arcs, circles, and sequences of poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.trajectory.cartesian.pieces import PathStretch
from armwright.trajectory.cartesian.rotations import HALF_TURN, shortest_turn

ORTHOGONAL = 1e-6  # of the entries of Rᵀ R - 1
SHORT = 1e-9  # [m] and [rad]: ways and turns below that are none
PLANE = 1e-6  # of a circle's radius: how far its beginning may be off its plane


@dataclass(frozen=True, eq=False)
class Line:
    """A straight line to a goal; the tool turns uniformly about one axis by the shortest way (SLERP).

    Without a way it is a turn in place.

    Args:
        goal: (4, 4) pose, or (3,) position [m] that keeps the rotation.
    Raises:
        ScenarioError: no pose.
    Example:
        >>> start = aw.forward_kinematics(aw.load("ur5e"), [0.0, -1.0, 1.2, -0.5, 0.8, 0.0])
        >>> line = aw.trajectories.Line(start[:3, 3] + [0.0, 0.1, 0.0])
        >>> round(float(aw.trajectories.CartesianPath([line], start).length), 3)
        0.1
    """

    goal: Any

    def __post_init__(self) -> None:
        object.__setattr__(self, "goal", goal_pose("Line.goal", self.goal))

    def pieces(self, start: np.ndarray, place: str) -> list[PathStretch]:
        """The piece that begins at a pose (4, 4)."""
        return [straight(start, _posed(self.goal, start), place)]


@dataclass(frozen=True, eq=False)
class Arc:
    """An arc of a circle through a point to a goal; the tool turns uniformly about one axis by the shortest way (SLERP).

    Args:
        through: (3,) [m] position that the arc passes.   goal: (4, 4) pose, or (3,) position that keeps the rotation.
    Raises:
        ScenarioError: no position, no pose.
    Example:
        >>> arc = aw.trajectories.Arc(through=[0.1, 0.1, 0.0], goal=[0.2, 0.0, 0.0])
        >>> path = aw.trajectories.CartesianPath([arc], start=np.eye(4))
        >>> round(float(path.length), 3)  # π · 0.1 m
        0.314
    """

    through: Any
    goal: Any

    def __post_init__(self) -> None:
        object.__setattr__(self, "through", numbers("Arc.through", self.through, (3,)))
        object.__setattr__(self, "goal", goal_pose("Arc.goal", self.goal))

    def pieces(self, start: np.ndarray, place: str) -> list[PathStretch]:
        """The piece that begins at a pose (4, 4).

        Raises:
            ScenarioError: three points on a line.
        """
        goal = _posed(self.goal, start)
        p, a, b = start[:3, 3], self.through - start[:3, 3], goal[:3, 3] - start[:3, 3]
        normal = np.cross(a, b)
        area = float(normal @ normal)
        if area <= (1e-9 * (a @ a + b @ b)) ** 2:
            what = "beginning, through and goal lie on a line, or coincide"
            raise ScenarioError(what, place=place, value=self.through, expected="three points of a circle")
        offset = np.cross((a @ a) * b - (b @ b) * a, normal) / (2.0 * area)  # of the centre, from the beginning
        normal = normal / np.sqrt(area)
        x, y = -offset, np.cross(normal, -offset)
        end = b - offset
        angle = float(np.arctan2(end @ y, end @ x)) % (2.0 * np.pi)
        return [circular(start, p + offset, normal, angle, shortest(start, goal, place))]


@dataclass(frozen=True, eq=False)
class Circle:
    """An arc about a centre, perhaps of several turns.

    Args:
        centre: (3,) [m].   normal: (3,) axis of the circle; angles count by the right hand about it.   angle: [rad].
        turns: whether the tool turns along with the circle; else it keeps its rotation.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> circle = aw.trajectories.Circle(centre=[0.1, 0.0, 0.0], normal=[0.0, 0.0, 1.0])
        >>> path = aw.trajectories.CartesianPath([circle], start=np.eye(4))
        >>> round(float(path.length), 3)  # 2π · 0.1 m
        0.628
    """

    centre: Any
    normal: Any
    angle: float = 2.0 * np.pi
    turns: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", numbers("Circle.centre", self.centre, (3,)))
        normal = numbers("Circle.normal", self.normal, (3,))
        if not normal.any():
            raise ScenarioError(place="Circle.normal", value=self.normal, expected="a direction")
        object.__setattr__(self, "normal", normal / np.linalg.norm(normal))
        angle = scalar.real_number(self.angle)
        if angle is None or not SHORT < abs(angle) < 1e6:
            raise ScenarioError(place="Circle.angle", value=self.angle, expected="an angle [rad] that is not 0")

    def pieces(self, start: np.ndarray, place: str) -> list[PathStretch]:
        """The piece that begins at a pose (4, 4).

        Raises:
            ScenarioError: the pose is at the centre or off the plane.
        """
        offset = start[:3, 3] - self.centre
        radius, off = float(np.linalg.norm(offset)), float(offset @ self.normal)
        if radius < SHORT or abs(off) > PLANE * radius:
            what = f"the path is {abs(off):.4g} m off the circle's plane and {radius:.4g} m from its centre"
            raise ScenarioError(what, place=place, expected="a circle that the path begins on")
        normal, angle = np.sign(self.angle) * self.normal, abs(float(self.angle))
        turn = start[:3, :3].T @ normal * angle if self.turns else np.zeros(3)
        return [circular(start, self.centre + off * self.normal, normal, angle, turn)]


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses one after the other, joined by lines.

    Args:
        poses: (k, 4, 4), or (k, 3) positions [m] that keep the rotation.
    Raises:
        ScenarioError: what is no pose; names the first.
    Example:
        >>> poses = np.array([np.eye(4), np.eye(4)])
        >>> poses[:, 0, 3] = [0.1, 0.2]
        >>> path = aw.trajectories.CartesianPath([aw.trajectories.Poses(poses)], np.eye(4))
        >>> round(float(path.length), 3)
        0.2
    """

    poses: Any

    def __post_init__(self) -> None:
        try:
            rows = [goal_pose(f"Poses.poses[{k}]", each) for k, each in enumerate(self.poses)]
        except TypeError:
            rows = []
        if not rows:
            raise ScenarioError(place="Poses.poses", value=self.poses, expected="one or more poses (k, 4, 4) or (k, 3)")
        object.__setattr__(self, "poses", tuple(rows))

    def pieces(self, start: np.ndarray, place: str) -> list[PathStretch]:
        """The pieces that begin at a pose (4, 4)."""
        pieces = []
        for k, goal in enumerate(self.poses):
            goal = _posed(goal, start)
            pieces.append(straight(start, goal, f"{place}.poses[{k}]"))
            start = goal
        return pieces


def straight(start: np.ndarray, goal: np.ndarray, place: str) -> PathStretch:
    """A line or a turn in place between poses (4, 4).

    Raises:
        ScenarioError: poses that coincide, or are half a turn apart.
    """
    way, turn = goal[:3, 3] - start[:3, 3], shortest(start, goal, place)
    length, angle = float(np.linalg.norm(way)), float(np.linalg.norm(turn))
    if length < SHORT and angle < SHORT:
        raise ScenarioError(
            "has no length", place=place, value=goal[:3, 3], expected="a pose that differs from the last"
        )
    if length < SHORT:
        return PathStretch(start[:3, 3], start[:3, :3], angle, np.zeros(3), turn / angle)
    return PathStretch(start[:3, 3], start[:3, :3], length, way / length, turn / length)


def circular(start: np.ndarray, centre: np.ndarray, normal: np.ndarray, angle: float, turn: np.ndarray) -> PathStretch:
    """An arc by an angle [rad] above 0, with the tool's rotation vector [rad] in its own axes."""
    arm = start[:3, 3] - centre
    radius = float(np.linalg.norm(arm))
    length = radius * angle
    direction = np.cross(normal, arm) / radius
    return PathStretch(start[:3, 3], start[:3, :3], length, direction, turn / length, centre, normal)


def shortest(start: np.ndarray, goal: np.ndarray, place: str) -> np.ndarray:
    """Rotation vector (3,) [rad] between poses.

    Raises:
        ScenarioError: half a turn, whose direction is undefined.
    """
    turn = shortest_turn(start[:3, :3], goal[:3, :3])
    if np.linalg.norm(turn) > np.pi - HALF_TURN:
        what = "the tool is turned by half a turn, which has no shortest direction"
        raise ScenarioError(what, place=place, expected="a pose between, that says which way round")
    return turn


def numbers(place: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Finite numbers in an array of a given shape.

    Raises:
        ScenarioError: names the place, the value and what was expected.
    """
    array = scalar.numbers_or_nan(value)
    if array.shape != shape or not np.isfinite(array).all():
        raise ScenarioError(place=place, value=value, expected=f"finite numbers {shape}")
    return array


def goal_pose(place: str, value: Any) -> np.ndarray:
    """A position (3,) as it is; a pose (4, 4) with its rotation made orthogonal to rounding.

    Raises:
        ScenarioError: neither; a matrix that is no rotation.
    """
    if np.shape(value) == (3,):
        return numbers(place, value, (3,))
    pose = numbers(place, value, (4, 4)).copy()
    r = pose[:3, :3]
    right = np.abs(r.T @ r - np.eye(3)).max() < ORTHOGONAL and np.linalg.det(r) > 0.0
    if not right or np.abs(pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > ORTHOGONAL:
        expected = "a rotation matrix, a position, and the row 0 0 0 1"
        raise ScenarioError("no pose", place=place, value=value, expected=expected)
    u, _, v = np.linalg.svd(r)
    pose[:3, :3] = u @ v
    return pose


def _posed(goal: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The goal as a pose (4, 4); a position takes the rotation of the start."""
    if goal.shape == (4, 4):
        return goal
    pose = start.copy()
    pose[:3, 3] = goal
    return pose

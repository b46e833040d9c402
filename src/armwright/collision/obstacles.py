"""Obstacles around an arm: planes, boxes and spheres in base axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright import scalar
from armwright.collision.distance import point_to_segment, segment_to_box, segment_to_plane
from armwright.errors import ScenarioError
from armwright.printable import is_seen
from armwright.scalar import Array, Scalar
from armwright.spatial import rotation_rpy

FARTHEST = 1e12  # [m] of an obstacle and its size, whose squares are computed with


@dataclass(frozen=True, eq=False)
class PlaneObstacle:
    """A half-space such as a floor or a wall, solid behind its plane.

    Args:
        point: (3,) [m] any point of the plane.   normal: (3,) out of the solid side, of any length but 0.   name: for reports.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> floor = aw.collision.PlaneObstacle((0, 0, -0.3), normal=(0, 0, 1), name="floor")
        >>> near = aw.collision.clearance("puma560", [floor], radius=0.06)
        >>> near.pairs[-1]
        ('link6', 'floor')
    """

    point: Any
    normal: Any
    name: str = "plane"

    def __post_init__(self) -> None:
        _check_name(self.name)
        _lengths(self, "point")
        if not np.any(_numbers(self, "normal")):
            raise ScenarioError(place=f"{self.name}.normal", value=self.normal, expected="a vector that is not 0")

    def distance(self, a: Array, b: Array) -> Scalar:
        """Distance [m] of the segment a to b, each (3,) [m] in base axes; negative behind the plane."""
        normal = np.asarray(self.normal, dtype=float)
        normal = normal / np.abs(normal).max()  # squares of any length but 0 stay within the range of floats
        return segment_to_plane(a, b, np.asarray(self.point, dtype=float), normal / np.linalg.norm(normal))


@dataclass(frozen=True, eq=False)
class BoxObstacle:
    """A rectangular block.

    Args:
        size: (3,) [m] along its x, y, z.   position: (3,) [m] of its middle.
        rpy: (3,) [rad] its angles about fixed x, then y, then z.   name: for reports.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> table = aw.collision.BoxObstacle((0.4, 0.6, 0.1), (0.7, 0.2, 0.1), name="table")
        >>> near = aw.collision.clearance("puma560", [table], radius=0.06)
        >>> near.pairs[-1]
        ('link6', 'table')
    """

    size: Any
    position: Any
    rpy: Any = (0.0, 0.0, 0.0)
    name: str = "box"

    def __post_init__(self) -> None:
        _check_name(self.name)
        _lengths(self, "position")
        _numbers(self, "rpy")
        if not (_lengths(self, "size") > 0.0).all():
            raise ScenarioError(place=f"{self.name}.size", value=self.size, expected="3 numbers above 0 [m]")

    def distance(self, a: Array, b: Array) -> Scalar:
        """Distance [m] of the segment a to b, each (3,) [m] in base axes; 0 where they meet."""
        turn = rotation_rpy(*np.asarray(self.rpy, dtype=float)).astype(float).T
        middle = np.asarray(self.position, dtype=float)
        return segment_to_box(turn @ (a - middle), turn @ (b - middle), 0.5 * np.asarray(self.size, dtype=float))


@dataclass(frozen=True, eq=False)
class SphereObstacle:
    """A ball.

    Args:
        radius: [m].   position: (3,) [m] of its middle.   name: for reports.
    Raises:
        ScenarioError: names the field, its value and what was expected.
    Example:
        >>> ball = aw.collision.SphereObstacle(0.1, position=(0.7, 0.2, 0.1), name="ball")
        >>> near = aw.collision.clearance("puma560", [ball], radius=0.06)
        >>> near.pairs[-1]
        ('link6', 'ball')
    """

    radius: float
    position: Any
    name: str = "sphere"

    def __post_init__(self) -> None:
        _check_name(self.name)
        _lengths(self, "position")
        number = scalar.real_number(self.radius)
        if number is None or not 0.0 < number <= FARTHEST:
            expected = f"a number above 0 and at most {FARTHEST:g} [m]"
            raise ScenarioError(place=f"{self.name}.radius", value=self.radius, expected=expected)

    def distance(self, a: Array, b: Array) -> Scalar:
        """Distance [m] of the segment a to b, each (3,) [m] in base axes; negative where it meets the ball."""
        middle = np.asarray(self.position, dtype=float)
        return scalar.sqrt(point_to_segment(middle, a, b)) - self.radius


Obstacle = PlaneObstacle | BoxObstacle | SphereObstacle


def _numbers(obstacle: Any, field: str) -> np.ndarray:
    value = getattr(obstacle, field)
    numbers = scalar.numbers_or_nan(value)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise ScenarioError(place=f"{obstacle.name}.{field}", value=value, expected="3 finite numbers")
    return numbers


def _lengths(obstacle: Any, field: str) -> np.ndarray:
    numbers = _numbers(obstacle, field)
    if np.abs(numbers).max() > FARTHEST:
        expected = f"3 numbers of at most {FARTHEST:g} [m]"
        raise ScenarioError(place=f"{obstacle.name}.{field}", value=getattr(obstacle, field), expected=expected)
    return numbers


def _check_name(name: Any) -> None:
    """Refuses a name that nobody reads as it is.

    Raises:
        ScenarioError: with the name.
    """
    if not isinstance(name, str) or not is_seen(name):
        expected = "text without control or invisible characters"
        raise ScenarioError(place="obstacle name", value=name, expected=expected)

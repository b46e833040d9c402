"""Upper bound of the reach of a chain of modules, added up module by module along points of the joints' axes.

A point of an axis does not move when the joint turns. So the distance between points of consecutive axes is constant, and no
pose brings the tip further than the sum of these distances. Where two axes of a module intersect, they share the point.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from armwright.modules.library import Connector, Module
from armwright.modules.mounting import MEETING
from armwright.spatial import Placement

PARALLEL = 1e-9  # sine of an angle between axes below which they are parallel


@dataclass(frozen=True, eq=False)
class Passage:
    """Geometry of a module from the face that it stands on to the face at its end, in the first face's frame."""

    joints: int
    entry: np.ndarray  # (3,) [m] point on the first axis
    inner: float  # [m] from there to the point on the last axis
    exit: np.ndarray  # (3,) [m] point on the last axis, in the end's frame
    end: Placement  # of the end at q = 0

    def extend(self, length: float, point: np.ndarray, turn: np.ndarray) -> tuple[float, np.ndarray]:
        """Length [m] and last point (3,) with this module, from those before it; `turn` (3, 3) is the module's rotation."""
        if not self.joints:
            return length, self.end.rotation.T @ (turn.T @ point - self.end.position)
        return length + float(np.linalg.norm(turn @ self.entry - point)) + self.inner, self.exit


def passage(module: Module, start: Connector, end: str | None) -> Passage:
    """Passage from one connector of a module to another.

    Args:
        module: with both connectors.   start: the face on the carrier.   end: name of the other; None: the last joint.
    """
    bodies: dict[str, tuple[Placement, list[tuple[Any, Placement]]]]
    bodies, last = {start.body: (MEETING @ start.placement().inverse(), [])}, start.body
    for crossing in module.crossings(start.body):
        placed, passed = bodies[crossing.near]
        at, last = placed @ crossing.before, crossing.far
        bodies[last] = (at @ crossing.after, [*passed, (crossing.joint, at)])
    if end is None:
        placed, passed = bodies[last]
        placed = passed[-1][1] if passed else placed
    else:
        face = module.connector(end)
        placed, passed = bodies[face.body]
        placed = placed @ face.placement()
    moving = [(joint, at) for joint, at in passed if joint.kind.moves]
    points = _points(moving) or [np.zeros(3)]
    inner = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(points))
    inner += sum(_travel(joint) for joint, _ in moving)
    return Passage(len(moving), points[0], inner, placed.inverse().point(points[-1]), placed)


def _points(moving: list[tuple[Any, Placement]]) -> list[np.ndarray]:
    """A point on every axis: the foot of the common normal with its neighbour; of a joint that slides the origin of its frame."""
    axes = [
        (at.position, at.rotation @ np.array(joint.axis) / np.linalg.norm(np.array(joint.axis))) for joint, at in moving
    ]
    points = []
    for k, (joint, _) in enumerate(moving):
        p, z = axes[k]
        if joint.kind.slides:
            points.append(p)
        elif len(axes) == 1:
            points.append(p - z * float(p @ z))
        else:
            points.append(p + z * _foot(p, z, *axes[k - 1 if k else 1]))
    return points


def _foot(p: np.ndarray, z: np.ndarray, o: np.ndarray, y: np.ndarray) -> float:
    """Distance along the axis (p, z) to the foot of its common normal with the axis (o, y)."""
    across = 1.0 - float(z @ y) ** 2
    d = o - p
    if across < PARALLEL**2:
        return float(d @ z)
    return float(d @ z - (d @ y) * (z @ y)) / across


def _travel(joint: Any) -> float:
    """Largest distance of a joint that slides from its zero [m], infinite without limits."""
    if not joint.kind.slides:
        return 0.0
    limits = joint.limit("position")
    return np.inf if limits is None else float(np.abs(joint.kind.motion(np.array(limits))[1]).max())

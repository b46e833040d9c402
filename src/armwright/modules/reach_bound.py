"""How far chains of modules reach at most, added up module by module along points of the joints' axes.

A point of an axis stays where it is when the joint turns, so consecutive points are rigidly apart, and no pose brings the
tip further than the sum of their distances. Where two axes of a module meet, they share the point.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from armwright.modules.library import Connector, Module, placement
from armwright.modules.mount import MEETING
from armwright.spatial import Placement

PARALLEL = 1e-9  # sine of an angle between axes below which they are parallel


@dataclass(frozen=True, eq=False)
class Passage:
    """The way through a module that stands on a face, in the face's frame; the end in that of the face at the end."""

    joints: int
    entry: np.ndarray  # (3,) [m] the first axis' point
    inner: float  # [m] from there to the last axis' point
    exit: np.ndarray  # (3,) [m] the last axis' point, in the end's frame
    end: Placement  # where the end stands at q = 0

    def extend(self, length: float, point: np.ndarray, turn: np.ndarray) -> tuple[float, np.ndarray]:
        """The length [m] and last point (3,) behind the module, from those before it; `turn` (3, 3) is how it is put on."""
        if not self.joints:
            return length, self.end.rotation.T @ (turn.T @ point - self.end.position)
        return length + float(np.linalg.norm(turn @ self.entry - point)) + self.inner, self.exit


def passage(module: Module, start: Connector, end: str | None) -> Passage:
    """The way from one connector of a module to another.

    Args:
        module: what they belong to.   start: stands on the carrying face.   end: None: where the last joint is.
    """
    bodies = {start.body: (MEETING @ start.placement().inverse(), [])}
    waiting, last = [start.body], start.body
    while waiting:
        here = waiting.pop(0)
        stands, passed = bodies[here]
        for joint in module.joints:
            there = joint.child if joint.parent == here else joint.parent
            if here in (joint.parent, joint.child) and there not in bodies:
                before, behind = placement(joint.frame), placement(joint.child_frame)
                if joint.parent != here:
                    before, behind = behind.inverse(), before.inverse()
                at = stands @ before
                bodies[there] = (at @ behind, [*passed, (joint, at)])
                waiting.append(there)
                last = there
    if end is None:
        placed, passed = bodies[last]
        placed = passed[-1][1] if passed else placed
    else:
        face = module.connector(end)
        placed, passed = bodies[face.body]
        placed = placed @ face.placement()
    moving = [(joint, at) for joint, at in passed if joint.type != "fixed"]
    points = _points(moving)
    inner = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(points))
    inner += sum(_slide(joint) for joint, _ in moving)
    first, final = (points[0], points[-1]) if points else (np.zeros(3), np.zeros(3))
    return Passage(len(moving), first, inner, placed.inverse().point(final), placed)


def _points(moving: list[tuple[Any, Placement]]) -> list[np.ndarray]:
    """A point on every axis: where the common normal with its neighbour stands on it; a slide's own origin."""
    axes = [
        (at.position, at.rotation @ np.array(joint.axis) / np.linalg.norm(np.array(joint.axis))) for joint, at in moving
    ]
    points = []
    for k, (joint, _) in enumerate(moving):
        p, z = axes[k]
        other = axes[k - 1] if k else axes[1] if len(axes) > 1 else None
        if joint.type != "prismatic" and other is not None:
            p = p + z * _foot(p, z, *other)
        elif joint.type != "prismatic":
            p = p - z * float(p @ z)
        points.append(p)
    return points


def _foot(p: np.ndarray, z: np.ndarray, o: np.ndarray, y: np.ndarray) -> float:
    """How far along the axis (p, z) the common normal with the axis (o, y) stands on it."""
    across = 1.0 - float(z @ y) ** 2
    d = o - p
    if across < PARALLEL**2:
        return float(d @ z)
    return float(d @ z - (d @ y) * (z @ y)) / across


def _slide(joint: Any) -> float:
    """How far a slide moves from its zero [m], infinite without limits."""
    if joint.type != "prismatic":
        return 0.0
    given = joint.limits.position_m
    return np.inf if given is None else float(np.abs(np.array(given)).max())

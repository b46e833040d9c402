"""Gas springs and counterbalance cylinders through a motion: a barrel at one end, a rod sliding in it at the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armwright.model import BASE, Model
from armwright.pictures.joint_figure import BARREL, ROD, bone_size
from armwright.pictures.keyframes import keyframes
from armwright.spatial import rotation_quaternion, rotation_to_axis

TOLERANCE = 1e-4  # [m] of an end, where straight lines stand for its path
FINE = 0.02  # [rad | m] that a joint moves between two times at which ends are computed
OVERLAP = 0.02  # of the greatest length: the rod still stands in the barrel there


@dataclass(frozen=True)
class CylinderPart:
    """One of the two pieces of a cylinder, drawn along z from its own end of the cylinder.

    Attributes:
        name: of its node.   end: 0 or 1, where it is fixed.   radius, length: [m].
    """

    name: str
    end: int
    radius: float
    length: float


def cylinder_parts(arm: Model, q: np.ndarray) -> Iterator[tuple[int, CylinderPart]]:
    """Number of each cylinder and its two pieces, long enough for all positions q (k, bodies)."""
    size = bone_size(arm)
    for number, cylinder in enumerate(arm.cylinders):
        longest = float(np.linalg.norm(np.subtract(*cylinder_ends(arm, number, q)), axis=1).max())
        yield number, CylinderPart(f"{cylinder.name} barrel", 0, BARREL * size, 0.5 * longest)
        yield number, CylinderPart(f"{cylinder.name} rod", 1, ROD * size, (0.5 + OVERLAP) * longest)


def part_keyframes(
    arm: Model, number: int, part: CylinderPart, t: np.ndarray, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (m,), translations (m, 3) [m] and quaternions x, y, z, w (m, 4) of a piece in the base's frame.

    Args:
        arm: the arm.   number: of the cylinder.   t: (k,) [s].   q: (k, bodies) [rad | m], linear between these times.
    """
    parts = np.maximum(np.ceil(np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0) / FINE), 1).astype(int)
    fine = np.append(np.repeat(np.arange(len(parts)), parts) + _fractions(parts), len(parts))
    times = np.interp(fine, np.arange(len(t)), t)
    ends = np.hstack(cylinder_ends(arm, number, _at(times, t, q)))
    kept = np.unique(np.concatenate([keyframes(times, entry, TOLERANCE, False)[0] for entry in ends.T]))
    own = cylinder_ends(arm, number, _at(kept.astype(float), t, q))
    away = own[1 - part.end] - own[part.end]
    turns = np.array([np.roll(rotation_quaternion(rotation_to_axis(leg)), -1) for leg in away])
    for k in range(1, len(turns)):  # q and -q turn alike; neighbours of one sign are interpolated the short way
        turns[k] *= 1.0 if turns[k] @ turns[k - 1] >= 0.0 else -1.0
    return kept, own[part.end], turns


def cylinder_ends(arm: Model, number: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends (k, 3) [m] of a cylinder in the base's frame, at positions q (k, bodies)."""
    cylinder = arm.cylinders[number]
    first, second = (_points(arm, b, np.asarray(e), q) for b, e in zip(cylinder.bodies, cylinder.ends, strict=True))
    return first, second


def _points(arm: Model, body: int, point: np.ndarray, q: np.ndarray) -> np.ndarray:
    """A point of a body in the base's frame (k, 3), from the body outward to the base."""
    points = np.broadcast_to(point.astype(float), (len(q), 3))
    while body != BASE:
        link = arm.bodies[body]
        angle = q[:, body] + float(link.offset) if link.kind.turns else np.zeros(len(q))
        c, s = np.cos(angle), np.sin(angle)
        x, y, z = points.T
        turned = np.column_stack([c * x - s * y, s * x + c * y, z])
        if link.kind.slides:
            turned[:, 2] += link.kind.motion(q[:, body])[1]
        rotation, position = (
            np.asarray(each, dtype=float) for each in (link.placement.rotation, link.placement.position)
        )
        points, body = turned @ rotation.T + position, link.parent
    return points


def _fractions(parts: np.ndarray) -> np.ndarray:
    """0, 1/k, 2/k, … for each number k of parts."""
    first = np.cumsum(parts) - parts
    return (np.arange(parts.sum()) - np.repeat(first, parts)) / np.repeat(parts, parts)


def _at(times: np.ndarray, t: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Positions (m, bodies) at times, on straight lines between rows."""
    return np.column_stack([np.interp(times, t, entry) for entry in q.T])
